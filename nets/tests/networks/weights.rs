//! Files that PyTorch wrote, and files that nobody should have written.

use autodiff_lite::state::{State, save};
use autodiff_lite::{ConvGeometry, Module, Param, impl_module};
use ndarray::ArrayD;
use nets::{Conv2d, Init, LoadWeights, WeightsError, read_weights, weights_from_bytes};

fn fixture(name: &str) -> std::path::PathBuf {
    std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

/// Element i of the k-th array, as `make.py` has it.
fn ruled(k: usize, i: usize) -> f64 {
    k as f64 + i as f64 / 8.0 - 1.0
}

fn assert_array(state: &State, name: &str, shape: &[usize], expected: impl Fn(usize) -> f64) {
    let found = state.array::<f64>(name).unwrap_or_else(|| panic!("{name} is missing"));
    assert_eq!(found.shape(), shape, "{name}");
    for (i, &x) in found.iter().enumerate() {
        assert_eq!(x, expected(i), "{name}, element {i}");
    }
}

#[test]
fn both_layouts_of_pytorch_are_read() {
    for (file, prefix) in [("tiny.pth", ""), ("tiny_old.pth", ""), ("checkpoint.pth", "module.")] {
        let state = read_weights(fixture(file)).unwrap();
        let name = |name: &str| format!("{prefix}{name}");
        assert_array(&state, &name("conv.weight"), &[2, 3, 1, 2], |i| ruled(0, i));
        assert_array(&state, &name("conv.bias"), &[2], |i| ruled(1, i));
        assert_array(&state, &name("half"), &[3], |i| ruled(2, i));
        assert_array(&state, &name("bfloat"), &[3], |i| ruled(3, i));
        assert_array(&state, &name("double"), &[2, 2], |i| ruled(4, i));
        // The transpose of a 4 x 3 array: element (r, c) is number 3 c + r.
        assert_array(&state, &name("transposed"), &[3, 4], |i| ruled(5, 3 * (i % 4) + i / 4));
        assert_array(&state, &name("shared"), &[4], |i| ruled(5, i + 3));
        assert_array(&state, &name("scalar"), &[], |_| ruled(6, 0));
        // Whole numbers are listed and not read.
        assert!(state.names().any(|n| n == name("bn.num_batches_tracked")));
        assert_eq!(state.names().count(), 9);
    }
}

#[derive(Clone)]
struct Model {
    conv: Conv2d,
    half: Param,
    absent: Option<Param>,
}
impl_module!(Model: f32 { conv, half, absent });

fn model() -> Model {
    let conv = Conv2d::new(&Init::new(0).at("conv"), 3, 2, 1, ConvGeometry::new());
    let weight = Param::new(ArrayD::zeros(vec![2, 3, 1, 2]));
    let half = Param::new(ArrayD::zeros(vec![3]));
    Model { conv: Conv2d { weight, ..conv }, half, absent: None }
}

fn mismatch(error: WeightsError) -> autodiff_lite::state::Mismatch {
    match error {
        WeightsError::Mismatch { mismatch, .. } => mismatch,
        other => panic!("{other}"),
    }
}

#[test]
fn names_are_mapped_and_all_differences_reported() {
    let path = fixture("checkpoint.pth");
    let mut plain = model();
    let report = LoadWeights::partial().map("module.=").unwrap().load(&path, &mut plain).unwrap();
    assert_eq!(report.unexpected.len(), 5, "{report}");
    assert_eq!(plain.half.as_slice(), [1.0, 1.125, 1.25]);

    let mut other = model();
    other.absent = Some(Param::new(ArrayD::zeros(vec![1])));
    other.half = Param::new(ArrayD::zeros(vec![5, 2]));
    let before = other.clone();
    let strict = LoadWeights::strict().map("module.=").unwrap();
    let error = strict.load(&path, &mut other).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("checkpoint.pth does not fit the model"), "{text}");
    assert!(
        text.contains("missing absent") && text.contains("unexpected bfloat, double"),
        "{text}"
    );
    assert!(text.contains("half is [3] instead of [5, 2]"), "{text}");
    assert_eq!(mismatch(error).unexpected.len(), 5);
    assert_eq!(other.conv.weight.value, before.conv.weight.value, "nothing was loaded");

    let lenient = LoadWeights::lenient().map("module.=").unwrap();
    let report = lenient.load(&path, &mut other).unwrap();
    assert_eq!((report.missing.len(), report.different.len()), (1, 1));
    assert_eq!(other.conv.weight.as_slice()[1], 0.125 - 1.0);

    let partial = LoadWeights::partial().map("module.=").unwrap();
    let found = mismatch(partial.load(&path, &mut other).unwrap_err());
    assert!(found.unexpected.is_empty(), "what is allowed is no complaint");
    let twice = LoadWeights::strict().map("module.half=a,module.bfloat=a").unwrap();
    let text = twice.load(&path, &mut other).unwrap_err().to_string();
    assert!(text.contains("two arrays are called a"), "{text}");
}

