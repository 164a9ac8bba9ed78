//! A 3x3 convolution with padding 1: forward, and the gradients of input, weight and bias.

use std::error::Error;
use std::hint::black_box;

use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Distribution, Tensor};
use candle_core::{Device as Cpu, Tensor as Candle, Var};

use crate::timing::report;

/// Batch, side, channels in and out.
const SHAPES: [[usize; 4]; 2] = [[8, 56, 64, 64], [8, 28, 128, 128]];

pub fn time() -> Result<(), Box<dyn Error>> {
    for [batch, side, from, to] in SHAPES {
        let id = format!("conv2d/{batch}x{side}x{side}x{from}-{to}/forward-backward/2t");
        let normal = |shape: &[usize]| Candle::randn(0f32, 1.0, shape, &Cpu::Cpu);
        let x = Var::from_tensor(&normal(&[batch, from, side, side])?)?;
        let w = Var::from_tensor(&normal(&[to, from, 3, 3])?)?;
        let b = Var::from_tensor(&normal(&[1, to, 1, 1])?)?;
        let g = normal(&[batch, to, side, side])?;
        let step = || -> candle_core::Result<()> {
            let y = x.conv2d(&w, 1, 1, 1, 1)?.broadcast_add(&b)?;
            black_box((y * &g)?.sum_all()?.backward()?);
            Ok(())
        };
        step()?;
        report(&id, "candle 0.11", || step().expect("it went before"));

        let device = Device::flex().autodiff();
        let options = || ConvOptions::new([1, 1], [1, 1], [1, 1], 1);
        let x = Tensor::<4>::random([batch, from, side, side], Distribution::Default, &device)
            .require_grad();
        let w =
            Tensor::<4>::random([to, from, 3, 3], Distribution::Default, &device).require_grad();
        let b = Tensor::<1>::random([to], Distribution::Default, &device).require_grad();
        let g = Tensor::<4>::random([batch, to, side, side], Distribution::Default, &device);
        report(&id, "burn-flex 0.22", || {
            let y = conv2d(x.clone(), w.clone(), Some(b.clone()), options());
            black_box((y * g.clone()).sum().backward());
        });
    }
    Ok(())
}
