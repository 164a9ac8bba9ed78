//! Gradient checks in `f64` against central differences, and an allocator that counts (feature
//! `testkit`).
//!
//! A check draws inputs, computes `L = Σ w ⊙ f(inputs)` with random weights `w` (so that every
//! output element counts), and compares the gradient of the tape with
//! `(L(x + ε) - L(x - ε)) / 2ε` for each element of each input.
//!
//! ```
//! use autodiff_lite::testkit::gradcheck;
//!
//! // Expands to a `#[test]`; each entry of `shapes` lists the shapes of all inputs.
//! gradcheck!(scaled_square: |x, s| x.square().mul(s), shapes [[[3, 5], [5]], [[1], []]]);
//! ```

use ndarray::{ArrayD, IxDyn};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{Tape, Var};

pub use crate::gradcheck;
pub use crate::kernels::counting::CountingAllocator;

/// How a check is made.
#[derive(Clone, Debug)]
pub struct Options {
    /// Step of the central differences.
    pub epsilon: f64,
    /// Largest allowed `|tape - differences| / max(1, |tape|, |differences|)`.
    pub tolerance: f64,
    /// Where inputs are drawn from.
    pub range: (f64, f64),
    /// Input values at which the function has a kink or a jump: no input is drawn within
    /// `100 ε` of them.
    pub kinks: Vec<f64>,
    /// Whether the function is smooth in pieces only, at borders that its inputs alone do not
    /// tell: ties of a maximum, the nearest of several edges. Where a piece ends within a step,
    /// the gradient has to be the derivative on one side.
    pub pieces: bool,
    /// At most this many elements of each input are probed, evenly spread.
    pub probes: usize,
    /// Seed of inputs and weights.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            epsilon: 1e-5,
            tolerance: 1e-7,
            range: (-1.5, 1.5),
            kinks: Vec::new(),
            pieces: false,
            probes: 400,
            seed: 0,
        }
    }
}

impl Options {
    /// These options with inputs from another range.
    #[must_use]
    pub fn range(mut self, low: f64, high: f64) -> Self {
        self.range = (low, high);
        self
    }

    /// These options with kinks at these input values.
    #[must_use]
    pub fn kinks(mut self, kinks: &[f64]) -> Self {
        self.kinks = kinks.to_vec();
        self
    }

    /// These options for a function of [`pieces`](Self::pieces).
    #[must_use]
    pub fn pieces(mut self) -> Self {
        self.pieces = true;
        self
    }

    /// These options with another tolerance.
    #[must_use]
    pub fn tolerance(mut self, tolerance: f64) -> Self {
        self.tolerance = tolerance;
        self
    }

    /// Random inputs of these shapes.
    ///
    /// # Shapes
    /// One array for each of `shapes`.
    pub fn draw(&self, shapes: &[Vec<usize>]) -> Vec<ArrayD<f64>> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut number = || loop {
            let x = rng.random_range(self.range.0..self.range.1);
            if self.kinks.iter().all(|kink| (x - kink).abs() > 100.0 * self.epsilon) {
                return x;
            }
        };
        shapes.iter().map(|s| ArrayD::from_shape_simple_fn(IxDyn(s), &mut number)).collect()
    }
}

/// A gradient that disagrees with the differences.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Mismatch {
    /// One element is off.
    #[error(
        "input {input}, element {element}: the rule gives {rule:e}, differences {differences:e}"
    )]
    Element {
        /// Which input.
        input: usize,
        /// Which element of it, in row-major order.
        element: usize,
        /// What the rule says.
        rule: f64,
        /// What the differences say.
        differences: f64,
    },
    /// More elements than [`MOST_UNDECIDED`] have borders of pieces so near on both sides that
    /// there is no derivative to compare with.
    #[error("{found} of {probed} elements have no derivative on either side")]
    Undecided {
        /// Elements without a derivative.
        found: usize,
        /// Elements probed.
        probed: usize,
    },
}

/// The closure itself: wrapping it lets the compiler see that input and output share a lifetime,
/// which it does not see in a closure that is bound to a name first.
///
/// # Shapes
/// Those that the closure takes and gives.
pub fn function<C>(f: C) -> C
where
    C: for<'t> Fn(&[Var<'t, f64>]) -> Var<'t, f64>,
{
    f
}