#[test]
fn safetensors_go_the_same_way() {
    let folder = std::env::temp_dir().join(format!("nets-weights-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("a.safetensors");
    let mut source = model();
    source.half.as_slice_mut().copy_from_slice(&[4.0, 5.0, 6.0]);
    save(&path, &source).unwrap();
    let mut target = model();
    let report = LoadWeights::strict().load(&path, &mut target).unwrap();
    assert!(report.missing.is_empty());
    assert_eq!(target.half.value, source.half.value);
    assert_eq!(target.parameter_count(), 12 + 2 + 3);
    std::fs::remove_dir_all(&folder).unwrap();
    let error = LoadWeights::strict().load(&path, &mut target).unwrap_err();
    assert!(error.to_string().contains("cannot read"), "{error}");
}

/// Every cut and many flipped bytes of each file end in an answer.
#[test]
fn no_bytes_make_it_panic() {
    let mut survivors = 0;
    for file in ["tiny.pth", "tiny_old.pth", "checkpoint.pth"] {
        let bytes = std::fs::read(fixture(file)).unwrap();
        for end in (0..bytes.len()).step_by(7) {
            survivors += usize::from(weights_from_bytes(&bytes[..end]).is_ok());
        }
        for at in 0..bytes.len().min(6000) {
            let mut damaged = bytes.clone();
            for value in [0xFF, damaged[at] ^ 1, b'R', b'h'] {
                damaged[at] = value;
                let _ = weights_from_bytes(&damaged);
            }
        }
    }
    // A cut archive has lost its directory, a cut sequence its storages.
    assert!(survivors <= 3, "{survivors} cut files were read");
}

/// Claims of sizes that the bytes do not bear out.
#[test]
fn claims_are_not_believed() {
    let claim = |size: &[u8], stride: &[u8], numel: u32| {
        let mut bytes =
            b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M\xe9\x03.\x80\x02}.".to_vec();
        bytes.extend(b"\x80\x02}X\x01\0\0\0wctorch._utils\n_rebuild_tensor_v2\n((");
        bytes.extend(b"X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\0kX\x03\0\0\0cpuJ");
        bytes.extend(numel.to_le_bytes());
        bytes.extend(b"tQK\0(");
        bytes.extend(size);
        bytes.extend(b"t(");
        bytes.extend(stride);
        bytes.extend(b"t\x89}tRs.\x80\x02]X\x01\0\0\0ka.");
        bytes.extend(4_u64.to_le_bytes());
        bytes.extend([0; 16]);
        weights_from_bytes(&bytes)
    };
    assert!(claim(b"K\x04", b"K\x01", 4).is_ok(), "{:?}", claim(b"K\x04", b"K\x01", 4));
    let huge: &[u8] = b"J\xff\xff\xff\x7f";
    for (size, stride, numel) in [
        (huge, b"K\x01" as &[u8], 4),      // more elements than the storage says
        (huge, b"K\0", 4),                 // the same element again and again
        (huge, b"K\x01", i32::MAX as u32), // more than the storage has
        (b"K\x04", b"K\x02", 4),           // steps over the end
        (b"K\x04", huge, 4),
        (b"K\x02J\xff\xff\xff\x7f", b"K\x01K\x01", 4),
    ] {
        let error = claim(size, stride, numel).unwrap_err();
        assert!(error.to_string().contains("w: "), "{error}");
    }
}

/// A machine for pickles is easily made to recurse, to loop, or to fill the memory.
#[test]
fn hostile_programs_end() {
    let start = b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M\xe9\x03.\x80\x02}.".to_vec();
    let run = |program: &[u8]| weights_from_bytes(&[&start[..], program].concat()).unwrap_err();
    // A tuple in a tuple in a tuple, a million deep.
    run(&[b")".to_vec(), vec![0x85; 1_000_000], b".".to_vec()].concat());
    // Lists of ten times the last list each: 10^40 leaves, if anyone counted them.
    let mut nested = b"]q\0".to_vec();
    for level in 1..40_u8 {
        nested.extend(b"](");
        nested.extend([b'h', level - 1].repeat(10));
        nested.extend([b'e', b'q', level]);
    }
    run(&[&nested[..], b"."].concat());
    // A dictionary that holds itself.
    run(b"}q\0X\x0a\0\0\0state_dicth\0s.");
    for program in [
        &b"R."[..],
        b"t",
        b"(",
        b"Q.",
        b"X\xff\xff\xff\xff",
        b"h\x09.",
        b"cos\nsystem\n(X\x02\0\0\0lstR.",
        b"\x8b\xff\xff\xff\xff",
    ] {
        run(program);
    }
}

/// A stem of four channels keeps its own filters for the fourth.
#[test]
fn stems_are_widened() {
    let conv = |seed: u64, inputs: usize| {
        Conv2d::<f32>::new(&Init::new(seed), inputs, 2, 3, ConvGeometry::new())
    };
    let (narrow, mut wide) = (conv(1, 3), conv(2, 4));
    let own = wide.weight.value.clone();
    let mut state = State::new();
    state.add_module("", &narrow);
    LoadWeights::strict().widen("weight").load_state(state.clone(), &mut wide).unwrap();
    for ((o, c, u, v), &w) in
        wide.weight.value.view().into_dimensionality::<ndarray::Ix4>().unwrap().indexed_iter()
    {
        let expected = if c < 3 { narrow.weight.value[[o, c, u, v]] } else { own[[o, c, u, v]] };
        assert_eq!(w, expected);
    }
    assert_eq!(wide.bias.unwrap().value, narrow.bias.unwrap().value);
    // Only the second axis may differ, and only so far as was said.
    let mut other = conv(3, 4);
    assert!(LoadWeights::strict().load_state(state.clone(), &mut other).is_err());
    let mut less = conv(3, 2);
    assert!(LoadWeights::strict().widen("weight").load_state(state, &mut less).is_err());
}
