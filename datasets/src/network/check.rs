//! What a model's file is held to before the runtime sees it.
//!
//! The runtime believes lengths: one that wraps around leads it back to bytes that it has read, and
//! it reads them for ever. It also runs, while it loads, all that depends on constants alone, which
//! a few bytes can let grow beyond any memory. So the messages are walked here first. A length that
//! leaves its message is an error. A model whose constants may grow is not: it is loaded as it
//! stands, and what it asks for is asked when it is run.

use std::collections::{BTreeMap, BTreeSet};

use mesh_core::{Budget, Limits};

use super::wire::{Fields, Value, numbers};

/// How deep messages may lie in each other; a model without graphs in its operators has eight levels.
const DEPTH: usize = 64;
/// How many numbers, beside four for each byte of the file, all may have that is computed of constants.
const NUMBERS: u64 = 1 << 26;
/// What the runtime makes of a message, and of a number that stands in one as a list.
const MESSAGE: u64 = 600;
const NUMBER: u64 = 24;

/// What was found in a sound file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Checked {
    /// Whether something that follows from constants may be too large to be computed while loading.
    pub(crate) constants_may_grow: bool,
    /// The files beside the model's that hold its weights.
    pub(super) external: Vec<String>,
}

/// Messages that the runtime reads, and those in them by the number of their field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Message {
    Model,
    Graph,
    Node,
    Attribute,
    Tensor,
    ValueInfo,
    Type,
    TensorType,
    SequenceType,
    Shape,
    Metadata,
    Pair,
    Dimension,
}

impl Message {
    fn field(self, number: u64) -> Option<Self> {
        Some(match (self, number) {
            (Self::Model, 7) | (Self::Attribute, 6) => Self::Graph,
            (Self::Model, 14) => Self::Metadata,
            (Self::Tensor, 13) => Self::Pair,
            (Self::Graph, 1) => Self::Node,
            (Self::Graph | Self::Attribute, 5) => Self::Tensor,
            (Self::Graph, 11..=13) => Self::ValueInfo,
            (Self::Node, 5) => Self::Attribute,
            (Self::ValueInfo, 2) | (Self::SequenceType, 1) => Self::Type,
            (Self::Type, 1) => Self::TensorType,
            (Self::Type, 4) => Self::SequenceType,
            (Self::TensorType, 2) => Self::Shape,
            (Self::Shape, 1) => Self::Dimension,
            _ => return None,
        })
    }
}

/// Walks a model.
///
/// # Errors
/// What is wrong with its messages, or that the runtime would take more memory for them than a file
/// of this length may.
pub(crate) fn check(bytes: &[u8]) -> Result<Checked, String> {
    let length = bytes.len() as u64;
    let mut walk = Walk {
        budget: Limits::default().budget(length),
        numbers: NUMBERS.saturating_add(length.saturating_mul(4)),
        found: Checked::default(),
    };
    walk.message(Message::Model, bytes, 0)?;
    Ok(walk.found)
}

struct Walk {
    budget: Budget,
    /// How many numbers may follow from constants.
    numbers: u64,
    found: Checked,
}

impl Walk {
    fn message(&mut self, message: Message, bytes: &[u8], depth: usize) -> Result<(), String> {
        if depth > DEPTH {
            return Err(format!("its messages lie more than {DEPTH} deep in each other"));
        }
        self.budget.take(MESSAGE).map_err(|limit| limit.to_string())?;
        let mut location = false;
        let mut fields = Fields::new(bytes);
        while let Some((number, value)) = fields.next()? {
            let Value::Bytes(inner) = value else { continue };
            if let Some(kind) = message.field(number) {
                self.message(kind, inner, depth + 1)?;
            }
            match (message, number) {
                (Message::Tensor, 5 | 7) => {
                    let most = (inner.len() as u64).saturating_mul(NUMBER);
                    self.budget.take(most).map_err(|limit| limit.to_string())?;
                }
                (Message::Pair, 1) => location = inner == b"location",
                (Message::Pair, 2) if location => {
                    self.found.external.push(String::from_utf8_lossy(inner).into_owned());
                }
                _ => {}
            }
        }
        // Graphs in operators see the constants of those around them: they are not followed there.
        if message == Message::Graph {
            self.found.constants_may_grow |= depth > 1 || constants_may_grow(bytes, self.numbers)?;
        }
        Ok(())
    }
}

