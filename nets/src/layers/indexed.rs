//! Layers under the indices that they have in a PyTorch `Sequential`.

use autodiff_lite::{Module, Real, Visitor, VisitorMut, join_path};

/// Layers whose names are numbers with gaps: in a `torch.nn.Sequential` activations and pools
/// have numbers too, so the convolutions of VGG16 are `0, 2, 5, 7, ..`.
#[derive(Clone, Debug, Default)]
pub struct Indexed<M>(pub Vec<(usize, M)>);

impl<M> Indexed<M> {
    /// The layers in order, without their numbers.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &M> + DoubleEndedIterator {
        self.0.iter().map(|(_, layer)| layer)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl<F: Real, M: Module<F>> Module<F> for Indexed<M> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        for (index, layer) in &self.0 {
            layer.visit(&join_path(path, &index.to_string()), visitor);
        }
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        for (index, layer) in &mut self.0 {
            layer.visit_mut(&join_path(path, &index.to_string()), visitor);
        }
    }
}
