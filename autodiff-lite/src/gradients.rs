//! What a backward pass leaves.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use crate::kernels::reduce::sum_of_squares;
use crate::{Param, ParamId, Pool, Real, Tensor};

/// Gradients of one scalar with respect to leaves and trainable parameters.
///
/// It does not borrow the tape: reset the tape first, so that parameters are unique, then let the
/// optimiser read from here. Its memory goes back to the tape's pool when it is dropped.
pub struct Gradients<F: Real = f32> {
    /// Sorted by parameter, leaves first.
    entries: Vec<Entry<F>>,
    spare: Spare<F>,
    pool: Pool,
    /// Of which step of which tape they are.
    pub(crate) epoch: u64,
}

/// Spent vectors of entries, for the next gradients.
pub(crate) type Spare<F> = Arc<Mutex<Vec<Vec<Entry<F>>>>>;

pub(crate) struct Entry<F> {
    param: Option<ParamId>,
    node: u32,
    gradient: Tensor<F>,
}

impl<F: Real> fmt::Debug for Gradients<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.entries.iter().map(|e| (e.node, e.gradient.shape()))).finish()
    }
}

impl<F: Real> Gradients<F> {
    pub(crate) fn empty(spare: &Spare<F>, pool: &Pool, epoch: u64) -> Self {
        let entries = spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let (spare, pool) = (Arc::clone(spare), pool.clone());
        Self { entries: entries.unwrap_or_default(), spare, pool, epoch }
    }

    pub(crate) fn push(&mut self, node: u32, param: Option<ParamId>, gradient: Tensor<F>) {
        self.entries.push(Entry { param, node, gradient });
    }

    #[inline(never)]
    pub(crate) fn sort(&mut self) {
        self.entries.sort_unstable_by_key(|entry| (entry.param, entry.node));
    }

    fn find(&self, param: ParamId) -> Option<usize> {
        self.entries.binary_search_by_key(&Some(param), |entry| entry.param).ok()
    }

    /// The gradient of a parameter, if the scalar depends on it.
    ///
    /// # Shapes
    /// That of the parameter.
    pub fn of(&self, param: &Param<F>) -> Option<&Tensor<F>> {
        self.of_id(param.id())
    }

    pub(crate) fn of_id(&self, param: ParamId) -> Option<&Tensor<F>> {
        self.find(param).map(|i| &self.entries[i].gradient)
    }

    /// The gradient of a parameter as a slice.
    pub fn slice_of(&self, param: &Param<F>) -> Option<&[F]> {
        self.of(param).map(Tensor::as_slice)
    }

    /// The gradient of a leaf or of a parameter's node.
    pub(crate) fn of_node(&self, node: u32) -> Option<&Tensor<F>> {
        self.entries.iter().find(|e| e.node == node).map(|entry| &entry.gradient)
    }

    /// Adds the gradients of another backward pass, parameter by parameter: shards of one batch,
    /// in the order of the calls.
    ///
    /// Leaves of the other pass are dropped.
    #[inline(never)]
    pub fn accumulate(&mut self, other: &Self) {
        for entry in &other.entries {
            let Some(param) = entry.param else { continue };
            if let Some(i) = self.find(param) {
                let target = self.entries[i].gradient.as_slice_mut();
                crate::kernels::elementwise::add_to(entry.gradient.as_slice(), target);
            } else {
                self.push(u32::MAX, Some(param), self.pool.copy(&entry.gradient));
                self.sort();
            }
        }
    }

    /// Puts a parameter's gradient, which was computed elsewhere, in the place of the one that is here, if any; see
    /// [`Tape::gradients`](crate::Tape::gradients).
    ///
    /// # Shapes
    /// `gradient` has as many elements as the parameter, row-major.
    ///
    /// # Panics
    /// If the lengths differ.
    #[track_caller]
    pub fn insert(&mut self, param: &Param<F>, gradient: &[F]) {
        assert_eq!(param.len(), gradient.len(), "a parameter and its gradient differ in length");
        let i = self.find(param.id()).unwrap_or_else(|| {
            self.push(u32::MAX, Some(param.id()), self.pool.array(param.shape()));
            self.sort();
            self.find(param.id()).expect("it was added")
        });
        self.entries[i].gradient.as_slice_mut().copy_from_slice(gradient);
    }

    /// Multiplies all of them by `factor`.
    #[inline(never)]
    pub fn scale(&mut self, factor: F) {
        for g in self.slices_mut().flatten() {
            *g *= factor;
        }
    }

    /// The Euclidean norm over all entries of all parameters and leaves, summed in double
    /// precision, in an order that depends on the shapes alone.
    #[inline(never)]
    pub fn norm(&self) -> f64 {
        let squares = |entry: &Entry<F>| sum_of_squares(entry.gradient.as_slice());
        self.entries.iter().map(squares).sum::<f64>().sqrt()
    }

    /// Whether every entry is finite.
    #[inline(never)]
    pub fn is_finite(&self) -> bool {
        self.entries.iter().all(|entry| entry.gradient.iter().all(|g| g.is_finite()))
    }

    pub(crate) fn slices_mut(&mut self) -> impl Iterator<Item = &mut [F]> {
        self.entries.iter_mut().map(|e| e.gradient.as_slice_mut())
    }
}

impl<F: Real> Drop for Gradients<F> {
    fn drop(&mut self) {
        let mut entries = std::mem::take(&mut self.entries);
        for entry in entries.drain(..) {
            self.pool.recycle(entry.gradient);
        }
        self.spare.lock().unwrap_or_else(PoisonError::into_inner).push(entries);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::arr1;

    use super::*;
    use crate::Tape;

    #[test]
    fn shards_add_up() {
        let (p, q) = (Param::<f64>::new(arr1(&[1.0, 2.0])), Param::<f64>::new(arr1(&[5.0])));
        let (mut a, mut b) = (Tape::train(0), Tape::train(0));
        let mut sum = a.param(&p).square().sum().backward();
        let other = (b.param(&p).sum() + b.param(&q).sum()).backward();
        sum.accumulate(&other);
        a.reset();
        b.reset();
        assert_eq!(sum.slice_of(&p), Some(&[3.0, 5.0][..]));
        assert_eq!(sum.slice_of(&q), Some(&[1.0][..]));
        assert!((sum.norm() - 35.0_f64.sqrt()).abs() < 1e-12);
        assert!(sum.is_finite());
    }

    #[test]
    fn gradients_from_elsewhere_are_as_those_from_here() {
        let (p, q) = (Param::<f64>::new(arr1(&[1.0, 2.0])), Param::<f64>::new(arr1(&[5.0])));
        let mut tape = Tape::train(0);
        let here = (tape.param(&p).square().sum() + tape.param(&q).sum()).backward();
        let mut there = tape.gradients();
        there.insert(&q, &[7.0]);
        // The order of the calls does not count, and the last word does.
        for param in [&p, &q] {
            there.insert(param, here.slice_of(param).unwrap());
        }
        assert_eq!(
            (there.slice_of(&p), there.slice_of(&q)),
            (Some(&[2.0, 4.0][..]), Some(&[1.0][..]))
        );
        assert_eq!(there.norm().to_bits(), here.norm().to_bits());
        tape.reset();
    }
}
