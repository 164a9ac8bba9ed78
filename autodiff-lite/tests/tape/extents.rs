//! Sizes whose products wrap, given to every kernel behind which there are pointers: a panic, in
//! builds without overflow checks too, and no access beyond a slice.

use std::panic::{AssertUnwindSafe, catch_unwind};

use autodiff_lite::kernels::activation::Activation;
use autodiff_lite::kernels::attention::{
    AttentionGradients, AttentionOperands, AttentionSizes, attention, attention_grad,
};
use autodiff_lite::kernels::conv::{Conv, ConvAlgorithm, ConvSizes};
use autodiff_lite::kernels::gemm::Matrix;
use autodiff_lite::kernels::isa::Isa;
use autodiff_lite::kernels::norm::{
    NormSizes, Statistics, layer_norm, normalize, normalize_grad, statistics,
};
use autodiff_lite::kernels::pooling::{PoolGeometry, Windows, avg_pool, max_pool};
use autodiff_lite::kernels::product::gemm;
use autodiff_lite::kernels::project::{Projection, project};
use autodiff_lite::kernels::reduce::{max_axis, sum_axis};
use autodiff_lite::kernels::resample::{resize, resize_blends, resize_grad};
use autodiff_lite::kernels::sampling::{Padding, Sampling, sample};
use autodiff_lite::kernels::sparse::{CsrRows, csr_add_rows, csr_times_rows};

const HALF: usize = 1 << 32;

/// Refused by a check of its own, not by an arithmetic overflow that a release build lets pass.
#[track_caller]
fn refused(f: impl FnOnce()) {
    let payload = catch_unwind(AssertUnwindSafe(f)).unwrap_err();
    let message = payload
        .downcast_ref::<String>()
        .cloned()
        .or_else(|| payload.downcast_ref::<&str>().map(|&text| text.to_owned()))
        .unwrap();
    assert!(!message.contains("with overflow"), "{message}");
}

#[test]
fn sparse_products() {
    // One entry, and rows wide enough for their elements to wrap to none.
    let offsets = vec![0_u32; (1 << 16) + 1];
    let mut entries = offsets.clone();
    entries[1..].fill(1);
    let a = CsrRows { offsets: &entries, indices: &[0], values: &[1.0_f32] };
    for isa in Isa::available() {
        refused(|| csr_times_rows(isa, a, 1 << 16, 1, 1 << 48, &[], &mut []));
        refused(|| csr_times_rows(isa, a, HALF, 1, HALF, &[], &mut []));
        refused(|| csr_add_rows(isa, a, HALF, 1, HALF, &[], &mut [], Activation::Relu));
        refused(|| csr_times_rows(isa, a, HALF, HALF, 1, &[], &mut []));
    }
    let nothing = CsrRows { offsets: &[], indices: &[], values: &[] as &[f32] };
    refused(|| csr_times_rows(Isa::best(), nothing, 1, 1, 1, &[0.0], &mut [0.0]));
}

#[test]
fn matrix_products() {
    let (one, zero) = (1.0_f32, 0.0);
    let wraps = usize::MAX / 3 + 1;
    let data = [1.0; 8];
    // Reaches of 3 * step + 1 = 1.
    let a = Matrix { data: &data, steps: [wraps, 1] };
    let b = Matrix { data: &data, steps: [1, 1] };
    refused(|| gemm([4, 1, 1], one, a, b, zero, &mut [0.0; 4]));
    refused(|| gemm([1, 1, 4], one, b, Matrix { steps: [1, wraps], ..b }, zero, &mut [0.0; 4]));
    // A product of 2^64 elements, of rows and columns that are one element read over and over.
    let same = Matrix { data: &data, steps: [0, 0] };
    refused(|| gemm([HALF, 1, HALF], one, same, same, zero, &mut []));
    refused(|| gemm([HALF, 0, HALF], one, same, same, zero, &mut []));
}

#[test]
fn attentions() {
    let none: &[f32] = &[];
    let apart = AttentionOperands::Apart([none; 3]);
    let sizes =
        |batch, heads, queries, keys, width| AttentionSizes { batch, heads, queries, keys, width };
    for s in [
        sizes(1, 1, HALF, HALF, 1),
        sizes(HALF, 1, 1, 1, HALF),
        sizes(HALF, 1, HALF, 0, 1),
        sizes(1, HALF, HALF, 1, HALF),
    ] {
        refused(|| attention(&s, apart, None, None, &mut [], &mut []));
        refused(|| {
            let gradients = AttentionGradients::Apart([&mut [], &mut [], &mut []]);
            attention_grad(&s, apart, None, none, none, gradients);
        });
    }
    let packed = AttentionOperands::Packed(none);
    let s = sizes(1, 1, 1 << 31, 1 << 31, 1 << 33);
    refused(|| attention(&s, packed, None, None, &mut [], &mut []));
}

