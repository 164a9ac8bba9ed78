//! What models in ONNX's form are held to before the runtime sees them.
#![allow(dead_code, reason = "of what is checked nothing is used")]

#[path = "../../datasets/src/network/check.rs"]
mod check;
#[path = "../../datasets/src/network/wire.rs"]
mod wire;

pub(crate) fn model(bytes: &[u8]) {
    let _ = check::check(bytes);
}

/// A field of a message.
fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
    [&[number << 3 | 2, bytes.len() as u8], bytes].concat()
}

pub(crate) fn seeds() -> Vec<Vec<u8>> {
    let node = |op: &[u8], inputs: &[&[u8]], output: &[u8]| {
        let inputs: Vec<u8> = inputs.iter().flat_map(|input| field(1, input)).collect();
        field(1, &[inputs, field(2, output), field(4, op)].concat())
    };
    let shape = field(5, &[&[8, 2, 16, 7, 56, 3, 56, 4][..], &field(8, b"s")].concat());
    let info = field(11, &[field(1, b"x"), field(2, &field(1, &[8, 1]))].concat());
    let constant = {
        let tensor = field(5, &[8, 1, 16, 1, 0x25, 0, 0, 0x80, 0x3f]);
        let attribute = field(5, &[field(1, b"value"), tensor].concat());
        field(1, &[field(2, b"c"), field(4, b"Constant"), attribute].concat())
    };
    let graph = [
        constant,
        node(b"ConstantOfShape", &[b"s"], b"o"),
        node(b"Mul", &[b"o", b"c"], b"p"),
        node(b"Concat", &[b"p", b"x"], b"q"),
        shape,
        info,
        field(12, &field(1, b"q")),
    ]
    .concat();
    vec![[&[8, 7][..], &field(7, &graph), &field(14, &field(1, b"k"))].concat()]
}
