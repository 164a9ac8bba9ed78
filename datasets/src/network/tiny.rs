//! Models of a few bytes, written here for tests.

use std::path::PathBuf;

/// Fields of a message in the wire format of protocol buffers.
#[derive(Clone, Default)]
pub(crate) struct Message(pub(crate) Vec<u8>);

impl Message {
    pub(crate) fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    pub(crate) fn int(mut self, field: u64, value: u64) -> Self {
        self.varint(field << 3);
        self.varint(value);
        self
    }

    pub(crate) fn bytes(mut self, field: u64, value: &[u8]) -> Self {
        self.varint(field << 3 | 2);
        self.varint(value.len() as u64);
        self.0.extend(value);
        self
    }

    pub(crate) fn message(self, field: u64, value: &Self) -> Self {
        self.bytes(field, &value.0)
    }
}

const FLOAT: u64 = 1;

/// `ValueInfoProto` of floats; 0 stands for an axis of any length.
pub(crate) fn value_info(name: &str, shape: &[u64]) -> Message {
    let axes = shape.iter().fold(Message::default(), |axes, &n| {
        let axis = Message::default();
        let axis = if n > 0 { axis.int(1, n) } else { axis.bytes(2, b"any") };
        axes.message(1, &axis)
    });
    let tensor = Message::default().int(1, FLOAT).message(2, &axes);
    Message::default().bytes(1, name.as_bytes()).message(2, &Message::default().message(1, &tensor))
}

/// `TensorProto` of floats.
pub(crate) fn tensor(name: &str, shape: &[u64], values: &[f32]) -> Message {
    let raw: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let dims = shape.iter().fold(Message::default(), |m, &n| m.int(1, n));
    dims.int(2, FLOAT).bytes(8, name.as_bytes()).bytes(9, &raw)
}

/// `NodeProto`.
pub(crate) fn node(op: &str, inputs: &[&str], output: &str, attributes: &[Message]) -> Message {
    let node = inputs.iter().fold(Message::default(), |m, i| m.bytes(1, i.as_bytes()));
    let node = node.bytes(2, output.as_bytes()).bytes(4, op.as_bytes());
    attributes.iter().fold(node, |m, a| m.message(5, a))
}

/// `AttributeProto` of integers.
pub(crate) fn ints(name: &str, values: &[u64]) -> Message {
    let attribute = Message::default().bytes(1, name.as_bytes());
    values.iter().fold(attribute, |m, &v| m.int(8, v)).int(20, 7)
}

/// A weighted sum of the channels plus a constant, `strides` pixels each way left out, then perhaps more nodes.
pub(crate) fn model(
    input: &[u64],
    weights: [f32; 3],
    constant: f32,
    stride: u64,
    more: &[Message],
) -> Vec<u8> {
    let conv = node(
        "Conv",
        &["picture", "weights", "constant"],
        if more.is_empty() { "depth" } else { "sum" },
        &[ints("kernel_shape", &[1, 1]), ints("strides", &[stride, stride])],
    );
    let graph = more.iter().fold(Message::default().message(1, &conv), |m, n| m.message(1, n));
    let graph = graph
        .bytes(2, b"tiny")
        .message(5, &tensor("weights", &[1, 3, 1, 1], &weights))
        .message(5, &tensor("constant", &[1], &[constant]))
        .message(11, &value_info("picture", input))
        .message(12, &value_info("depth", &[]));
    let opset = Message::default().bytes(1, b"").int(2, 12);
    Message::default().int(1, 7).message(7, &graph).message(8, &opset).0
}

pub(crate) fn saved(folder: &tempfile::TempDir, bytes: &[u8]) -> PathBuf {
    let path = folder.path().join("tiny.onnx");
    std::fs::write(&path, bytes).unwrap();
    path
}
