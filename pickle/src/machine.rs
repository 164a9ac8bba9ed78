//! The stack machine that a pickle is a program for.
//!
//! It builds plain data and calls nothing. Values stand in one table and refer to each other by
//! index, so no input can make it recurse, and each instruction, which is at least a byte, adds at
//! most one value and takes time for what it takes off the stack.

use std::collections::BTreeMap;

use crate::budget::{Budget, OverLimit};
use crate::error::{PickleError, error};
use crate::text::{quoted, unicode};
use crate::value::{Made, Value, call, complete, storage};

/// No module, class or function has a longer name; names are copied, and may be used many times.
const LONGEST_NAME: usize = 200;
/// What remembering a value takes, in a tree whose nodes are half full.
const MEMO: usize = 24;

type Step<T = ()> = Result<T, PickleError>;

pub(crate) struct Machine<'a> {
    bytes: &'a [u8],
    /// Where the instruction begins, and where reading goes on.
    start: usize,
    at: usize,
    values: Vec<Value<'a>>,
    stack: Vec<u32>,
    /// Heights of the stack.
    marks: Vec<usize>,
    memo: BTreeMap<u32, u32>,
    budget: Budget,
}

/// What is left at the end.
pub(crate) struct Finished<'a> {
    pub(crate) values: Vec<Value<'a>>,
    pub(crate) root: u32,
    /// Bytes that were read.
    pub(crate) length: usize,
}

/// Runs the pickle at the front of the bytes.
pub(crate) fn run<'a>(bytes: &'a [u8], budget: &Budget) -> Step<Finished<'a>> {
    let (values, stack, marks) = (Vec::new(), Vec::new(), Vec::new());
    let (memo, budget) = (BTreeMap::new(), budget.clone());
    let mut machine = Machine { bytes, start: 0, at: 0, values, stack, marks, memo, budget };
    loop {
        machine.start = machine.at;
        if let Some(root) = machine.step()? {
            machine.budget.give_back(machine.stack.capacity() * size_of::<u32>());
            machine.budget.give_back(machine.marks.capacity() * size_of::<usize>());
            machine.budget.give_back(machine.memo.len() * MEMO);
            return Ok(Finished { values: machine.values, root, length: machine.at });
        }
    }
}

impl<'a> Machine<'a> {
    /// Runs one instruction; the result at the end. Names are those of Python's `pickletools`.
    fn step(&mut self) -> Step<Option<u32>> {
        let op = self.take(1)?[0];
        match op {
            b'.' => return self.pop().map(Some),                // STOP
            0x80 => drop(self.take(1)?),                        // PROTO
            0x95 => drop(self.take(8)?),                        // FRAME
            b'N' => self.push(Value::None)?,                    // NONE
            0x88 | 0x89 => self.push(Value::Bool(op == 0x88))?, // NEWTRUE, NEWFALSE
            b']' | b')' | 0x8f => self.push(Value::Sequence(Vec::new()))?, // EMPTY_LIST, _TUPLE, _SET
            b'}' => self.push(Value::Dictionary(Vec::new()))?,             // EMPTY_DICT
            b'K' | b'M' | b'J' | b'I' | b'L' | 0x8a | 0x8b => self.integer(op)?,
            b'G' => drop((self.take(8)?, self.push(Value::Number)?)), // BINFLOAT
            b'F' => drop((self.number_in_line()?, self.push(Value::Number)?)), // FLOAT
            b'U' | b'T' | b'X' | b'C' | b'B' | 0x8c | 0x8d | 0x8e | 0x96 | b'S' | b'V' => {
                self.text(op)?;
            }
            b'(' => {
                let height = self.stack.len();
                let room = self.budget.reserve(&mut self.marks, 1);
                self.held(room)?;
                self.marks.push(height);
            } // MARK
            b't' | b'l' | 0x91 => {
                let items = self.above_mark()?;
                self.push(Value::Sequence(items))?;
            } // TUPLE, LIST, FROZENSET
            b'd' => {
                let items = self.above_mark()?;
                self.push(Value::Dictionary(items))?;
            } // DICT
            0x85..=0x87 => {
                let floor = self.floor();
                let start = self.stack.len().checked_sub(usize::from(op - 0x84));
                let start = start.filter(|&start| start >= floor);
                let start = start.ok_or_else(|| self.wrong("an empty stack", "values"))?;
                let items = self.split(start)?;
                self.push(Value::Sequence(items))?;
            } // TUPLE1, TUPLE2, TUPLE3
            b'a' => {
                let item = self.pop()?;
                self.extend(&[item])?;
            } // APPEND
            b's' => {
                let (value, key) = (self.pop()?, self.pop()?);
                self.extend(&[key, value])?;
            } // SETITEM
            b'e' | b'u' | 0x90 => {
                let items = self.above_mark()?;
                self.extend(&items)?;
                self.budget.give_back(size_of_val(&items[..]));
            } // APPENDS, SETITEMS, ADDITEMS
            b'0' if self.marks.last() == Some(&self.stack.len()) => drop(self.marks.pop()), // POP of a mark
            b'0' => drop(self.pop()?),                                                      // POP
            b'1' => {
                let items = self.above_mark()?;
                self.budget.give_back(size_of_val(&items[..]));
            } // POP_MARK
            b'2' => self.top().and_then(|top| self.push_index(top))?,                       // DUP
            b'p' | b'q' | b'r' | 0x94 | b'g' | b'h' | b'j' => self.memory(op)?,
            b'c' | 0x93 => self.global(op)?,
            b'R' | 0x81 => {
                let (arguments, function) = (self.pop()?, self.pop()?);
                match call(&self.values, function, arguments) {
                    Made::New(value) => self.push(value)?,
                    Made::Argument(index) => self.push_index(index)?,
                }
            } // REDUCE, NEWOBJ
            b'b' => {
                let (state, target) = (self.pop()?, self.top()?);
                if !complete(&mut self.values, target, state) {
                    return Err(self.wrong("another state", "that of an array"));
                }
            } // BUILD
            b'Q' => {
                let id = self.pop()?;
                self.push(storage(&self.values, id))?;
            } // BINPERSID
            _ => {
                let found = format!("instruction {op:#04x}");
                return Err(self.wrong(&found, "one for numbers, lists and arrays"));
            }
        }
        Ok(None)
    }

