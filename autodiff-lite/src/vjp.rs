//! A function of arrays, computed once and pulled back whenever it is asked for.

use crate::{NestedTape, Real, Tensor, Var};

/// The value of a function with the tape that it was recorded on: JAX's `vjp`, as one value that owns all it needs.
///
/// [`Var`]s borrow their tape, so neither can be kept where nothing is borrowed, in an object of another language say. This can: it
/// may be moved to another thread, and be pulled back any number of times.
///
/// ```
/// use autodiff_lite::{Tape, Vjp};
/// use ndarray::arr1;
///
/// let home = Tape::<f64>::train(0); // whose memory is used
/// let inputs = [arr1(&[2.0, 3.0]).into(), arr1(&[5.0, 7.0]).into()];
/// let product = Vjp::new(home.nested(), inputs, [true, false], |[x, y]| x * y);
/// assert_eq!(product.value().as_slice(), [10.0, 21.0]);
/// let [of_x, of_y] = product.pullback(arr1(&[1.0, -1.0]));
/// assert_eq!(of_x.expect("wanted").as_slice(), [5.0, -7.0]);
/// assert!(of_y.is_none());
/// ```
#[derive(Debug)]
pub struct Vjp<F: Real = f32, const N: usize = 1> {
    tape: NestedTape<F>,
    inputs: [u32; N],
    output: u32,
}

impl<F: Real, const N: usize> Vjp<F, N> {
    /// Computes a function on a tape of its own, and keeps it.
    ///
    /// # Shapes
    /// `inputs` of any shapes, as `f` wants them. `wanted` says for each whether its gradient will be asked for.
    ///
    /// # Panics
    /// If it is an eval tape, or the result of `f` is of another tape than its inputs.
    #[track_caller]
    pub fn new(
        tape: NestedTape<F>,
        inputs: [Tensor<F>; N],
        wanted: [bool; N],
        f: impl for<'t> FnOnce([Var<'t, F>; N]) -> Var<'t, F>,
    ) -> Self {
        assert!(tape.is_recording(), "Vjp::new on an eval tape: nothing would be recorded");
        let mut wanted = wanted.into_iter();
        let variables = inputs.map(|input| match wanted.next() {
            Some(true) => tape.leaf(input),
            _ => tape.constant(input),
        });
        let output = f(variables);
        assert!(std::ptr::eq(output.tape, &raw const *tape), "Vjp::new: a value of another tape");
        let (inputs, output) = (variables.map(|variable| variable.id), output.id);
        Self { tape, inputs, output }
    }

    fn output(&self) -> Var<'_, F> {
        Var { tape: &self.tape, id: self.output }
    }

    /// The value of the function, shared by reference count.
    ///
    /// # Shapes
    /// That of what the function returned.
    pub fn value(&self) -> Tensor<F> {
        self.output().value()
    }

    /// The gradients of `Σ cotangent ⊙ value` with respect to the inputs: `None` where none is wanted, or none arrives.
    ///
    /// # Shapes
    /// `cotangent`: that of the value. Each gradient has the shape of its input.
    ///
    /// # Panics
    /// If the cotangent has another shape.
    #[track_caller]
    pub fn pullback(&self, cotangent: impl Into<Tensor<F>>) -> [Option<Tensor<F>>; N] {
        if !self.output().needs_grad() {
            return [const { None }; N];
        }
        let gradients = self.output().backward_with(cotangent);
        self.inputs.map(|id| gradients.wrt(Var { tape: &self.tape, id }).cloned())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::{arr1, arr2};

    use super::*;
    use crate::Tape;

    #[test]
    fn it_outlives_where_it_was_made_and_is_pulled_back_twice() {
        let home = Tape::<f64>::train(0);
        let input = Tensor::from(arr2(&[[1.0, 2.0], [3.0, 4.0]]));
        let made = Vjp::new(home.nested(), [input], [true], |[x]| x.square());
        drop(home);
        let gradients = std::thread::spawn(move || {
            let one = arr2(&[[1.0, 0.0], [0.0, 0.0]]);
            let [first] = made.pullback(one.clone());
            let [second] = made.pullback(&one * 3.0);
            [first.unwrap(), second.unwrap()]
        });
        let [first, second] = gradients.join().unwrap();
        assert_eq!(first.as_slice(), [2.0, 0.0, 0.0, 0.0]);
        assert_eq!(second.as_slice(), [6.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn an_input_that_does_not_matter_has_no_gradient() {
        let home = Tape::<f32>::train(0);
        let inputs = [arr1(&[1.0]), arr1(&[2.0])].map(Tensor::from);
        let first = Vjp::new(home.nested(), inputs.clone(), [true, true], |[x, _]| x.square());
        let [of_x, of_y] = first.pullback(arr1(&[1.0]));
        assert_eq!((of_x.unwrap().as_slice(), of_y), (&[2.0][..], None));
        let none = Vjp::new(home.nested(), inputs, [false, false], |[x, y]| x * y);
        assert_eq!(none.pullback(arr1(&[1.0])), [None, None]);
    }

    #[test]
    fn memory_comes_from_home_and_returns_there() {
        let home = Tape::<f32>::train(0);
        let bytes = || {
            let tape = home.nested();
            let mut input = tape.array(&[2000]);
            input.as_slice_mut().fill(1.0);
            drop(Vjp::new(tape, [input], [true], |[x]| x + x));
            home.pool().bytes()
        };
        let [first, again] = [bytes(), bytes()];
        assert!(first >= 16_000, "the input and the sum");
        assert_eq!(again, first);
    }

    #[test]
    #[should_panic(expected = "the seed needs the shape of the value")]
    fn a_cotangent_of_another_shape() {
        let home = Tape::<f32>::train(0);
        let _ = Vjp::new(home.nested(), [arr1(&[1.0]).into()], [true], |[x]| x)
            .pullback(arr1(&[1.0; 2]));
    }
}