/// Checks the gradient of `f` at the given inputs.
///
/// # Shapes
/// `inputs`: those that `f` takes. What `f` gives may have any shape; its elements are summed with random weights.
///
/// # Errors
/// The first mismatch.
pub fn check<C>(f: &C, inputs: &[ArrayD<f64>], options: &Options) -> Result<(), Mismatch>
where
    C: for<'t> Fn(&[Var<'t, f64>]) -> Var<'t, f64>,
{
    let tape = Tape::<f64>::train(options.seed);
    let vars: Vec<_> = inputs.iter().map(|x| tape.leaf(x.clone())).collect();
    let output = f(&vars);
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed ^ 0x5EED);
    let weights =
        ArrayD::from_shape_simple_fn(IxDyn(&output.shape()), || rng.random_range(-1.0..1.0));
    let gradients = output.backward_with(weights.clone());

    let value = |inputs: &[ArrayD<f64>]| {
        let tape = Tape::<f64>::train(options.seed);
        let vars: Vec<_> = inputs.iter().map(|x| tape.constant(x.clone())).collect();
        (&*f(&vars).value() * &weights).sum()
    };
    let mut moved = inputs.to_vec();
    let center = value(&moved);
    let (mut undecided, mut probed) = (0, 0);
    for input in 0..inputs.len() {
        let gradient = gradients.wrt(vars[input]);
        let count = inputs[input].len();
        let stride = count.div_ceil(options.probes).max(1);
        for element in (0..count).step_by(stride) {
            let mut at = |step: f64| {
                let slot = &mut moved[input].as_slice_mut().expect("drawn row-major")[element];
                let before = *slot;
                *slot = before + step;
                let result = value(&moved);
                moved[input].as_slice_mut().expect("drawn row-major")[element] = before;
                result
            };
            let differences =
                (at(options.epsilon) - at(-options.epsilon)) / (2.0 * options.epsilon);
            let rule =
                gradient.as_ref().map_or(0.0, |g| *g.iter().nth(element).expect("same shape"));
            probed += 1;
            if agree(rule, differences, options.tolerance) {
                continue;
            }
            // A NaN anywhere ends in an error too.
            let verdict = if options.pieces {
                beside(&mut at, center, rule, options)
            } else {
                OneSided::Other
            };
            match verdict {
                OneSided::Rule => {}
                OneSided::None => undecided += 1,
                OneSided::Other => {
                    return Err(Mismatch::Element { input, element, rule, differences });
                }
            }
        }
    }
    if undecided as f64 > MOST_UNDECIDED * probed as f64 {
        return Err(Mismatch::Undecided { found: undecided, probed });
    }
    Ok(())
}

/// The largest part of the elements that may go unchecked in a function of
/// [`pieces`](Options::pieces).
pub const MOST_UNDECIDED: f64 = 0.02;

/// How often a step is quartered to get away from borders of pieces.
const QUARTERINGS: i32 = 3;

/// What the differences on each side of a place say of a rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OneSided {
    /// It is the derivative of one side.
    Rule,
    /// It is neither.
    Other,
    /// There are borders of pieces on both sides, however small the step.
    None,
}

fn agree(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * a.abs().max(b.abs()).max(1.0)
}

/// Compares a rule with the derivatives on each side of a place, of second order.
///
/// The differences that straddle a border of pieces are the derivative of neither. Those that stay on
/// one side are, whatever the border is, if there is none on that side; and smaller steps reach
/// fewer. `at` gives the value at a step from the place, `center` the value there.
fn beside(at: &mut impl FnMut(f64) -> f64, center: f64, rule: f64, options: &Options) -> OneSided {
    let mut derivative = |h: f64| (4.0 * at(h / 2.0) - at(h) - 3.0 * center) / h;
    let mut smooth = false;
    for quartering in 0..=QUARTERINGS {
        let step = options.epsilon * 0.25_f64.powi(quartering);
        let mut sides = [false; 2];
        for (side, h) in [step, -step].into_iter().enumerate() {
            let whole = derivative(h);
            if agree(rule, whole, options.tolerance) {
                return OneSided::Rule;
            }
            if !whole.is_finite() {
                return OneSided::Other;
            }
            sides[side] = agree(whole, derivative(h / 2.0), options.tolerance);
        }
        smooth |= sides == [true; 2];
    }
    if rule.is_finite() && !smooth { OneSided::None } else { OneSided::Other }
}

/// Checks the gradient of `f` at random inputs of these shapes.
///
/// # Shapes
/// `shapes`: one for each input that `f` takes.
///
/// # Panics
/// With the first mismatch.
#[track_caller]
pub fn assert_gradients<C>(f: &C, shapes: &[Vec<usize>], options: &Options)
where
    C: for<'t> Fn(&[Var<'t, f64>]) -> Var<'t, f64>,
{
    for seed in 0..3 {
        let options = Options { seed: options.seed + seed, ..options.clone() };
        if let Err(mismatch) = check(f, &options.draw(shapes), &options) {
            panic!("gradient at shapes {shapes:?}, seed {}: {mismatch}", options.seed);
        }
    }
}

