//! The operators that networks are made of.

use std::ops::Range;

use autodiff_lite::{Activation, ConvGeometry, Param, PoolGeometry};

use super::graph::{OnnxGraph, OnnxValue};
use super::proto::Attribute;

/// Kernel, stride and padding, as operators are told them.
fn window(kernel: [usize; 2], stride: [usize; 2], padding: [usize; 2]) -> Vec<Attribute> {
    let [top, left] = padding;
    vec![
        Attribute::ints("kernel_shape", &kernel),
        Attribute::ints("strides", &stride),
        Attribute::ints("pads", &[top, left, top, left]),
    ]
}

/// Outputs along an axis.
fn along(size: usize, kernel: usize, stride: usize, padding: usize, dilation: usize) -> usize {
    (size + 2 * padding - dilation * (kernel - 1) - 1) / stride + 1
}

impl OnnxGraph {
    fn unary(&mut self, op: &str, x: &OnnxValue) -> OnnxValue {
        self.node(op, &[&x.name], Vec::new(), &x.shape)
    }

    /// Of two values with as many axes; those of length 1 are repeated.
    fn binary(&mut self, op: &str, a: &OnnxValue, b: &OnnxValue) -> OnnxValue {
        assert_eq!(a.shape.len(), b.shape.len(), "{op}: {:?} and {:?}", a.shape, b.shape);
        let shape: Vec<usize> = a.shape.iter().zip(&b.shape).map(|(&a, &b)| a.max(b)).collect();
        self.node(op, &[&a.name, &b.name], Vec::new(), &shape)
    }

    /// `a + b`.
    pub fn add(&mut self, a: &OnnxValue, b: &OnnxValue) -> OnnxValue {
        self.binary("Add", a, b)
    }

    /// `a - b`.
    pub fn sub(&mut self, a: &OnnxValue, b: &OnnxValue) -> OnnxValue {
        self.binary("Sub", a, b)
    }

    /// `a / b`.
    pub fn div(&mut self, a: &OnnxValue, b: &OnnxValue) -> OnnxValue {
        self.binary("Div", a, b)
    }

    /// `x + c`, where `c` has the shape of the last axes.
    pub fn add_constant(
        &mut self,
        x: &OnnxValue,
        name: &str,
        shape: &[usize],
        values: &[f32],
    ) -> OnnxValue {
        let constant = self.constant(name, shape, values);
        self.node("Add", &[&x.name, &constant], Vec::new(), &x.shape)
    }

    /// `x · c`, where `c` has the shape of the last axes.
    pub fn mul_constant(
        &mut self,
        x: &OnnxValue,
        name: &str,
        shape: &[usize],
        values: &[f32],
    ) -> OnnxValue {
        let constant = self.constant(name, shape, values);
        self.node("Mul", &[&x.name, &constant], Vec::new(), &x.shape)
    }

    /// `x · factor`.
    pub fn scale(&mut self, x: &OnnxValue, factor: f32) -> OnnxValue {
        self.mul_constant(x, "factor", &[1], &[factor])
    }

    /// `(x - mean) / deviation` of each channel of images.
    pub fn normalized(&mut self, x: &OnnxValue, mean: &[f32], deviation: &[f32]) -> OnnxValue {
        let [c, ..] = x.image();
        let shift: Vec<f32> = mean.iter().map(|mean| -mean).collect();
        let factor: Vec<f32> = deviation.iter().map(|deviation| deviation.recip()).collect();
        let x = self.add_constant(x, "shift", &[c, 1, 1], &shift);
        self.mul_constant(&x, "factor", &[c, 1, 1], &factor)
    }

    /// The square root of each number.
    pub fn sqrt(&mut self, x: &OnnxValue) -> OnnxValue {
        self.unary("Sqrt", x)
    }

    /// `clamp(x / 6 + 1/2, 0, 1)`, PyTorch's `hardsigmoid`.
    pub fn hard_sigmoid(&mut self, x: &OnnxValue) -> OnnxValue {
        let attributes = vec![Attribute::float("alpha", 1.0 / 6.0), Attribute::float("beta", 0.5)];
        self.node("HardSigmoid", &[&x.name], attributes, &x.shape)
    }

    /// `x Φ(x)`, by the error function.
    pub fn gelu(&mut self, x: &OnnxValue) -> OnnxValue {
        let y = self.scale(x, std::f32::consts::FRAC_1_SQRT_2);
        let y = self.unary("Erf", &y);
        let y = self.add_constant(&y, "one", &[1], &[1.0]);
        let y = self.scale(&y, 0.5);
        self.binary("Mul", &y, x)
    }

    /// An activation.
    pub fn activate(&mut self, x: &OnnxValue, activation: Activation) -> OnnxValue {
        match activation {
            Activation::None => x.clone(),
            Activation::Relu => self.unary("Relu", x),
            Activation::LeakyRelu(slope) => {
                self.node("LeakyRelu", &[&x.name], vec![Attribute::float("alpha", slope)], &x.shape)
            }
            Activation::Sigmoid => self.unary("Sigmoid", x),
            Activation::Tanh => self.unary("Tanh", x),
        }
    }

