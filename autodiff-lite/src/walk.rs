//! The reverse walk, from a value to all it depends on.

use crate::{Backward, Gradients, Real, Tape, Tensor, Var};

impl<F: Real> Var<'_, F> {
    /// Gradients of this scalar with respect to every leaf and trainable parameter it depends on; of a value that depends on
    /// none ([`needs_grad`](Self::needs_grad)) there are none.
    ///
    /// # Shapes
    /// `self`: one element, `[]` or `[1]`. Each gradient has the shape of what it is the gradient of.
    ///
    /// # Panics
    /// If it has more than one element, or lives on an eval tape.
    #[track_caller]
    #[inline(never)]
    pub fn backward(self) -> Gradients<F> {
        let shape = self.shape();
        if shape.iter().product::<usize>() != 1 {
            let operands = [("value", &shape[..], "")];
            self.tape.refuse("backward", "a scalar expected; see backward_with", &operands);
        }
        self.tape.backward_from(self.id, self.tape.pool.filled(&shape, F::one()))
    }

    /// Gradients of `Σ seed ⊙ self`: a product of a vector with the Jacobian.
    ///
    /// # Shapes
    /// `seed`: that of `self`. Each gradient has the shape of what it is the gradient of.
    ///
    /// # Panics
    /// If the shape of `seed` is another, or the tape is an eval tape.
    #[track_caller]
    pub fn backward_with(self, seed: impl Into<Tensor<F>>) -> Gradients<F> {
        let seed = seed.into();
        let shape = self.shape();
        if seed.shape() != shape {
            let operands = [("seed", seed.shape(), ""), ("value", &shape, "")];
            self.tape.refuse("backward_with", "the seed needs the shape of the value", &operands);
        }
        self.tape.backward_from(self.id, self.tape.pool.copy(&seed))
    }
}

impl<F: Real> Tape<F> {
    /// Walks from node `root` to the leaves. Gradients in between go back to the pool as soon as
    /// their rule has run.
    #[track_caller]
    #[inline(never)]
    pub(crate) fn backward_from(&self, root: u32, seed: Tensor<F>) -> Gradients<F> {
        assert!(self.is_recording(), "backward on an eval tape: nothing was recorded");
        let (nodes, ops) = (self.nodes.borrow(), self.ops.borrow());
        let edges = self.edges.borrow();
        let mut slots = self.slots.take();
        slots.resize_with(nodes.len().max(slots.len()), || None);
        let mut gradients = Gradients::empty(&self.spare, &self.pool, self.epoch.get());
        slots[root as usize] = Some(seed);
        for id in (0..=root as usize).rev() {
            let Some(gradient) = slots[id].take() else { continue };
            let node = &nodes[id];
            let Some(op) = &ops[id] else {
                if node.needs_grad {
                    gradients.push(id as u32, node.param, gradient);
                } else {
                    self.pool.recycle(gradient);
                }
                continue;
            };
            let first = node.first_edge as usize;
            let mut cx = Backward {
                nodes: &nodes,
                inputs: &edges[first..first + node.edge_count as usize],
                node: id,
                grad_out: Some(gradient),
                slots: &mut slots[..id],
                pool: &self.pool,
            };
            op.pullback(&mut cx);
            if let Some(rest) = cx.grad_out.take() {
                self.pool.recycle(rest);
            }
        }
        *self.slots.borrow_mut() = slots;
        gradients.sort();
        gradients
    }
}

impl<F: Real> Gradients<F> {
    /// The gradient of a [leaf](Tape::leaf) or of a parameter's node, if the scalar depends on it.
    /// Values in between have none: their gradients were recycled.
    ///
    /// # Shapes
    /// That of `var`.
    ///
    /// # Panics
    /// If the tape was reset since, or the value is of another tape.
    #[track_caller]
    pub fn wrt(&self, var: Var<'_, F>) -> Option<&Tensor<F>> {
        let epoch = var.tape.epoch.get();
        assert_eq!(epoch, self.epoch, "these gradients are of an earlier step or of another tape");
        let param = var.tape.node(var.id).param;
        // By identity where there is one: gradients that came from elsewhere know no node.
        param.map_or_else(|| self.of_node(var.id), |param| self.of_id(param))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::arr1;

    use super::*;
    use crate::Param;

    #[test]
    fn a_product_with_the_jacobian() {
        let tape = Tape::<f64>::train(0);
        let x = tape.leaf(arr1(&[1.0, 2.0, 3.0]));
        let gradients = x.square().backward_with(arr1(&[1.0, 0.0, -1.0]));
        assert_eq!(gradients.wrt(x).unwrap().as_slice(), [2.0, 0.0, -6.0]);
    }

    #[test]
    fn a_tape_can_be_walked_twice() {
        let tape = Tape::<f64>::train(0);
        let x = tape.leaf(arr1(&[3.0]));
        let (a, b) = (x.square().sum(), x.sum());
        let (of_a, of_b, again) = (a.backward(), b.backward(), a.backward());
        assert_eq!(of_a.wrt(x).unwrap()[0], 6.0);
        assert_eq!(of_b.wrt(x).unwrap()[0], 1.0);
        assert_eq!(again.wrt(x).unwrap()[0], 6.0);
    }

    #[test]
    #[should_panic(expected = "these gradients are of an earlier step")]
    fn gradients_of_an_earlier_step_know_no_new_values() {
        let mut tape = Tape::<f64>::train(0);
        let x = tape.leaf(arr1(&[3.0]));
        let gradients = x.sum().backward();
        tape.reset();
        let y = tape.leaf(arr1(&[4.0]));
        let _ = gradients.wrt(y);
    }

    #[test]
    #[should_panic(expected = "these gradients are of an earlier step or of another tape")]
    fn gradients_know_no_values_of_another_tape() {
        let (a, b) = (Tape::<f64>::train(0), Tape::<f64>::train(0));
        let gradients = a.leaf(arr1(&[3.0])).sum().backward();
        let _ = gradients.wrt(b.leaf(arr1(&[4.0])));
    }

    #[test]
    fn gradients_from_elsewhere_are_found_by_their_parameter() {
        let (p, q) = (Param::<f64>::new(arr1(&[1.0])), Param::<f64>::new(arr1(&[2.0])));
        let (a, b) = (Tape::train(0), Tape::train(0));
        let (x, y) = (a.param(&p), a.param(&q));
        let mut gradients = x.square().sum().backward();
        gradients.accumulate(&b.param(&q).square().sum().backward());
        assert_eq!([x, y].map(|x| gradients.wrt(x).unwrap()[0]), [2.0, 4.0]);
    }

    #[test]
    #[should_panic(expected = "backward on an eval tape")]
    fn an_eval_tape_records_nothing() {
        let tape = Tape::<f64>::eval();
        let x = tape.leaf(arr1(&[3.0]));
        let _ = x.sum().backward();
    }
}
