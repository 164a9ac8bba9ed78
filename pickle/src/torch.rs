//! The part of Python's pickle format that PyTorch's weight files are made of.
//!
//! A pickle is a program for a stack machine. This machine builds plain data and calls nothing:
//! the few constructors that weight files name (ordered dictionaries, tensors, parameters) are
//! known here, every other call gives [`Value::Opaque`]. Values live in one arena and refer to
//! each other by index, so no input can make it recurse, and each instruction, which is at least
//! a byte, adds at most a few values; what they take is counted, and ends the reading where it is
//! out of proportion to the file.
//!
//! Opcodes: Python's `pickletools` documentation, protocols 0 to 5.

use std::collections::BTreeMap;

use super::budget::Budget;

/// Bytes of the longest name of a type, function or storage.
const LONGEST_NAME: usize = 200;
/// What remembering a value takes, in a tree whose nodes are half full.
const MEMO: usize = 40;

/// A value's place in the arena.
pub type Id = usize;

/// A value of a pickle.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// None, or something that weights are not made of.
    Opaque,
    /// True or false.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A text.
    Text(String),
    /// A tuple or list.
    Sequence(Vec<Id>),
    /// Keys and values in order.
    Dictionary(Vec<(Id, Id)>),
    /// `module.name`.
    Global(String),
    /// What a persistent id says: type, key, number of elements.
    Storage {
        /// The type of its numbers: `FloatStorage`.
        kind: String,
        /// Its name in the file.
        key: String,
        /// How many numbers it has.
        elements: u64,
    },
    /// Part of a storage.
    Tensor(TensorView),
}

/// A tensor as a file describes it; nothing of it was checked against the storage.
#[derive(Clone, Debug, PartialEq)]
pub struct TensorView {
    /// The storage that it is a part of.
    pub storage: Id,
    /// Numbers of the storage before its first.
    pub offset: u64,
    /// Lengths of the axes.
    pub shape: Vec<u64>,
    /// Numbers from one place of an axis to the next.
    pub strides: Vec<u64>,
}

impl Value {
    /// What it takes beside its place in the arena.
    fn memory(&self) -> usize {
        match self {
            Self::Opaque | Self::Bool(_) | Self::Integer(_) => 0,
            Self::Text(text) | Self::Global(text) => text.capacity(),
            Self::Sequence(items) => items.capacity() * size_of::<Id>(),
            Self::Dictionary(pairs) => pairs.capacity() * size_of::<(Id, Id)>(),
            Self::Storage { kind, key, .. } => kind.capacity() + key.capacity(),
            Self::Tensor(view) => (view.shape.capacity() + view.strides.capacity()) * 8,
        }
    }
}

/// All values of one pickle, and the one it stands for.
#[derive(Debug)]
pub struct Pickle {
    /// All values; others refer to them by place.
    pub values: Vec<Value>,
    /// What the pickle stands for.
    pub root: Id,
    /// Bytes that the pickle took.
    pub length: usize,
}

impl Pickle {
    /// The value at a place.
    pub fn get(&self, id: Id) -> &Value {
        &self.values[id]
    }

    /// The text at a place, if it is one.
    pub fn text(&self, id: Id) -> Option<&str> {
        match self.get(id) {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// The pairs of a dictionary whose keys are texts, in order.
    pub fn entries(&self, id: Id) -> impl Iterator<Item = (&str, Id)> {
        let pairs: &[(Id, Id)] = match self.get(id) {
            Value::Dictionary(pairs) => pairs,
            _ => &[],
        };
        pairs.iter().filter_map(|&(key, value)| Some((self.text(key)?, value)))
    }
}

/// Reads one pickle at the front of `bytes`, whose values are taken from the budget.
///
/// # Errors
/// Where and what is wrong.
pub fn read(bytes: &[u8], budget: &mut Budget) -> Result<Pickle, String> {
    let mut machine = Machine::new(bytes, *budget);
    let root = loop {
        let at = machine.at;
        match machine.step() {
            Ok(None) => {}
            Ok(Some(root)) => break root,
            Err(reason) => return Err(format!("pickle, byte {at}: {reason}")),
        }
    };
    *budget = machine.budget;
    Ok(Pickle { values: machine.values, root, length: machine.at })
}

struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    values: Vec<Value>,
    stack: Vec<Id>,
    /// Heights of the stack.
    marks: Vec<usize>,
    memo: BTreeMap<u64, Id>,
    budget: Budget,
}

type Step<T> = Result<T, String>;

impl<'a> Machine<'a> {
    fn new(bytes: &'a [u8], budget: Budget) -> Self {
        let (values, stack, marks) = (Vec::new(), Vec::new(), Vec::new());
        Self { bytes, at: 0, values, stack, marks, memo: BTreeMap::new(), budget }
    }

