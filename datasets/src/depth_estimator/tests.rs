//! What models of a few bytes say about images.

use super::*;
use crate::network::NetworkProblem;
use crate::network::tiny::{Message, ints, model, node, saved, tensor, value_info};

/// Red that grows to the right; green and blue constant.
fn picture(height: usize, width: usize) -> ByteImage {
    let pixel = |p: usize| [(255 * (p % width) / (width - 1)) as u8, 51, 0];
    ByteImage { height, width, channels: 3, data: (0..height * width).flat_map(pixel).collect() }
}

fn normalized(input: &DepthInput, value: f32, c: usize) -> f32 {
    (value - input.mean[c]) / input.deviation[c]
}

/// Channels come in the order and normalisation of the convention, and back at the size of the image.
#[test]
fn a_model_sees_what_it_was_trained_on() {
    let folder = tempfile::tempdir().unwrap();
    for input in [DepthInput::midas_small(), DepthInput::midas_dpt(), DepthInput::depth_anything()]
    {
        let path = saved(&folder, &model(&[1, 3, 0, 0], [0.0, 2.0, -1.0], 0.25, 1, &[]));
        let estimator = DepthEstimator::open(&path, input).unwrap();
        let found = estimator.estimate(&picture(40, 60)).unwrap();
        assert_eq!((found.height, found.width), (40, 60));
        let expected = 2.0 * normalized(&input, 0.2, 1) - normalized(&input, 0.0, 2) + 0.25;
        assert!(found.data.iter().all(|v| (v - expected).abs() < 1e-4), "{input:?}");

        let path = saved(&folder, &model(&[0, 3, 0, 0], [1.0, 0.0, 0.0], 0.0, 1, &[]));
        let found = DepthEstimator::open(&path, input).unwrap().estimate(&picture(40, 60)).unwrap();
        for i in [0, 17, 39] {
            for j in 4..56 {
                let value = found.data[i * 60 + j];
                let expected = normalized(&input, j as f32 / 59.0, 0);
                assert!((value - expected).abs() < 0.1, "{i} {j} {value} {expected}");
            }
        }
    }
}

/// Answers at half the size, without the axis of channels, as Depth Anything's.
#[test]
fn answers_of_other_forms_and_sizes() {
    let folder = tempfile::tempdir().unwrap();
    let squeeze = node("Squeeze", &["sum"], "depth", &[ints("axes", &[1])]);
    let path = saved(&folder, &model(&[1, 3, 0, 0], [1.0, 0.0, 0.0], 0.0, 2, &[squeeze]));
    let estimator = DepthEstimator::open(&path, DepthInput::depth_anything()).unwrap();
    let found = estimator.estimate(&picture(30, 45)).unwrap();
    assert_eq!((found.height, found.width), (30, 45));
    assert!(found.data.windows(2).take(40).all(|two| two[0] <= two[1] + 1e-3));
    // Grey is colour too.
    let gray = ByteImage { height: 9, width: 9, channels: 1, data: vec![128; 81] };
    assert!(estimator.estimate(&gray).unwrap().data.iter().all(|v| v.is_finite()));
}

#[test]
fn a_size_in_the_file_wins() {
    let folder = tempfile::tempdir().unwrap();
    let path = saved(&folder, &model(&[1, 3, 64, 96], [1.0; 3], 0.0, 1, &[]));
    let estimator = DepthEstimator::open(&path, DepthInput::midas()).unwrap();
    assert!(format!("{estimator:?}").contains("Some(64), Some(96)"));
    assert_eq!(estimator.estimate(&picture(10, 20)).unwrap().data.len(), 200);
}

#[test]
fn errors_name_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let open = |bytes: &[u8]| {
        let error = DepthEstimator::open(saved(&folder, bytes), DepthInput::midas()).unwrap_err();
        assert!(error.to_string().contains("tiny.onnx"), "{error}");
        error.problem
    };
    assert!(matches!(open(b"not a model"), NetworkProblem::Load(_)));
    assert!(matches!(open(b""), NetworkProblem::Load(_) | NetworkProblem::Input { .. }));
    let gray = model(&[1, 1, 32, 32], [1.0; 3], 0.0, 1, &[]);
    let problem = open(&gray);
    assert!(problem.to_string().contains("[1, 1, 32, 32]"), "{problem}");
    let flat = model(&[3, 64], [1.0; 3], 0.0, 1, &[]);
    assert!(matches!(open(&flat), NetworkProblem::Input { .. }));
    let missing = DepthEstimator::open(folder.path().join("none.onnx"), DepthInput::midas());
    let missing = missing.unwrap_err();
    assert!(matches!(missing.problem, NetworkProblem::Io(_)), "{missing}");

    // An answer that is one number.
    let mean = node("GlobalAveragePool", &["sum"], "mean", &[]);
    let squeeze = node("Squeeze", &["mean"], "depth", &[ints("axes", &[0, 1, 2, 3])]);
    let path = saved(&folder, &model(&[1, 3, 0, 0], [1.0; 3], 0.0, 1, &[mean, squeeze]));
    let estimator = DepthEstimator::open(path, DepthInput::midas()).unwrap();
    let error = estimator.estimate(&picture(8, 8)).unwrap_err();
    assert!(matches!(error.problem, NetworkProblem::Output { .. }), "{error}");
}

