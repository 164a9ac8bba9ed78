//! The instructions of a pickle.

use std::borrow::Cow;
use std::collections::BTreeMap;

use crate::budget::{Budget, OverLimit};

use super::{Dtype, PickleError, RawArray, Value, error};

/// Of the memory that a pickle may take, what nobody counts.
const UNCOUNTED: u64 = 16_000_000;
/// No module, class or function has a longer name; names are copied, and may be used many times.
const LONGEST_NAME: usize = 64;
/// What remembering a value takes, in a tree whose nodes are half full.
const MEMO: usize = 24;

/// The stack machine that a pickle is a program for.
pub(super) struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    values: Vec<Value<'a>>,
    stack: Vec<u32>,
    memo: BTreeMap<u32, u32>,
    /// Memory that may still be taken.
    budget: Budget,
}

type Step<T = ()> = Result<T, PickleError>;

impl<'a> Machine<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let (values, stack, memo) = (Vec::new(), Vec::new(), BTreeMap::new());
        let mut budget = Budget::of_pickle(bytes.len());
        let _ = budget.take(bytes.len() as u64 + UNCOUNTED);
        Self { bytes, at: 0, values, stack, memo, budget }
    }

    /// Runs to the end: the table of values, which of them is the result, what may still be taken. Each instruction
    /// takes at least a byte, and time for what it takes off the stack.
    pub(super) fn run(mut self) -> Step<(Vec<Value<'a>>, u32, Budget)> {
        loop {
            let op = self.take(1)?[0];
            match op {
                b'.' => {
                    let root = self.pop()?;
                    return Ok((self.values, root, self.budget));
                }
                0x80 => drop(self.take(1)?), // protocol
                0x95 => drop(self.take(8)?), // frame
                b'(' => self.push(Value::Mark)?,
                b'N' => self.push(Value::None)?,
                0x88 | 0x89 => self.push(Value::Number(f64::from(op == 0x88)))?,
                b']' | b')' | b'}' => self.push(Value::Sequence(Vec::new()))?,
                b'K' | b'M' | b'J' | b'G' | 0x8a | b'I' | b'L' | b'F' => self.number(op)?,
                b'U' | b'T' | b'X' | b'C' | b'B' | 0x8c | 0x8d | 0x8e | 0x96 | b'S' | b'V' => {
                    self.text(op)?;
                }
                b't' | b'l' | b'd' => {
                    let items = self.above_mark()?;
                    self.push(Value::Sequence(items))?;
                }
                0x85..=0x87 => {
                    let count = usize::from(op - 0x84);
                    let Some(start) = self.stack.len().checked_sub(count) else {
                        return Err(self.wrong("an empty stack", "values for a tuple"));
                    };
                    self.take_memory(count * size_of::<u32>())?;
                    let items = self.stack.split_off(start);
                    self.push(Value::Sequence(items))?;
                }
                b'a' => {
                    let item = self.pop()?;
                    self.extend(&[item])?;
                }
                b's' => {
                    let (value, key) = (self.pop()?, self.pop()?);
                    self.extend(&[key, value])?;
                }
                b'e' | b'u' => {
                    let items = self.above_mark()?;
                    self.extend(&items)?;
                    self.budget.give_back(size_of_val(&items[..]) as u64);
                }
                b'0' => drop(self.pop()?),
                b'1' => {
                    let items = self.above_mark()?;
                    self.budget.give_back(size_of_val(&items[..]) as u64);
                }
                b'2' => {
                    let top = self.pop()?;
                    self.push_index(top)?;
                    self.push_index(top)?;
                }
                b'p' | b'q' | b'r' | 0x94 | b'g' | b'h' | b'j' => self.memory(op)?,
                b'c' => {
                    let (module, name) = (self.line()?, self.line()?);
                    self.take_memory(module.len() + name.len() + 1)?;
                    self.push(Value::Global([module, b".", name].concat().into()))?;
                }
                0x93 => {
                    let (name, module) = (self.pop_bytes()?, self.pop_bytes()?);
                    self.take_memory(module.len() + name.len() + 1)?;
                    self.push(Value::Global([&module[..], b".", &name].concat().into()))?;
                }
                b'R' => self.reduce()?,
                b'b' => self.build()?,
                _ => {
                    return Err(self.wrong(
                        &format!("instruction {op:#04x}"),
                        "one for numbers, lists and arrays",
                    ));
                }
            }
        }
    }

    fn wrong(&self, found: &str, expected: &str) -> PickleError {
        error(format!("byte {}", self.at.saturating_sub(1)), found, expected)
    }

    fn take(&mut self, count: usize) -> Step<&'a [u8]> {
        let end = self.at.checked_add(count).filter(|&end| end <= self.bytes.len());
        let Some(end) = end else {
            return Err(error(
                format!("byte {}", self.at),
                "the end of the file",
                "more of the pickle",
            ));
        };
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    /// The rest of a line, without its end.
    fn line(&mut self) -> Step<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        let line = self.take(length)?;
        self.take(1)?;
        Ok(line)
    }

    /// A little-endian count of this many bytes.
    fn count(&mut self, size: usize) -> Step<u64> {
        let mut raw = [0_u8; 8];
        raw[..size].copy_from_slice(self.take(size)?);
        Ok(u64::from_le_bytes(raw))
    }

    /// The error where the values would take more memory than a file of this length may.
    fn held(&self, taken: Result<(), OverLimit>) -> Step {
        taken.map_err(|OverLimit { needed, most }| {
            let expected = format!("values that take at most {most}");
            self.wrong(&format!("{needed} bytes of memory"), &expected)
        })
    }

    fn take_memory(&mut self, bytes: usize) -> Step {
        let taken = self.budget.take(bytes as u64);
        self.held(taken)
    }

    fn push(&mut self, value: Value<'a>) -> Step {
        let index = u32::try_from(self.values.len());
        let index = index.map_err(|_| self.wrong("ever more values", "fewer than 2^32"))?;
        let room = self.budget.reserve(&mut self.values, 1);
        self.held(room)?;
        self.values.push(value);
        self.push_index(index)
    }

    fn push_index(&mut self, index: u32) -> Step {
        let room = self.budget.reserve(&mut self.stack, 1);
        self.held(room)?;
        self.stack.push(index);
        Ok(())
    }

    fn pop(&mut self) -> Step<u32> {
        self.stack.pop().ok_or_else(|| self.wrong("an empty stack", "a value"))
    }

    fn pop_bytes(&mut self) -> Step<Cow<'a, [u8]>> {
        let index = self.pop()?;
        match &self.values[index as usize] {
            Value::Bytes(bytes) if bytes.len() <= LONGEST_NAME => Ok(bytes.clone()),
            Value::Bytes(_) => Err(self.wrong("a long text", "a name")),
            other => Err(self.wrong(other.kind(), "text")),
        }
    }

    /// What lies above the last mark, which is taken away too.
    fn above_mark(&mut self) -> Step<Vec<u32>> {
        let mark = self.stack.iter().rposition(|&i| matches!(self.values[i as usize], Value::Mark));
        let mark = mark.ok_or_else(|| self.wrong("no mark on the stack", "one"))?;
        self.take_memory(size_of_val(&self.stack[mark + 1..]))?;
        let items = self.stack.split_off(mark + 1);
        self.stack.pop();
        Ok(items)
    }

    fn extend(&mut self, items: &[u32]) -> Step {
        let top = self.stack.last().copied();
        let Some(Value::Sequence(list)) = top.map(|top| &mut self.values[top as usize]) else {
            return Err(self.wrong("something else", "a list or dictionary to put values into"));
        };
        let room = self.budget.reserve(list, items.len());
        if room.is_ok() {
            list.extend(items);
        }
        self.held(room)
    }

    fn number(&mut self, op: u8) -> Step {
        let value = match op {
            b'K' => self.count(1)? as f64,
            b'M' => self.count(2)? as f64,
            b'J' => f64::from(self.count(4)? as u32 as i32),
            b'G' => f64::from_be_bytes(self.take(8)?.try_into().expect("eight bytes")),
            0x8a => {
                let size = self.count(1)? as usize;
                if size > 8 {
                    return Err(self.wrong(&format!("an integer of {size} bytes"), "at most 8"));
                }
                let raw = self.count(size)?;
                let unused = 64 - 8 * size as u32;
                // The highest bit that is there is the sign.
                if size == 0 { 0.0 } else { ((raw << unused) as i64 >> unused) as f64 }
            }
            _ => {
                let line = String::from_utf8_lossy(self.line()?).into_owned();
                let text = line.trim_end_matches('L');
                let number: Option<f64> = text.parse().ok();
                number.ok_or_else(|| {
                    let found: String = line.chars().take(40).collect();
                    self.wrong(&found, "a number")
                })?
            }
        };
        self.push(Value::Number(value))
    }

    fn text(&mut self, op: u8) -> Step {
        let size = match op {
            b'U' | b'C' | 0x8c => self.count(1)?,
            b'T' | b'X' | b'B' => self.count(4)?,
            0x8d | 0x8e | 0x96 => self.count(8)?,
            _ => {
                let line = self.line()?;
                // Of a byte of Latin-1 UTF-8 makes two; a growing text moves into twice the room.
                self.take_memory(line.len().saturating_mul(4))?;
                let text = if op == b'S' { unquoted(line) } else { unicode(line) };
                return self.push(Value::Bytes(text.into()));
            }
        };
        let bytes = self.take(usize::try_from(size).unwrap_or(usize::MAX))?;
        self.push(Value::Bytes(bytes.into()))
    }

    /// Remembers the top of the stack, or brings back what was remembered.
    fn memory(&mut self, op: u8) -> Step {
        let key = match op {
            b'p' | b'g' => {
                let line = String::from_utf8_lossy(self.line()?).into_owned();
                line.trim().parse().map_err(|_| self.wrong("another word", "a number"))?
            }
            b'q' | b'h' => self.count(1)? as u32,
            b'r' | b'j' => self.count(4)? as u32,
            _ => self.memo.len() as u32,
        };
        if matches!(op, b'g' | b'h' | b'j') {
            let value = self.memo.get(&key).copied();
            self.push_index(value.ok_or_else(|| self.wrong("a value never remembered", "one"))?)
        } else {
            let top = self.pop()?;
            self.stack.push(top);
            self.take_memory(MEMO)?;
            self.memo.insert(key, top);
            Ok(())
        }
    }

    /// Calls: of all functions only those that make arrays.
    fn reduce(&mut self) -> Step {
        let (arguments, function) = (self.pop()?, self.pop()?);
        let Value::Global(name) = &self.values[function as usize] else {
            return Err(self.wrong("something else", "a function"));
        };
        let Value::Sequence(arguments) = &self.values[arguments as usize] else {
            return Err(self.wrong("something else", "a tuple of arguments"));
        };
        let argument = |i: usize| arguments.get(i).map(|&i| (i, &self.values[i as usize]));
        let result = match (&**name, argument(0), argument(1)) {
            (b"numpy.dtype", Some((_, Value::Bytes(name))), _) => {
                Dtype::named(name).map(Value::Dtype)
            }
            (
                b"numpy.core.multiarray._reconstruct" | b"numpy._core.multiarray._reconstruct",
                ..,
            ) => Some(Value::Array(None)),
            // Python 3 writes bytes so for Python 2.
            (b"_codecs.encode", Some((text, Value::Bytes(_))), _) => Some(Value::Latin(text)),
            (
                b"numpy.core.numeric._frombuffer" | b"numpy._core.numeric._frombuffer",
                Some((data, Value::Bytes(_) | Value::Latin(_))),
                Some((_, &Value::Dtype(dtype))),
            ) => {
                let fortran =
                    matches!(argument(3), Some((_, Value::Bytes(order))) if **order == *b"F");
                let shape = argument(2).and_then(|(_, shape)| self.shape(shape));
                shape.map(|shape| {
                    Value::Array(Some(Box::new(RawArray { shape, dtype, fortran, data })))
                })
            }
            _ => None,
        };
        let Some(result) = result else {
            let name: String = String::from_utf8_lossy(name).chars().take(60).collect();
            return Err(
                self.wrong(&format!("a call of {name}"), "one that makes an array of numbers")
            );
        };
        if let Value::Array(Some(array)) = &result {
            self.take_memory(array.memory())?;
        }
        self.push(result)
    }

    /// Fills an array or a dtype with its state.
    fn build(&mut self) -> Step {
        let (state, target) = (self.pop()?, self.pop()?);
        self.stack.push(target);
        let Value::Sequence(state) = &self.values[state as usize] else {
            return Err(self.wrong("something else", "a tuple of state"));
        };
        let part = |i: usize| state.get(i).map(|&i| &self.values[i as usize]);
        let filled = match &self.values[target as usize] {
            // (version, byte order, ..)
            &Value::Dtype(dtype) => match part(1) {
                Some(Value::Bytes(order)) => {
                    Some(Value::Dtype(Dtype { big_endian: **order == *b">", ..dtype }))
                }
                _ => None,
            },
            // (version, shape, dtype, Fortran order, bytes)
            Value::Array(_) => match (part(1), part(2), part(3), state.get(4)) {
                (
                    Some(shape),
                    Some(&Value::Dtype(dtype)),
                    Some(&Value::Number(order)),
                    Some(&data),
                ) => {
                    let fortran = order != 0.0;
                    self.shape(shape).map(|shape| {
                        Value::Array(Some(Box::new(RawArray { shape, dtype, fortran, data })))
                    })
                }
                _ => None,
            },
            _ => None,
        };
        let filled = filled.ok_or_else(|| self.wrong("another state", "that of an array"))?;
        if let Value::Array(Some(array)) = &filled {
            self.take_memory(array.memory())?;
        }
        self.values[target as usize] = filled;
        Ok(())
    }

    /// At most 8 axes.
    fn shape(&self, value: &Value<'_>) -> Option<Vec<usize>> {
        let Value::Sequence(axes) = value else { return None };
        let axis = |&i: &u32| match self.values[i as usize] {
            Value::Number(n) if (0.0..1e15).contains(&n) && n.fract() == 0.0 => Some(n as usize),
            _ => None,
        };
        if axes.len() > 8 { None } else { axes.iter().map(axis).collect() }
    }
}