    /// Runs one instruction; the result at the end.
    fn step(&mut self) -> Step<Option<Id>> {
        match self.byte()? {
            0x80 => drop(self.take(1)?),         // PROTO
            0x95 => drop(self.take(8)?),         // FRAME
            b'.' => return self.pop().map(Some), // STOP
            b'(' => self.mark()?,                // MARK
            b'N' | b')' | b']' | b'}' | 0x8f | 0x88 | 0x89 => self.constant()?,
            b'K' | b'M' | b'J' | 0x8a | 0x8b | b'I' | b'L' => self.integer()?,
            b'G' => self.skip(8)?, // BINFLOAT
            b'F' => {
                self.line()?;
                self.push(Value::Opaque)?;
            } // FLOAT
            b'X' | 0x8c | 0x8d | b'U' | b'T' | b'V' | b'S' => self.string()?,
            b'C' | b'B' | 0x8e | 0x96 => self.skip_bytes()?,
            b't' | b'l' | 0x85 | 0x86 | 0x87 => self.sequence()?,
            b'd' => self.dictionary()?, // DICT
            b'a' | b'e' => self.append()?,
            b's' | b'u' => self.set_items()?,
            b'1' | 0x90 => {
                let items = self.pop_mark()?;
                self.budget.give_back(size_of_val(&items[..]));
            } // POP_MARK, ADDITEMS
            b'q' | b'r' | b'p' | 0x94 => self.put()?,
            b'h' | b'j' | b'g' => self.get()?,
            b'c' | 0x93 => self.global()?,
            b'R' | 0x81 => self.reduce()?,
            b'0' | b'b' => drop(self.pop()?), // POP, and BUILD: the state of an object, not needed
            b'Q' => self.persistent()?,       // BINPERSID
            other => return Err(format!("opcode {other:#04x} has no place in a weight file")),
        }
        Ok(None)
    }

    fn take(&mut self, count: usize) -> Step<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        if count > rest.len() {
            return Err(format!("{count} bytes expected, {} are left", rest.len()));
        }
        self.at += count;
        Ok(&rest[..count])
    }

    fn byte(&mut self) -> Step<u8> {
        Ok(self.take(1)?[0])
    }

    /// A number of up to 8 bytes, the smallest first.
    fn number(&mut self, bytes: usize) -> Step<u64> {
        let mut all = [0; 8];
        all[..bytes].copy_from_slice(self.take(bytes)?);
        Ok(u64::from_le_bytes(all))
    }

