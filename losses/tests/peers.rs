//! Values and gradients of PyTorch3D, PyTorch and scikit-image, in double precision; `fixtures/peers.py` made them.
#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::{Tape, Tensor, Var};
use losses::{Directions, Matches, Neighbors, Norm};
use mesh_core::{Topology, cotangent_laplacian};
use ndarray::{ArrayD, IxDyn};
use serde_json::Value;

struct Peers(Value);

impl Peers {
    fn read() -> Self {
        Self(serde_json::from_str(include_str!("fixtures/peers.json")).unwrap())
    }

    fn array(&self, name: &str) -> ArrayD<f64> {
        let entry = &self.0[name];
        let list = |key: &str| entry[key].as_array().unwrap_or_else(|| panic!("{name} is missing"));
        let shape: Vec<usize> =
            list("shape").iter().map(|n| n.as_u64().unwrap() as usize).collect();
        let data = list("data").iter().map(|x| x.as_f64().unwrap()).collect();
        ArrayD::from_shape_vec(IxDyn(&shape), data).unwrap()
    }

    fn indices(&self, name: &str) -> Vec<u32> {
        self.array(name).iter().map(|&i| i as u32).collect()
    }

    fn topology(&self) -> Topology {
        let faces: Vec<[u32; 3]> = self.indices("faces").as_chunks().0.to_vec();
        Topology::new(8, &faces)
    }

    fn near(&self, name: &str, found: &Tensor<f64>) {
        let expected = self.array(name);
        assert_eq!(found.len(), expected.len(), "{name}");
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() <= 1e-9, "{name}: {found} instead of {expected}");
        }
    }

    /// The value and the gradients of a scalar of the named inputs.
    fn check(
        &self,
        name: &str,
        inputs: &[&str],
        f: impl for<'t> Fn(&[Var<'t, f64>]) -> Var<'t, f64>,
    ) {
        let tape = Tape::<f64>::train(0);
        let leaves: Vec<_> = inputs.iter().map(|input| tape.leaf(self.array(input))).collect();
        let loss = f(&leaves);
        self.near(&format!("{name}.value"), &loss.value());
        let gradients = loss.backward();
        for (input, leaf) in inputs.iter().zip(leaves) {
            self.near(&format!("{name}.grad.{input}"), gradients.wrt(leaf).unwrap());
        }
    }
}

/// cos(index), as the script weighs.
fn weighed(x: Var<'_, f64>) -> Var<'_, f64> {
    let mut i = -1.0;
    let weights = ArrayD::from_shape_simple_fn(IxDyn(&x.shape()), || {
        i += 1.0;
        f64::cos(i)
    });
    x.mul(x.tape().constant(weights)).sum()
}

#[test]
fn nearest_neighbors() {
    let peers = Peers::read();
    for (name, norm) in [("knn1", Norm::L1), ("knn2", Norm::L2)] {
        let tape = Tape::<f64>::eval();
        let (x, y) = (tape.constant(peers.array("x")), tape.constant(peers.array("y")));
        let mut near = Neighbors::default();
        near.find(x, y, 3, norm);
        assert_eq!(near.indices(), peers.indices(&format!("{name}.indices")));
        peers.near(&format!("{name}.distances"), &losses::knn_distances(x, y, &near).value());
        peers.check(name, &["x", "y"], |x| weighed(losses::knn_distances(x[0], x[1], &near)));
    }
}

#[test]
fn chamfer_of_both_norms_with_signed_normals() {
    let peers = Peers::read();
    let both = Directions::default();
    let (mut l1, mut l2) = (Matches::default(), Matches::default());
    let tape = Tape::<f64>::eval();
    let (x, y) = (tape.constant(peers.array("x")), tape.constant(peers.array("y")));
    l1.find_l1(x, y);
    l2.find(x, y);
    peers.check("chamfer1", &["x", "y"], |x| losses::chamfer_l1(x[0], x[1], &l1, both));
    peers.check("chamfer2", &["x", "y"], |x| losses::chamfer_distance(x[0], x[1], &l2, both));
    for (name, matches) in [("chamfer1.normals", &l1), ("chamfer2.normals", &l2)] {
        peers.check(name, &["x_normals", "y_normals"], |x| {
            losses::chamfer_normals_signed(x[0], x[1], matches, both)
        });
    }
}

#[test]
fn points_and_faces() {
    let (peers, tape) = (Peers::read(), Tape::<f64>::eval());
    let topology = peers.topology();
    let (cloud, verts) = (tape.constant(peers.array("cloud")), tape.constant(peers.array("verts")));
    peers.near("point_face", &losses::point_face_distance(cloud, verts, &topology).value());
    peers.near("face_point", &losses::face_point_distance(cloud, verts, &topology).value());
    peers.check("point_mesh", &["cloud", "verts"], |x| {
        losses::point_mesh_face_distance(x[0], x[1], &topology)
    });
}

#[test]
fn laplacian_smoothing_by_all_three_methods() {
    let peers = Peers::read();
    let topology = peers.topology();
    let verts = peers.array("verts");
    let positions: Vec<[f64; 3]> = verts.outer_iter().map(|p| [p[0], p[1], p[2]]).collect();
    let matrix = cotangent_laplacian(&positions, &topology.faces, &topology);
    peers.check("laplacian.uniform", &["verts"], |x| losses::laplacian_norm(x[0], &topology));
    peers.check("laplacian.cot", &["verts"], |x| {
        losses::laplacian_cotangent(x[0], std::slice::from_ref(&matrix))
    });
    peers.check("laplacian.cotcurv", &["verts"], |x| losses::laplacian_cotcurv(x[0], &topology));
}

#[test]
fn losses_on_logits() {
    let peers = Peers::read();
    let (target, classes) = (peers.array("target"), peers.indices("classes"));
    peers.check("bce_logits", &["logits"], |x| {
        losses::mask_bce_logits(x[0], x[0].tape().constant(target.clone()))
    });
    peers.check("cross_entropy", &["logits"], |x| losses::cross_entropy(x[0], &classes));
}

#[test]
fn structural_similarity_over_the_valid_region() {
    let (peers, tape) = (Peers::read(), Tape::<f64>::eval());
    let image = |name: &str| tape.constant(peers.array(name)).reshape(&[1, 17, 14, 3]);
    let loss = losses::ssim_loss_valid(image("image"), image("other"));
    peers.near("ssim", &tape.constant(ndarray::arr0(1.0 - loss.item())).value());
}