/// A line of protocol 0, Unicode: Latin-1 with `\uXXXX` for the rest; as UTF-8.
fn unicode(line: &[u8]) -> Vec<u8> {
    let (mut out, mut rest) = (String::with_capacity(line.len()), line);
    while let Some((&b, after)) = rest.split_first() {
        let digits = rest.strip_prefix(b"\\u").and_then(|d| d.get(..4));
        let code = digits.and_then(|d| u32::from_str_radix(std::str::from_utf8(d).ok()?, 16).ok());
        if let Some(c) = code.and_then(char::from_u32) {
            out.push(c);
            rest = &rest[6..];
        } else {
            out.push(char::from(b));
            rest = after;
        }
    }
    out.into_bytes()
}

/// A line of protocol 0, quoted, with the escapes of Python's literals.
fn unquoted(line: &[u8]) -> Vec<u8> {
    let inner = if line.len() >= 2 { &line[1..line.len() - 1] } else { line };
    let (mut out, mut rest) = (Vec::with_capacity(inner.len()), inner);
    while let Some((&b, after)) = rest.split_first() {
        rest = after;
        if b != b'\\' {
            out.push(b);
            continue;
        }
        let Some((&escape, after)) = rest.split_first() else { break };
        rest = after;
        let hex = |d: &[u8]| u8::from_str_radix(std::str::from_utf8(d).ok()?, 16).ok();
        match escape {
            b'n' => out.push(b'\n'),
            b'r' => out.push(b'\r'),
            b't' => out.push(b'\t'),
            b'x' if rest.len() >= 2 => {
                out.extend(hex(&rest[..2]));
                rest = &rest[2..];
            }
            other => out.push(other),
        }
    }
    out
}