/// A `#[test]` that checks the gradient of an operation at each list of shapes.
///
/// `gradcheck!(name: |a, b| a.mul(b), shapes [[[3], [3]], [[2, 3], [3]]])`, optionally followed by
/// `, options EXPR`, an [`Options`](crate::testkit::Options).
#[macro_export]
macro_rules! gradcheck {
    ($name:ident: |$($x:ident),+| $body:expr, shapes [$([$([$($n:expr),*]),+]),+ $(,)?] $(, options $options:expr)? $(,)?) => {
        #[test]
        fn $name() {
            #[allow(unused_mut, unused_assignments, reason = "options may be given")]
            let mut options = $crate::testkit::Options::default();
            $(options = $options;)?
            let cases: &[&[&[usize]]] = &[$(&[$(&[$($n),*]),+]),+];
            for shapes in cases {
                let shapes: Vec<Vec<usize>> = shapes.iter().map(|s| s.to_vec()).collect();
                $crate::testkit::assert_gradients(
                    &|inputs: &[$crate::Var<'_, f64>]| {
                        let [$($x),+] = *inputs else { panic!("each case needs all inputs") };
                        $body
                    },
                    &shapes,
                    &options,
                );
            }
        }
    };
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::Backward;

    /// `x²` with a rule that forgets the factor two.
    fn wrong_square<'t>(x: &[Var<'t, f64>]) -> Var<'t, f64> {
        x[0].map(|x| x * x, |x, _| x)
    }

    #[test]
    fn a_wrong_rule_is_found() {
        let options = Options::default();
        let inputs = options.draw(&[vec![3]]);
        let mismatch = check(&wrong_square, &inputs, &options).unwrap_err();
        let Mismatch::Element { input: 0, element: 0, rule, differences } = mismatch else {
            panic!("{mismatch}")
        };
        assert!((differences - 2.0 * rule).abs() < 1e-6, "{mismatch}");
    }

    #[test]
    #[should_panic(
        expected = "gradient at shapes [[3]], seed 0: input 0, element 0: the rule gives"
    )]
    fn a_wrong_rule_fails_a_test() {
        assert_gradients(&wrong_square, &[vec![3]], &Options::default());
    }

    /// A rule that forgets one of two inputs, and one that adds to the wrong element.
    #[test]
    fn forgotten_inputs_and_places_are_found() {
        let options = Options::default();
        let forgets = function(|x| {
            let y = &*x[0].value() * &*x[1].value();
            x[0].tape().record_fn("forgets", x, y, |cx: &mut Backward<'_, f64>| {
                let g = &*cx.grad_out() * &*cx.input(1);
                cx.give(0, g);
            })
        });
        let inputs = options.draw(&[vec![2], vec![2]]);
        let mismatch = check(&forgets, &inputs, &options).unwrap_err();
        assert!(matches!(mismatch, Mismatch::Element { input: 1, rule: 0.0, .. }), "{mismatch}");

        let shifts = function(|x| {
            x[0].tape().record_fn("shifts", x, x[0].value(), |cx: &mut Backward<'_, f64>| {
                let mut g = cx.take_grad_out();
                g.as_slice_mut().rotate_left(1);
                cx.give(0, g);
            })
        });
        check(&shifts, &options.draw(&[vec![3]]), &options).unwrap_err();
    }

    #[test]
    fn a_gradient_that_is_not_a_number_is_found() {
        let options = Options::default();
        let poisoned = function(|x| x[0].map(|x| x, |_, _| f64::NAN));
        check(&poisoned, &options.draw(&[vec![1]]), &options).unwrap_err();
    }

    /// Across a kink the differences are neither one derivative nor the other, and the rule of either
    /// side is right; their mean is not, nor is a derivative of elsewhere.
    #[test]
    fn beside_a_kink_the_rule_is_the_derivative_of_one_side() {
        let near = [ndarray::arr1(&[3e-6, 1.0, -1.0, -2e-6]).into_dyn()];
        let kinked = |[low, high]: [f64; 2]| {
            function(move |x| {
                x[0].map(|x| x.max(0.0) - 0.5 * x, move |x, _| if x > 0.0 { high } else { low })
            })
        };
        let (plain, pieces) = (Options::default(), Options::default().pieces());
        let right = kinked([-0.5, 0.5]);
        check(&right, &near, &plain).unwrap_err();
        check(&right, &near, &pieces).unwrap();
        for wrong in [[-0.5, 0.4], [0.0, 0.5], [-0.5, f64::NAN]] {
            check(&kinked(wrong), &near, &pieces).unwrap_err();
        }
    }

    /// Where borders lie nearer together than any step there is nothing to compare with: one
    /// place in fifty may be so.
    #[test]
    fn few_places_may_have_no_derivative() {
        let rough = |x: f64| if x > 0.5 { 1e-6 * (1e10 * x).sin() } else { x };
        let f = function(|x| x[0].map(rough, |x, _| f64::from(x <= 0.5)));
        let options = Options { tolerance: 1e-5, ..Options::default().pieces() };
        let places = |count: usize| {
            let mut x = ndarray::Array1::<f64>::zeros(count);
            x[3] = 0.7;
            [x.into_dyn()]
        };
        check(&f, &places(60), &options).unwrap();
        let mismatch = check(&f, &places(40), &options).unwrap_err();
        assert_eq!(mismatch, Mismatch::Undecided { found: 1, probed: 40 });
    }

    #[test]
    fn inputs_keep_away_from_kinks() {
        let options = Options { epsilon: 1e-3, ..Options::default().kinks(&[0.0]) };
        assert!(options.draw(&[vec![500]])[0].iter().all(|x| x.abs() > 0.1));
    }
}