/// What is known of a value that follows from constants alone.
#[derive(Clone, Debug)]
struct Constant {
    /// At most so many numbers.
    count: u64,
    /// The lengths of its axes, where they are known.
    shape: Option<Vec<u64>>,
    /// Its numbers, where they stand in the file and are few.
    numbers: Option<Vec<u64>>,
}

impl Constant {
    fn of_count(count: u64) -> Self {
        Self { count, shape: None, numbers: None }
    }

    fn of_shape(shape: Vec<u64>) -> Self {
        let count = shape.iter().fold(1_u64, |n, &axis| n.saturating_mul(axis));
        Self { count, shape: Some(shape), numbers: None }
    }
}

/// One operator.
#[derive(Default)]
struct Node<'a> {
    inputs: Vec<&'a [u8]>,
    outputs: Vec<&'a [u8]>,
    op: &'a [u8],
    /// The constant that a `Constant` holds.
    constant: Option<Constant>,
}

/// Whether all that follows from constants alone may have more numbers than these.
fn constants_may_grow(graph: &[u8], mut numbers: u64) -> Result<bool, String> {
    let mut known: BTreeMap<&[u8], Constant> = BTreeMap::new();
    let mut nodes = Vec::new();
    let mut fields = Fields::new(graph);
    while let Some((number, value)) = fields.next()? {
        match (number, value) {
            (5, Value::Bytes(tensor)) => {
                let (name, constant) = read_tensor(tensor)?;
                if known.insert(name, constant).is_some() {
                    return Ok(true);
                }
            }
            (1, Value::Bytes(node)) => nodes.push(read_node(node)?),
            _ => {}
        }
    }
    // The standard wants operators in the order in which they are computed, and each name once.
    // What is otherwise can not be followed so simply.
    let outputs = nodes.iter().flat_map(|node| &node.outputs).filter(|name| !name.is_empty());
    let mut later: BTreeSet<&[u8]> = outputs.copied().collect();
    for node in &nodes {
        let named = |name: &&&[u8]| !name.is_empty();
        if node.inputs.iter().any(|name| later.contains(name)) {
            return Ok(true);
        }
        let inputs: Option<Vec<&Constant>> =
            node.inputs.iter().filter(named).map(|name| known.get(name)).collect();
        let constant = match (node.op, inputs) {
            (b"Constant", _) => node.constant.clone(),
            // The lengths of axes may stand in the file, whoever has the numbers.
            (b"Shape" | b"Size", _) => Some(Constant::of_count(DEPTH as u64)),
            (op, Some(inputs)) => Some(made(op, &inputs)),
            (_, None) => None,
        };
        for name in node.outputs.iter().filter(named) {
            if !later.remove(name) {
                return Ok(true);
            }
            let Some(constant) = &constant else { continue };
            let Some(left) = numbers.checked_sub(constant.count) else { return Ok(true) };
            numbers = left;
            if known.insert(name, constant.clone()).is_some() {
                return Ok(true);
            }
        }
    }
    Ok(false)
}

/// What an operator can make of constants; `u64::MAX` numbers where nobody knows.
fn made(op: &[u8], inputs: &[&Constant]) -> Constant {
    let counts = || inputs.iter().map(|input| input.count.max(1));
    let first = inputs.first().map_or(1, |input| input.count.max(1));
    let shape_of_first = inputs.first().and_then(|input| input.shape.clone());
    Constant::of_count(match op {
        b"Identity" | b"Cast" | b"Neg" | b"Abs" | b"Sqrt" | b"Exp" | b"Log" | b"Erf" | b"Floor"
        | b"Ceil" | b"Round" | b"Reciprocal" | b"Sigmoid" | b"Tanh" | b"Relu" | b"Sin" | b"Cos"
        | b"Not" | b"Clip" | b"Softmax" | b"CumSum" | b"DequantizeLinear" | b"QuantizeLinear" => {
            return Constant { count: first, shape: shape_of_first, numbers: None };
        }
        b"Add" | b"Sub" | b"Mul" | b"Div" | b"Pow" | b"Mod" | b"Where" | b"Equal" | b"Greater"
        | b"GreaterOrEqual" | b"Less" | b"LessOrEqual" | b"And" | b"Or" | b"Xor" | b"Min"
        | b"Max" => match broadcast(inputs) {
            Some(shape) => return Constant::of_shape(shape),
            None => counts().fold(1, u64::saturating_mul),
        },
        // As many as the first, or fewer.
        b"Reshape" | b"Transpose" | b"Unsqueeze" | b"Squeeze" | b"Flatten" | b"Slice"
        | b"Split" | b"ReduceMean" | b"ReduceSum" | b"ReduceMax" | b"ReduceMin" | b"ReduceProd" => {
            first
        }
        b"Concat" => counts().fold(0, u64::saturating_add),
        // The lengths of the axes that are asked for.
        b"ConstantOfShape" => lengths(inputs.first()),
        b"Expand" | b"Tile" => lengths(inputs.get(1)).saturating_mul(first),
        // These make at most a number of each combination of those that they are given.
        b"Gather" | b"GatherElements" | b"GatherND" | b"ScatterND" | b"ScatterElements"
        | b"MatMul" | b"Gemm" | b"Trilu" => counts().fold(1, u64::saturating_mul),
        // How much others make depends on numbers that were not read.
        _ => u64::MAX,
    })
}

