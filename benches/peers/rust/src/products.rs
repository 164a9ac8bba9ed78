//! Matrix products `C = A B`, either operand stored transposed; to be run with one thread, for the row is per core.

use std::error::Error;
use std::hint::black_box;

use burn::tensor::{Device, Distribution, Tensor};
use candle_core::{Device as Cpu, Tensor as Candle};

use crate::timing::report;

const SHAPES: [[usize; 3]; 3] = [[2466, 963, 192], [2562, 1024, 512], [1024, 1024, 1024]];

pub fn time() -> Result<(), Box<dyn Error>> {
    for [m, k, n] in SHAPES {
        for order in ["nn", "tn", "nt"] {
            let id = format!("gemm/{m}x{k}x{n}/{order}/1t");
            let stored =
                |rows, columns, turned| if turned { [columns, rows] } else { [rows, columns] };
            let (left, right) = (stored(m, k, order == "tn"), stored(k, n, order == "nt"));

            let normal = |shape: [usize; 2]| Candle::randn(0f32, 1.0, &shape[..], &Cpu::Cpu);
            let (mut a, mut b) = (normal(left)?, normal(right)?);
            if order == "tn" {
                a = a.t()?;
            }
            if order == "nt" {
                b = b.t()?;
            }
            report(&id, "candle 0.11", || drop(black_box(a.matmul(&b).expect("shapes fit"))));

            let normal = |shape| Tensor::<2>::random(shape, Distribution::Default, &Device::flex());
            let (mut a, mut b) = (normal(left), normal(right));
            if order == "tn" {
                a = a.transpose();
            }
            if order == "nt" {
                b = b.transpose();
            }
            report(&id, "burn-flex 0.22", || drop(black_box(a.clone().matmul(b.clone()))));
        }
    }
    Ok(())
}