/// Bytes changed and cut anywhere: an error or a model, never a panic.
#[test]
fn damaged_models() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = model(&[1, 3, 0, 0], [1.0; 3], 0.0, 1, &[]);
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x55;
        let _ = DepthEstimator::open(saved(&folder, &damaged), DepthInput::midas());
        let _ = DepthEstimator::open(saved(&folder, &bytes[..at]), DepthInput::midas());
    }
}

/// A graph whose field of an unknown number is so long that behind it lie the bytes before it: the
/// runtime's own sum wraps around, and it reads the same nodes for ever.
fn endless() -> Vec<u8> {
    let node = node("Relu", &["picture"], "depth", &[]);
    let mut graph = Message::default().message(1, &node).0;
    graph.extend([0x7a]);
    let back = graph.len() as u64 + 10;
    let mut length = Message::default();
    length.varint(back.wrapping_neg());
    graph.extend(length.0);
    Message::default().int(1, 7).bytes(7, &graph).0
}

/// A model that makes a constant of `sizes`, 60 bytes beside its names.
fn grown(op: &str, sizes: &[u64]) -> Vec<u8> {
    let dims = Message::default().int(1, sizes.len() as u64).int(2, 7);
    let shape = sizes.iter().fold(dims, |m, &n| m.int(7, n)).bytes(8, b"s");
    let graph = Message::default()
        .message(1, &node(op, &["s"], "o", &[]))
        .message(5, &shape)
        .message(11, &value_info("x", &[]))
        .message(12, &value_info("o", &[]));
    let opset = Message::default().bytes(1, b"").int(2, 12);
    Message::default().int(1, 7).message(7, &graph).message(8, &opset).0
}

#[test]
fn files_of_a_few_bytes_end_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let open = |bytes: &[u8]| {
        let start = std::time::Instant::now();
        let found = DepthEstimator::open(saved(&folder, bytes), DepthInput::midas_small());
        let taken = start.elapsed();
        assert!(taken.as_secs() < 5, "{} bytes: {taken:?}", bytes.len());
        found.map_err(|error| error.to_string())
    };
    assert!(endless().len() < 80);
    let error = open(&endless()).unwrap_err();
    assert!(error.contains("tiny.onnx") && error.contains("a field claims"), "{error}");
    for sizes in [&[1 << 31][..], &[1 << 15, 1 << 15], &[u64::MAX, 1 << 40], &[1 << 20; 3]] {
        let bytes = grown("ConstantOfShape", sizes);
        assert!(bytes.len() < 120, "{}", bytes.len());
        // Whether it can be opened is one thing; what it asks for is not made for that.
        let _ = open(&bytes);
    }
    // Twice as many, forty times.
    let double = |k: u64| {
        node(
            "Concat",
            &[format!("c{k}").as_str(); 2],
            &format!("c{}", k + 1),
            &[Message::default().bytes(1, b"axis").int(3, 0).int(20, 2)],
        )
    };
    let nodes: Vec<Message> = (0..40).map(double).collect();
    let graph = nodes.iter().fold(Message::default(), |m, n| m.message(1, n));
    let graph =
        graph.message(5, &tensor("c0", &[2], &[1.0; 2])).message(12, &value_info("c40", &[]));
    let _ = open(&Message::default().int(1, 7).message(7, &graph).0);
    // Types of sequences of sequences, as deep as the file is long.
    let mut deep = Message::default();
    for _ in 0..3000 {
        deep = Message::default().message(4, &Message::default().message(1, &deep));
    }
    let info = Message::default().bytes(1, b"x").message(2, &deep);
    let graph = Message::default().message(11, &info);
    let error = open(&Message::default().int(1, 7).message(7, &graph).0).unwrap_err();
    assert!(error.contains("deep"), "{error}");
}

#[test]
fn constants_of_a_usual_size_are_computed_while_loading() {
    let small = |bytes: &[u8]| !crate::network::check::check(bytes).unwrap().constants_may_grow;
    assert!(small(&model(&[1, 3, 0, 0], [0.0, 2.0, -1.0], 0.25, 1, &[])));
    assert!(small(&grown("ConstantOfShape", &[3, 4, 5])));
    assert!(!small(&grown("ConstantOfShape", &[1 << 20; 2])));
    assert!(!small(&grown("Range", &[3])));
}

#[test]
fn a_pipe_is_no_model() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe.onnx");
    if std::process::Command::new("mkfifo").arg(&path).status().is_ok_and(|s| s.success()) {
        let error = DepthEstimator::open(&path, DepthInput::midas_small()).unwrap_err();
        assert!(error.to_string().contains("a pipe"), "{error}");
    }
}