    fn counted(&mut self, bytes: usize) -> Step<&'a [u8]> {
        let count = self.number(bytes)?;
        self.take(usize::try_from(count).unwrap_or(usize::MAX))
    }

    fn line(&mut self) -> Step<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let end = rest.iter().position(|&b| b == b'\n').ok_or("a line does not end")?;
        self.at += end + 1;
        Ok(&rest[..end])
    }

    fn push(&mut self, value: Value) -> Step<()> {
        self.budget.take(value.memory())?;
        self.budget.reserve(&mut self.values, 1)?;
        self.values.push(value);
        self.push_id(self.values.len() - 1)
    }

    fn push_id(&mut self, id: Id) -> Step<()> {
        self.budget.reserve(&mut self.stack, 1)?;
        self.stack.push(id);
        Ok(())
    }

    fn mark(&mut self) -> Step<()> {
        self.budget.reserve(&mut self.marks, 1)?;
        self.marks.push(self.stack.len());
        Ok(())
    }

    fn pop(&mut self) -> Step<Id> {
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= floor {
            return Err("the stack is empty".to_owned());
        }
        self.stack.pop().ok_or_else(|| "the stack is empty".to_owned())
    }

    fn pop_mark(&mut self) -> Step<Vec<Id>> {
        let mark = self.marks.pop().ok_or("there is no mark")?;
        let mark = mark.min(self.stack.len());
        self.budget.take(size_of_val(&self.stack[mark..]))?;
        Ok(self.stack.split_off(mark))
    }

    fn top(&self) -> Step<Id> {
        self.stack.last().copied().ok_or_else(|| "the stack is empty".to_owned())
    }

    fn constant(&mut self) -> Step<()> {
        let value = match self.bytes[self.at - 1] {
            b')' | b']' => Value::Sequence(Vec::new()),
            b'}' => Value::Dictionary(Vec::new()),
            0x88 => Value::Bool(true),
            0x89 => Value::Bool(false),
            _ => Value::Opaque,
        };
        self.push(value)
    }

    fn integer(&mut self) -> Step<()> {
        let value = match self.bytes[self.at - 1] {
            b'K' => self.number(1)? as i64,
            b'M' => self.number(2)? as i64,
            b'J' => i64::from(self.number(4)? as u32 as i32),
            b'I' | b'L' => {
                let line = String::from_utf8_lossy(self.line()?).into_owned();
                match line.trim_end_matches('L') {
                    "00" => return self.push(Value::Bool(false)),
                    "01" => return self.push(Value::Bool(true)),
                    digits => digits.parse().map_err(|_| format!("`{digits}` is no integer"))?,
                }
            }
            long => {
                let bytes = self.counted(if long == 0x8a { 1 } else { 4 })?;
                // Longer numbers (a magic number of 10 bytes) are told apart by nobody here.
                let negative = bytes.last().is_some_and(|b| b & 0x80 != 0);
                let mut all = [if negative { 0xFF } else { 0 }; 8];
                let kept = bytes.len().min(8);
                all[..kept].copy_from_slice(&bytes[..kept]);
                i64::from_le_bytes(all)
            }
        };
        self.push(Value::Integer(value))
    }

    fn skip(&mut self, count: usize) -> Step<()> {
        self.take(count)?;
        self.push(Value::Opaque)
    }

    fn skip_bytes(&mut self) -> Step<()> {
        let width = match self.bytes[self.at - 1] {
            b'C' => 1,
            b'B' => 4,
            _ => 8,
        };
        self.counted(width)?;
        self.push(Value::Opaque)
    }

    fn string(&mut self) -> Step<()> {
        let bytes = match self.bytes[self.at - 1] {
            0x8c | b'U' => self.counted(1)?,
            b'X' | b'T' => self.counted(4)?,
            0x8d => self.counted(8)?,
            b'S' => {
                let line = self.line()?;
                let quoted = line.len() >= 2 && line[0] == line[line.len() - 1];
                if quoted { &line[1..line.len() - 1] } else { line }
            }
            _ => self.line()?,
        };
        // Of a byte that is no UTF-8 three become, in a text that may grow into twice its room.
        let broken = std::str::from_utf8(bytes).is_err();
        self.budget.take(if broken { 9 * bytes.len() } else { 0 })?;
        self.push(Value::Text(String::from_utf8_lossy(bytes).into_owned()))
    }

    fn sequence(&mut self) -> Step<()> {
        let items = match self.bytes[self.at - 1] {
            b't' | b'l' => self.pop_mark()?,
            code => {
                let count = usize::from(code - 0x84);
                let mut items = (0..count).map(|_| self.pop()).collect::<Step<Vec<_>>>()?;
                items.reverse();
                items
            }
        };
        self.push(Value::Sequence(items))
    }

    fn dictionary(&mut self) -> Step<()> {
        let items = self.pop_mark()?;
        self.push(Value::Dictionary(items.chunks_exact(2).map(|p| (p[0], p[1])).collect()))?;
        self.budget.give_back(size_of_val(&items[..]));
        Ok(())
    }

    fn append(&mut self) -> Step<()> {
        let items = match self.bytes[self.at - 1] {
            b'e' => self.pop_mark()?,
            _ => vec![self.pop()?],
        };
        let list = self.top()?;
        if let Value::Sequence(list) = &mut self.values[list] {
            self.budget.reserve(list, items.len())?;
            list.extend(items);
        }
        Ok(())
    }

    fn set_items(&mut self) -> Step<()> {
        let items = if self.bytes[self.at - 1] == b'u' {
            self.pop_mark()?
        } else {
            let value = self.pop()?;
            vec![self.pop()?, value]
        };
        let target = self.top()?;
        if let Value::Dictionary(pairs) = &mut self.values[target] {
            self.budget.reserve(pairs, items.len() / 2)?;
            pairs.extend(items.chunks_exact(2).map(|pair| (pair[0], pair[1])));
        }
        Ok(())
    }

    fn put(&mut self) -> Step<()> {
        let slot = match self.bytes[self.at - 1] {
            0x94 => self.memo.len() as u64,
            _ => self.slot()?,
        };
        let top = self.top()?;
        self.budget.take(MEMO)?;
        self.memo.insert(slot, top);
        Ok(())
    }

    fn get(&mut self) -> Step<()> {
        let slot = self.slot()?;
        let id = self.memo.get(&slot).ok_or_else(|| format!("nothing was stored as {slot}"))?;
        self.push_id(*id)
    }

    fn slot(&mut self) -> Step<u64> {
        match self.bytes[self.at - 1] {
            b'q' | b'h' => self.number(1),
            b'r' | b'j' => self.number(4),
            _ => {
                let line = String::from_utf8_lossy(self.line()?).into_owned();
                line.parse().map_err(|_| format!("`{line}` is no index"))
            }
        }
    }

    fn global(&mut self) -> Step<()> {
        let [module, name] = if self.bytes[self.at - 1] == b'c' {
            let lines = [self.line()?, self.line()?];
            lines.map(|line| String::from_utf8_lossy(line).into_owned())
        } else {
            let (name, module) = (self.pop()?, self.pop()?);
            [module, name].map(|id| match &self.values[id] {
                Value::Text(text) => text.chars().take(LONGEST_NAME + 1).collect(),
                _ => String::new(),
            })
        };
        // Names are copied: a long one, named often, must not fill the memory.
        if module.len() + name.len() > LONGEST_NAME {
            return Err(format!("a name of {} bytes", module.len() + name.len()));
        }
        self.push(Value::Global(format!("{module}.{name}")))
    }

    /// A call, of which only those that make weights mean anything.
    fn reduce(&mut self) -> Step<()> {
        let (arguments, function) = (self.pop()?, self.pop()?);
        let name = match &self.values[function] {
            Value::Global(name) => name.as_str(),
            _ => "",
        };
        let arguments: &[Id] = match &self.values[arguments] {
            Value::Sequence(items) => items,
            _ => &[],
        };
        let value = match name {
            "collections.OrderedDict" | "builtins.dict" => Value::Dictionary(Vec::new()),
            "torch._utils._rebuild_tensor" | "torch._utils._rebuild_tensor_v2" => {
                self.tensor(arguments).map_or(Value::Opaque, Value::Tensor)
            }
            "torch._utils._rebuild_parameter" | "torch._utils._rebuild_parameter_with_state" => {
                // The tensor that the parameter wraps, under the same index.
                let Some(&inner) = arguments.first() else {
                    return Err("a call lacks its argument".into());
                };
                return self.push_id(inner);
            }
            _ => Value::Opaque,
        };
        self.push(value)
    }

    /// `(storage, offset, size, stride, ..)`.
    fn tensor(&self, arguments: &[Id]) -> Option<TensorView> {
        let &[storage, offset, shape, strides, ..] = arguments else { return None };
        let Value::Storage { .. } = self.values[storage] else { return None };
        let whole = |id: Id| match self.values[id] {
            Value::Integer(n) => u64::try_from(n).ok(),
            _ => None,
        };
        let all = |id: Id| match &self.values[id] {
            // The limit bounds what many tensors with one shared shape could take.
            Value::Sequence(items) if items.len() <= 16 => {
                items.iter().map(|&id| whole(id)).collect::<Option<Vec<_>>>()
            }
            _ => None,
        };
        let (shape, strides) = (all(shape)?, all(strides)?);
        (shape.len() == strides.len()).then_some(TensorView {
            storage,
            offset: whole(offset)?,
            shape,
            strides,
        })
    }

    /// `('storage', type, key, location, elements, ..)`.
    fn persistent(&mut self) -> Step<()> {
        let id = self.pop()?;
        let items: &[Id] = match &self.values[id] {
            Value::Sequence(items) => items,
            _ => &[],
        };
        let value = match items {
            [_, kind, key, _, elements, ..] => {
                match [*kind, *key, *elements].map(|id| &self.values[id]) {
                    [Value::Global(kind), Value::Text(key), Value::Integer(n)]
                        if key.len() <= LONGEST_NAME =>
                    {
                        Value::Storage {
                            kind: kind.rsplit('.').next().unwrap_or_default().to_owned(),
                            key: key.clone(),
                            elements: u64::try_from(*n).unwrap_or(0),
                        }
                    }
                    _ => Value::Opaque,
                }
            }
            _ => Value::Opaque,
        };
        self.push(value)
    }
}
