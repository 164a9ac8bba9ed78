//! The terms of a loss, summed over the stages of a deformation.

use autodiff_lite::Var;
use train::Terms;

use super::config::SharedConfig;

/// What the stages miss, summed over them; nothing where no stage counts it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums<'t> {
    pub(super) chamfer: Option<Var<'t>>,
    pub(super) edge: Option<Var<'t>>,
    pub(super) normal: Option<Var<'t>>,
    pub(super) laplacian: Option<Var<'t>>,
    pub(super) moved: Option<Var<'t>>,
    pub(super) stretch: Option<Var<'t>>,
    pub(super) bending: Option<Var<'t>>,
}

impl<'t> Sums<'t> {
    /// Those that count, with their weights; `zero` is what no stage said.
    pub(super) fn weighted(self, shared: &SharedConfig, zero: impl Fn() -> Var<'t>) -> Terms<'t> {
        [
            ("chamfer", shared.chamfer_weight, self.chamfer),
            ("edge", shared.edge_weight, self.edge),
            ("normal", shared.normal_weight, self.normal),
            ("laplacian", shared.laplacian_weight, self.laplacian),
            ("move", shared.move_weight, self.moved),
            ("stretch", shared.stretch_weight, self.stretch),
            ("bending", shared.bending_weight, self.bending),
        ]
        .into_iter()
        .filter(|&(_, weight, _)| weight > 0.0)
        .fold(Terms::new(), |terms, (name, weight, sum)| {
            terms.with(name, weight, sum.unwrap_or_else(&zero))
        })
    }
}
