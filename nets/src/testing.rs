//! What the tests of several layers share.

use autodiff_lite::{Module, Param, Tape, Var};

use crate::Init;

/// Gives all parameters values of a size that gradients can be seen through; none stands at a kink, as zeros do.
pub(crate) fn randomize<M: Module<f64>>(module: &mut M) {
    let mut count = 0;
    module.visit_mut("", &mut |_: &str, param: &mut Param<f64>| {
        count += 1;
        *param = Init::new(count).normal(param.shape(), 0.0, 0.4);
    });
}

/// Compares the gradients of all parameters with central differences along one random direction each.
pub(crate) fn parameter_gradients<M: Module<f64> + Clone>(
    module: &M,
    forward: impl for<'t> Fn(&M, &'t Tape<f64>) -> Var<'t, f64>,
) {
    let weigh = |y: Var<'_, f64>| -> f64 {
        y.value().iter().enumerate().map(|(i, y)| y * (1.0 + i as f64).sin()).sum()
    };
    let mut params = Vec::new();
    module.visit("", &mut |path: &str, p: &Param<f64>| params.push((path.to_owned(), p.clone())));
    let tape = Tape::<f64>::train(0);
    let y = forward(module, &tape);
    let seed = ndarray::ArrayD::from_shape_vec(
        y.shape(),
        (0..y.len()).map(|i| (1.0 + i as f64).sin()).collect(),
    );
    let gradients = y.backward_with(seed.expect("as many weights as outputs"));
    for (k, (path, param)) in params.iter().enumerate() {
        let step: Param<f64> = Init::new(k as u64).normal(param.shape(), 0.0, 1.0);
        let moved = |by: f64| {
            let mut module = module.clone();
            module.visit_mut("", &mut |at: &str, p: &mut Param<f64>| {
                if at == path {
                    p.as_slice_mut()
                        .iter_mut()
                        .zip(step.as_slice())
                        .for_each(|(p, d)| *p += by * d);
                }
            });
            let tape = Tape::<f64>::eval();
            weigh(forward(&module, &tape))
        };
        let differences = (moved(1e-6) - moved(-1e-6)) / 2e-6;
        let found = gradients.of(param).expect("every parameter is in use");
        let rule: f64 = found.iter().zip(step.as_slice()).map(|(g, d)| g * d).sum();
        let scale = rule.abs().max(differences.abs()).max(1.0);
        assert!((rule - differences).abs() < 1e-5 * scale, "{path}: {rule} and {differences}");
    }
}