/// The axes of what is combined number by number.
fn broadcast(inputs: &[&Constant]) -> Option<Vec<u64>> {
    let mut out: Vec<u64> = Vec::new();
    for input in inputs {
        let shape = input.shape.as_ref()?;
        // Axes are aligned at their ends.
        let more = shape.len().saturating_sub(out.len());
        out.splice(0..0, std::iter::repeat_n(1, more));
        let skipped = out.len() - shape.len();
        for (axis, &length) in out[skipped..].iter_mut().zip(shape) {
            *axis = length.max(*axis);
        }
    }
    Some(out)
}

/// The product of numbers that say how long axes are.
fn lengths(input: Option<&&Constant>) -> u64 {
    let numbers = input.and_then(|input| input.numbers.as_ref());
    // Negative ones are large here, and no lengths in any case.
    numbers.map_or(u64::MAX, |n| n.iter().fold(1_u64, |n, &axis| n.saturating_mul(axis)))
}

fn read_node(bytes: &[u8]) -> Result<Node<'_>, String> {
    let mut node = Node::default();
    let mut fields = Fields::new(bytes);
    while let Some((number, value)) = fields.next()? {
        let Value::Bytes(value) = value else { continue };
        match number {
            1 => node.inputs.push(value),
            2 => node.outputs.push(value),
            4 => node.op = value,
            5 => read_attribute(value, &mut node)?,
            _ => {}
        }
    }
    Ok(node)
}

fn read_attribute<'a>(bytes: &'a [u8], node: &mut Node<'a>) -> Result<(), String> {
    let (mut count, mut list) = (0_u64, Vec::new());
    let mut fields = Fields::new(bytes);
    while let Some((number, value)) = fields.next()? {
        match (number, value) {
            (5, Value::Bytes(tensor)) => node.constant = Some(read_tensor(tensor)?.1),
            (3 | 8, value) => numbers(value).for_each(|n| {
                count += 1;
                if list.len() < DEPTH {
                    list.push(n);
                }
            }),
            (2 | 7, _) => count += 1,
            _ => {}
        }
    }
    if node.constant.is_none() {
        let numbers = (list.len() as u64 == count).then_some(list);
        node.constant = Some(Constant { count, shape: None, numbers });
    }
    Ok(())
}

/// The name of a tensor, and what is known of it.
fn read_tensor(bytes: &[u8]) -> Result<(&[u8], Constant), String> {
    const INT64: u64 = 7;
    let (mut name, mut kind, mut raw) = (&[][..], 0, None);
    let (mut shape, mut list) = (Vec::new(), Vec::new());
    let mut fields = Fields::new(bytes);
    while let Some((number, value)) = fields.next()? {
        match (number, value) {
            // Each field once, or all axes packed into one.
            (1, value) => shape.extend(numbers(value).take(DEPTH)),
            (2, Value::Number(n)) => kind = n,
            (5 | 7, value) => list.extend(numbers(value).take(DEPTH - list.len().min(DEPTH))),
            (8, Value::Bytes(text)) => name = text,
            (9, Value::Bytes(data)) => raw = Some(data),
            _ => {}
        }
    }
    if let (Some(raw), INT64) = (raw, kind) {
        list = raw.as_chunks().0.iter().take(DEPTH).map(|b| u64::from_le_bytes(*b)).collect();
    }
    let constant = Constant::of_shape(shape);
    let numbers = (list.len() as u64 == constant.count).then_some(list);
    Ok((name, Constant { numbers, ..constant }))
}
