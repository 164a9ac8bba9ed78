//! Values, gradients and steps of PyTorch, in double precision; `fixtures/peers.py` made them.

use autodiff_lite::optim::{RmsProp, RmsPropMethod};
use autodiff_lite::{Activation, Conv3dGeometry, Tape, Tensor};
use ndarray::{ArrayD, IxDyn};

struct Peers(serde_json::Value);

impl Peers {
    fn read() -> Self {
        Self(serde_json::from_str(include_str!("../fixtures/peers.json")).unwrap())
    }

    fn array(&self, name: &str) -> ArrayD<f64> {
        let list = |key: &str| self.0[name][key].as_array().unwrap();
        let shape: Vec<usize> =
            list("shape").iter().map(|n| n.as_u64().unwrap() as usize).collect();
        let data = list("data").iter().map(|x| x.as_f64().unwrap()).collect();
        ArrayD::from_shape_vec(IxDyn(&shape), data).unwrap()
    }

    fn near(&self, name: &str, found: &Tensor<f64>) {
        let expected = self.array(name);
        assert_eq!(found.shape(), expected.shape(), "{name}");
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-9, "{name}: {found} instead of {expected}");
        }
    }
}

#[test]
fn convolution_over_three_axes() {
    let (peers, tape) = (Peers::read(), Tape::<f64>::train(0));
    let [x, w, b] = ["x", "w", "b"].map(|k| tape.leaf(peers.array(&format!("conv3d.{k}"))));
    let geometry = Conv3dGeometry {
        stride: [2, 1, 2],
        padding: [1, 1, 2],
        dilation: [1, 2, 1],
        ..Conv3dGeometry::new()
    };
    let y = x.conv3d(w, Some(b), geometry, Activation::Tanh);
    peers.near("conv3d.y", &y.value());
    let mut i = -1.0;
    let seed = ArrayD::from_shape_simple_fn(IxDyn(&y.shape()), || {
        i += 1.0;
        f64::cos(i)
    });
    let gradients = y.backward_with(seed);
    for (name, var) in [("x", x), ("w", w), ("b", b)] {
        peers.near(&format!("conv3d.grad.{name}"), gradients.wrt(var).unwrap());
    }
}

#[test]
fn silu() {
    let (peers, tape) = (Peers::read(), Tape::<f64>::train(0));
    let x = tape.leaf(peers.array("silu.x"));
    peers.near("silu.y", &x.silu().value());
    peers.near("silu.grad", x.silu().sum().backward().wrt(x).unwrap());
}

/// What a variant of the method changes of its options.
type Change = fn(&mut RmsPropMethod);

#[test]
fn rmsprop_step_by_step() {
    let peers = Peers::read();
    let methods: [(&str, Change); 3] = [
        ("plain", |_| {}),
        ("momentum", |m| (m.momentum, m.weight_decay) = (0.9, 0.1)),
        ("centered", |m| (m.centered, m.alpha, m.epsilon) = (true, 0.9, 1e-3)),
    ];
    for (name, change) in methods {
        let mut optimizer = RmsProp::<f64>::new(0.02).with(change);
        let mut w = peers.array("rmsprop.start").into_raw_vec_and_offset().0;
        let mut steps = Vec::new();
        for _ in 0..5 {
            let gradient: Vec<f64> = w.iter().map(|w| 4.0 * w.powi(3) - w.cos()).collect();
            optimizer.update("w", &mut w, &gradient);
            steps.extend(w.iter().copied());
        }
        let steps = ArrayD::from_shape_vec(IxDyn(&[5, w.len()]), steps).unwrap();
        peers.near(&format!("rmsprop.{name}"), &Tensor::from(steps));
    }
}