#[test]
fn norms() {
    let s = NormSizes { sets: 1, rows: 1 << 50, channels: 1 << 14, groups: 1 };
    let row = vec![0.0_f32; 1 << 14];
    let one = [1.0_f32];
    let known = Statistics { mean: &one, inverse: &one };
    let (mut weight, mut bias) = (row.clone(), row.clone());
    refused(|| statistics(s, &[0.0_f32; 0], &mut [0.0], &mut [0.0]));
    refused(|| normalize(s, &[], &known, [&row, &row], Activation::None, &mut []));
    refused(|| {
        let out = [&mut weight[..], &mut bias[..]];
        normalize_grad(s, &[], &known, [&row, &row], false, &mut [], out);
    });
    refused(|| {
        // More rows to write than to read, and no room for their statistics.
        let mut y = [0.0_f32; 8];
        layer_norm(&[0.0; 2], [&one, &one], 1e-5, Activation::None, &mut y, &mut [0.0; 4]);
    });
}

#[test]
fn pools() {
    let geometry = PoolGeometry::square(2);
    let windows = Windows::new([1, 4, 4, 1], &geometry).unwrap();
    let s = Windows { batch: 1 << 60, channels: 4, ..windows };
    let mut argument: [u32; 0] = [];
    refused(|| max_pool(&s, &[] as &[f32], &mut [], &mut argument));
    refused(|| avg_pool(&s, &[] as &[f32], &mut []));
    let padded = PoolGeometry { kernel: [usize::MAX; 2], stride: [1; 2], padding: [1 << 62; 2] };
    assert!(Windows::new([1, usize::MAX, 4, 1], &padded).is_none());
}

#[test]
fn convolutions() {
    let plain = ConvSizes {
        batch: 1,
        input: [4, 4],
        in_channels: 1,
        output: [4, 4],
        out_channels: 1,
        kernel: [1, 1],
        stride: [1, 1],
        padding: [0, 0],
        dilation: [1, 1],
    };
    let run = |sizes: ConvSizes, x: usize, w: usize, y: usize| {
        for isa in Isa::available() {
            let conv = Conv { sizes, algorithm: ConvAlgorithm::Direct, isa };
            let (x, w, y) = (vec![0.0_f32; x], vec![0.0_f32; w], vec![0.0_f32; y]);
            let scratch = || vec![0.0_f32; 1 << 16];
            refused(|| {
                conv.forward(&x, &w, None, Activation::None, &mut y.clone(), &mut scratch());
            });
            refused(|| {
                conv.grad_input(&y, &w, None, Activation::None, &mut x.clone(), &mut scratch());
            });
            refused(|| conv.grad_weight(&x, &y, &mut w.clone(), &mut scratch()));
        }
    };
    run(ConvSizes { batch: HALF, in_channels: HALF, ..plain }, 0, 1, 0);
    run(ConvSizes { in_channels: HALF, out_channels: HALF, ..plain }, 16, 0, 16);
    // Lengths that are right, and windows that lie beyond the input.
    run(ConvSizes { output: [400, 400], ..plain }, 16, 1, 160_000);
    run(ConvSizes { stride: [usize::MAX / 3 + 1, 1], ..plain }, 16, 1, 16);
    run(ConvSizes { kernel: [2, 2], dilation: [usize::MAX, 1], ..plain }, 16, 4, 16);
    run(ConvSizes { padding: [1 << 63, 0], ..plain }, 16, 1, 16);
}

#[test]
fn images_and_points() {
    let s = Sampling {
        image: [HALF, 1, 1, HALF],
        points: 1,
        padding: Padding::Zeros,
        align_corners: false,
    };
    refused(|| sample(&s, &[] as &[f32], &[], &mut []));
    let blends = resize_blends::<f32>(4, 4, false);
    refused(|| resize([1 << 60, 4, 4, 1], &blends, &blends, &[], &mut []));
    refused(|| resize_grad([1 << 60, 4, 4, 1], &blends, &blends, &[], &mut []));
    refused(|| project(Projection::Affine, [1 << 62, 4], &[] as &[f32], &[], &mut []));
    refused(|| sum_axis([HALF, 1, HALF], &[] as &[f32], &mut []));
    refused(|| max_axis([HALF, 1, HALF], &[] as &[f32], &mut [], &mut []));
}