    /// Over the last axis.
    pub fn softmax(&mut self, x: &OnnxValue) -> OnnxValue {
        self.node("Softmax", &[&x.name], vec![Attribute::last_axis()], &x.shape)
    }

    /// Matrix products of the last two axes.
    ///
    /// # Panics
    /// If there are no two axes behind the batch, or they do not fit.
    pub fn matmul(&mut self, a: &OnnxValue, b: &OnnxValue) -> OnnxValue {
        let ([.., m, k], [.., l, n]) = (&a.shape[..], &b.shape[..]) else {
            panic!("matrices expected, found [N, {:?}] and [N, {:?}]", a.shape, b.shape)
        };
        assert_eq!(k, l, "{:?} times {:?}", a.shape, b.shape);
        let mut shape = a.shape[..a.shape.len() - 2].to_vec();
        shape.extend([*m, *n]);
        self.node("MatMul", &[&a.name, &b.name], Vec::new(), &shape)
    }

    /// `x Wᵀ + b` over the last axis, `W` `[out, in]`.
    ///
    /// # Panics
    /// If the last axis has not as many numbers as `W` has columns.
    pub fn linear(
        &mut self,
        x: &OnnxValue,
        [outputs, inputs]: [usize; 2],
        weight: &[f32],
        bias: Option<&[f32]>,
    ) -> OnnxValue {
        let mut shape = x.shape.clone();
        let last = shape.last_mut().expect("an axis behind the batch");
        assert_eq!(*last, inputs, "a linear layer of {inputs} inputs");
        *last = outputs;
        if shape.len() == 1 {
            let weight = self.constant("weight", &[outputs, inputs], weight);
            let bias = bias.map(|bias| self.constant("bias", &[outputs], bias));
            let inputs: Vec<&str> =
                [&x.name, &weight].into_iter().chain(&bias).map(String::as_str).collect();
            return self.node("Gemm", &inputs, vec![Attribute::int("transB", 1)], &shape);
        }
        let transposed: Vec<f32> = (0..inputs * outputs)
            .map(|at| weight[(at % outputs) * inputs + at / outputs])
            .collect();
        let weight = self.constant("weight", &[inputs, outputs], &transposed);
        let y = self.node("MatMul", &[&x.name, &weight], Vec::new(), &shape);
        match bias {
            Some(bias) => self.add_constant(&y, "bias", &[outputs], bias),
            None => y,
        }
    }

    /// A convolution, `weight` `[O, I, KH, KW]`.
    ///
    /// # Panics
    /// If the value has no images of `I` channels.
    pub fn conv2d(
        &mut self,
        x: &OnnxValue,
        weight: &Param,
        bias: Option<&Param>,
        geometry: ConvGeometry,
    ) -> OnnxValue {
        let ([c, h, w], &[o, i, kh, kw]) = (x.image(), weight.shape()) else {
            panic!("a convolution's weight has four axes, found {:?}", weight.shape())
        };
        assert_eq!(c, i, "a convolution of {i} channels");
        let ConvGeometry { stride, padding, dilation, .. } = geometry;
        let mut attributes = window([kh, kw], stride, padding);
        attributes.push(Attribute::ints("dilations", &dilation));
        let shape = [
            o,
            along(h, kh, stride[0], padding[0], dilation[0]),
            along(w, kw, stride[1], padding[1], dilation[1]),
        ];
        self.convolution("Conv", x, [weight].into_iter().chain(bias), attributes, &shape)
    }

    /// A transposed convolution, `weight` `[I, O, KH, KW]`.
    ///
    /// # Panics
    /// As [`conv2d`](Self::conv2d).
    pub fn conv_transpose2d(
        &mut self,
        x: &OnnxValue,
        weight: &Param,
        bias: Option<&Param>,
        geometry: ConvGeometry,
        output_padding: usize,
    ) -> OnnxValue {
        let ([c, h, w], &[i, o, kh, kw]) = (x.image(), weight.shape()) else {
            panic!("a convolution's weight has four axes, found {:?}", weight.shape())
        };
        assert_eq!(c, i, "a convolution of {i} channels");
        let ConvGeometry { stride, padding, dilation, .. } = geometry;
        let mut attributes = window([kh, kw], stride, padding);
        attributes.push(Attribute::ints("dilations", &dilation));
        attributes.push(Attribute::ints("output_padding", &[output_padding; 2]));
        let along = |n: usize, kernel: usize, k: usize| {
            (n - 1) * stride[k] + dilation[k] * (kernel - 1) + output_padding + 1 - 2 * padding[k]
        };
        let shape = [o, along(h, kh, 0), along(w, kw, 1)];
        self.convolution("ConvTranspose", x, [weight].into_iter().chain(bias), attributes, &shape)
    }

