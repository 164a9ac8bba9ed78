//! Graph convolutions against the formulas, evaluated vertex by vertex in Python (`fixtures/make_graph.py`).

use autodiff_lite::state::State;
use autodiff_lite::{Activation, Module, Param, Real, SparseMatrix, Tape, Tensor, Var};
use nets::{GraphBottleneck, GraphConv, Init};

fn goldens() -> State {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    State::read(folder.join("graph.safetensors")).unwrap()
}

fn adjacency<F: Real>(all: &State) -> SparseMatrix<F> {
    let edges: Tensor<f64> = all.array("edges").unwrap();
    let pairs = edges.rows().into_iter().map(|e| (e[0] as usize, e[1] as usize));
    let both: Vec<_> = pairs.flat_map(|(a, b)| [(a, b, F::one()), (b, a, F::one())]).collect();
    SparseMatrix::from_triplets(6, 6, &both).unwrap()
}

fn chebyshev<F: Real>(all: &State) -> SparseMatrix<F> {
    let dense: Tensor<F> = all.array("chebyshev").unwrap();
    let entries = dense.as_slice().iter().enumerate().map(|(k, &x)| (k / 6, k % 6, x));
    SparseMatrix::from_triplets(6, 6, &entries.collect::<Vec<_>>()).unwrap()
}

fn close<F: Real>(what: &str, found: &Tensor<F>, expected: &Tensor<f64>, tolerance: f64) {
    assert_eq!(found.shape(), expected.shape(), "{what}");
    let scale = expected.iter().fold(1.0_f64, |s, x| s.max(x.abs()));
    for (f, e) in found.iter().zip(expected) {
        assert!((Real::to_f64(*f) - e).abs() <= tolerance * scale, "{what}: {f} instead of {e}");
    }
}

fn check<F: Real, M: Module<F>>(
    name: &str,
    mut module: M,
    tolerance: f64,
    forward: impl for<'t> Fn(&M, Var<'t, F>) -> Var<'t, F>,
) {
    let all = goldens();
    module.visit_mut("", &mut |path: &str, param: &mut Param<F>| {
        let value: Tensor<F> = all.array(&format!("{name}.weights.{path}")).unwrap();
        assert_eq!(value.shape(), param.shape(), "{path}");
        param.value = value;
    });
    let tape = Tape::<F>::train(0);
    let x = tape.leaf(all.array::<F>(&format!("{name}.x")).unwrap());
    let y = forward(&module, x);
    close("output", &y.value(), &all.array(&format!("{name}.output")).unwrap(), tolerance);
    let mut k = -1.0;
    let seed = y.value().mapv(|_| {
        k += 1.0;
        F::from_f64(f64::cos(k))
    });
    let gradients = y.backward_with(seed);
    close(
        "x",
        gradients.wrt(x).unwrap(),
        &all.array(&format!("{name}.grad.x")).unwrap(),
        tolerance,
    );
    module.visit("", &mut |path: &str, param: &Param<F>| {
        let found = gradients.of(param).unwrap();
        close(path, found, &all.array(&format!("{name}.grads.{path}")).unwrap(), tolerance);
    });
}

fn both<F: Real>(tolerance: f64) {
    let (all, init) = (goldens(), Init::new(0));
    let graph = adjacency::<F>(&all);
    check("meshrcnn", GraphConv::<F>::new(&init, 5, 3), tolerance, |m, x| {
        m.forward_then(x, &graph, Activation::Relu)
    });
    let graph = chebyshev::<F>(&all);
    let block = GraphBottleneck::<F>::new(&init, 2, [5, 4, 3], Activation::Relu);
    check("bottleneck", block, tolerance, |m, x| m.forward(x, &graph).0);
}

#[test]
fn values_and_gradients_are_those_of_the_formulas() {
    both::<f64>(1e-12);
    both::<f32>(2e-5);
}