    fn wrong(&self, found: &str, expected: &str) -> PickleError {
        error(format!("byte {}", self.start), found, expected)
    }

    fn take(&mut self, count: usize) -> Step<&'a [u8]> {
        let taken = self.bytes[self.at..].get(..count).ok_or_else(|| {
            let found = format!("{} bytes before the end", self.bytes.len() - self.at);
            error(format!("byte {}", self.at), found, &format!("{count}"))
        })?;
        self.at += count;
        Ok(taken)
    }

    /// The rest of a line, without its end.
    fn line(&mut self) -> Step<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let line = self.take(rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len()))?;
        self.take(1)?;
        Ok(line)
    }

    /// A little-endian number of this many bytes, at most eight.
    fn number(&mut self, size: usize) -> Step<u64> {
        let mut raw = [0_u8; 8];
        raw[..size].copy_from_slice(self.take(size)?);
        Ok(u64::from_le_bytes(raw))
    }

    /// As many bytes as a number of this many bytes says.
    fn counted(&mut self, size: usize) -> Step<&'a [u8]> {
        let count = self.number(size)?;
        self.take(usize::try_from(count).unwrap_or(usize::MAX))
    }

    /// The error where the values would take more memory than a file of this length may.
    fn held(&self, taken: Result<(), OverLimit>) -> Step {
        taken.map_err(|OverLimit { needed, most }| {
            let expected = format!("values that take at most {most}");
            self.wrong(&format!("{needed} bytes of memory"), &expected)
        })
    }

    /// Adds a value, whose memory beside its place was counted before.
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

    /// Where what is above the last mark begins.
    fn floor(&self) -> usize {
        self.marks.last().copied().unwrap_or(0)
    }

    fn top(&self) -> Step<u32> {
        let top = self.stack[self.floor()..].last();
        top.copied().ok_or_else(|| self.wrong("an empty stack", "a value"))
    }

    fn pop(&mut self) -> Step<u32> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    fn split(&mut self, start: usize) -> Step<Vec<u32>> {
        self.held(self.budget.take(size_of_val(&self.stack[start..])))?;
        Ok(self.stack.drain(start..).collect())
    }

    /// What lies above the last mark, which is taken away too.
    fn above_mark(&mut self) -> Step<Vec<u32>> {
        let mark = self.marks.pop().ok_or_else(|| self.wrong("no mark on the stack", "one"))?;
        self.split(mark)
    }

    fn extend(&mut self, items: &[u32]) -> Step {
        let top = self.top()? as usize;
        match &mut self.values[top] {
            Value::Sequence(list) | Value::Dictionary(list) => {
                let room = self.budget.reserve(list, items.len());
                if room.is_ok() {
                    list.extend(items);
                }
                self.held(room)
            }
            Value::Foreign(_) => Ok(()),
            other => Err(error(
                format!("byte {}", self.start),
                other.kind(),
                "a list or dictionary to put values into",
            )),
        }
    }

    fn integer(&mut self, op: u8) -> Step {
        let value = match op {
            b'K' => Value::Integer(self.number(1)? as i64), // BININT1
            b'M' => Value::Integer(self.number(2)? as i64), // BININT2
            b'J' => Value::Integer(i64::from(self.number(4)? as u32 as i32)), // BININT
            0x8a | 0x8b => {
                let bytes = self.counted(if op == 0x8a { 1 } else { 4 })?;
                let mut raw =
                    [if bytes.last().is_some_and(|b| b & 0x80 != 0) { 0xff } else { 0 }; 8];
                match raw.get_mut(..bytes.len()) {
                    Some(low) => low.copy_from_slice(bytes),
                    None => return self.push(Value::Number),
                }
                Value::Integer(i64::from_le_bytes(raw))
            } // LONG1, LONG4
            _ => match self.number_in_line()? {
                "00" if op == b'I' => Value::Bool(false),
                "01" if op == b'I' => Value::Bool(true),
                digits => digits.parse().map_or(Value::Number, Value::Integer),
            }, // INT, LONG
        };
        self.push(value)
    }

    /// A line with a number, without the `L` of a long one.
    fn number_in_line(&mut self) -> Step<&'a str> {
        let line = self.line()?;
        let text = std::str::from_utf8(line).unwrap_or_default().trim_end_matches('L');
        if text.parse::<f64>().is_err() {
            let found: String = String::from_utf8_lossy(line).chars().take(40).collect();
            return Err(self.wrong(&found, "a number"));
        }
        Ok(text)
    }

    fn text(&mut self, op: u8) -> Step {
        let size = match op {
            b'U' | b'C' | 0x8c => 1, // SHORT_BINSTRING, SHORT_BINBYTES, SHORT_BINUNICODE
            b'T' | b'X' | b'B' => 4, // BINSTRING, BINUNICODE, BINBYTES
            0x8d | 0x8e | 0x96 => 8, // BINUNICODE8, BINBYTES8, BYTEARRAY8
            _ => {
                let line = self.line()?;
                // Of a byte of Latin-1 UTF-8 makes two; a growing text moves into twice the room.
                self.held(self.budget.take(line.len().saturating_mul(4)))?;
                let text =
                    if op == b'S' { quoted(line) } else { Value::Text(unicode(line).into()) };
                return self.push(text);
            } // STRING, UNICODE
        };
        let bytes = self.counted(size)?;
        // Python 2 does not tell texts and bytes apart.
        let text = if matches!(op, b'C' | b'B' | 0x8e | 0x96) {
            None
        } else {
            std::str::from_utf8(bytes).ok()
        };
        self.push(match text {
            Some(text) => Value::Text(text.into()),
            None => Value::Bytes(bytes.into()),
        })
    }

    /// Remembers the top of the stack, or brings back what was remembered.
    fn memory(&mut self, op: u8) -> Step {
        let key = match op {
            b'p' | b'g' => {
                let line = std::str::from_utf8(self.line()?).unwrap_or_default();
                line.trim().parse().map_err(|_| self.wrong("another word", "a number"))?
            }
            b'q' | b'h' => self.number(1)? as u32,
            b'r' | b'j' => self.number(4)? as u32,
            _ => self.memo.len() as u32,
        };
        if matches!(op, b'g' | b'h' | b'j') {
            let value = self.memo.get(&key).copied();
            return self
                .push_index(value.ok_or_else(|| self.wrong("a value never remembered", "one"))?);
        }
        let top = self.top()?;
        if self.memo.insert(key, top).is_none() {
            self.held(self.budget.take(MEMO))?;
        }
        Ok(())
    }

    /// A class or function: its module and name follow, or are on the stack.
    fn global(&mut self, op: u8) -> Step {
        let parts = if op == b'c' {
            [Some(self.line()?), Some(self.line()?)]
        } else {
            let (name, module) = (self.pop()?, self.pop()?);
            [module, name].map(|index| self.values[index as usize].text().map(str::as_bytes))
        };
        let name = match parts {
            [Some(module), Some(name)] if module.len() + name.len() <= LONGEST_NAME => {
                [module, name].map(|part| String::from_utf8_lossy(part)).join(".")
            }
            _ => return Err(self.wrong("a long text, or none", "a name")),
        };
        self.held(self.budget.take(name.capacity()))?;
        self.push(Value::Global(name))
    }
}