    fn convolution<'p>(
        &mut self,
        op: &str,
        x: &OnnxValue,
        params: impl Iterator<Item = &'p Param>,
        attributes: Vec<Attribute>,
        shape: &[usize],
    ) -> OnnxValue {
        let params: Vec<String> = params
            .zip(["weight", "bias"])
            .map(|(param, name)| self.constant(name, param.shape(), param.as_slice()))
            .collect();
        let inputs: Vec<&str> =
            std::iter::once(&x.name).chain(&params).map(String::as_str).collect();
        self.node(op, &inputs, attributes, shape)
    }

    /// The largest pixel of each window.
    pub fn max_pool2d(&mut self, x: &OnnxValue, geometry: PoolGeometry) -> OnnxValue {
        self.pool("MaxPool", x, geometry, Vec::new())
    }

    /// The mean of each window; padding counts as zeros.
    pub fn avg_pool2d(&mut self, x: &OnnxValue, geometry: PoolGeometry) -> OnnxValue {
        self.pool("AveragePool", x, geometry, vec![Attribute::int("count_include_pad", 1)])
    }

    fn pool(
        &mut self,
        op: &str,
        x: &OnnxValue,
        geometry: PoolGeometry,
        more: Vec<Attribute>,
    ) -> OnnxValue {
        let [c, h, w] = x.image();
        let PoolGeometry { kernel, stride, padding } = geometry;
        let mut attributes = window(kernel, stride, padding);
        attributes.extend(more);
        let size = |n: usize, k: usize| along(n, kernel[k], stride[k], padding[k], 1);
        self.node(op, &[&x.name], attributes, &[c, size(h, 0), size(w, 1)])
    }

    /// Other axes behind the batch, with as many numbers.
    ///
    /// # Panics
    /// If there are more or fewer.
    pub fn reshape(&mut self, x: &OnnxValue, shape: &[usize]) -> OnnxValue {
        let [old, new] = [&x.shape[..], shape].map(|shape| shape.iter().product::<usize>());
        assert_eq!(old, new, "{:?} to {shape:?}", x.shape);
        // 0 keeps the batch.
        let dims: Vec<i64> = std::iter::once(0).chain(shape.iter().map(|&n| n as i64)).collect();
        let dims = self.integers("shape", &dims);
        self.node("Reshape", &[&x.name, &dims], Vec::new(), shape)
    }

    /// The axes behind the batch in another order, counted from 0.
    pub fn permute(&mut self, x: &OnnxValue, order: &[usize]) -> OnnxValue {
        let shape: Vec<usize> = order.iter().map(|&axis| x.shape[axis]).collect();
        let all: Vec<usize> = std::iter::once(0).chain(order.iter().map(|axis| axis + 1)).collect();
        self.node("Transpose", &[&x.name], vec![Attribute::ints("perm", &all)], &shape)
    }

    /// A part of an axis behind the batch, counted from 0.
    pub fn slice(&mut self, x: &OnnxValue, axis: usize, range: Range<usize>) -> OnnxValue {
        let mut shape = x.shape.clone();
        shape[axis] = range.len();
        let parts = [("starts", range.start), ("ends", range.end), ("axes", axis + 1)];
        let [starts, ends, axes] = parts.map(|(name, at)| self.integers(name, &[at as i64]));
        self.node("Slice", &[&x.name, &starts, &ends, &axes], Vec::new(), &shape)
    }

    /// Values one after another along an axis behind the batch.
    ///
    /// # Panics
    /// If there is none.
    pub fn concat(&mut self, values: &[&OnnxValue], axis: usize) -> OnnxValue {
        let mut shape = values.first().expect("a value at least").shape.clone();
        shape[axis] = values.iter().map(|value| value.shape[axis]).sum();
        let names: Vec<&str> = values.iter().map(|value| value.name.as_str()).collect();
        self.node("Concat", &names, vec![Attribute::int("axis", axis + 1)], &shape)
    }

    /// Over an axis behind the batch, which stays with length 1: `op` is `ReduceMean`, `ReduceMax`, `ReduceMin` or `ReduceL2`.
    pub(super) fn reduce(&mut self, op: &str, x: &OnnxValue, axis: usize) -> OnnxValue {
        let mut shape = x.shape.clone();
        shape[axis] = 1;
        let attributes = vec![Attribute::ints("axes", &[axis + 1]), Attribute::int("keepdims", 1)];
        self.node(op, &[&x.name], attributes, &shape)
    }

    /// The mean over an axis behind the batch, which stays with length 1.
    pub fn mean(&mut self, x: &OnnxValue, axis: usize) -> OnnxValue {
        self.reduce("ReduceMean", x, axis)
    }

    /// The largest number along an axis behind the batch, which stays with length 1.
    pub fn max(&mut self, x: &OnnxValue, axis: usize) -> OnnxValue {
        self.reduce("ReduceMax", x, axis)
    }

    /// The smallest.
    pub fn min(&mut self, x: &OnnxValue, axis: usize) -> OnnxValue {
        self.reduce("ReduceMin", x, axis)
    }

    /// The Euclidean norm along an axis behind the batch, which stays with length 1.
    pub fn norm(&mut self, x: &OnnxValue, axis: usize) -> OnnxValue {
        self.reduce("ReduceL2", x, axis)
    }
}
