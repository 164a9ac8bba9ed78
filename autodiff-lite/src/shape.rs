//! Shape mistakes: one format, at the caller, with every operand named.
//!
//! A wrong shape is a mistake in the program, so it panics; the same text is the `Display` of
//! [`ShapeError`] for pure functions that check a configuration before anything runs.
//!
//! ```text
//! conv2d: C is 64 in input and 32 in weight
//!   input   [8, 56, 56, 64]   (N, H, W, C)
//!   weight  [128, 32, 3, 3]   (O, C, KH, KW)
//!   at encoder.layer2.0.conv1
//! ```

use std::fmt;

/// A mistake in the shapes given to an operation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShapeError {
    op: &'static str,
    message: String,
    operands: Vec<Operand>,
    path: String,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Operand {
    name: String,
    shape: Vec<usize>,
    letters: String,
}

impl std::error::Error for ShapeError {}

impl ShapeError {
    /// A mistake of operation `op`, said in half a sentence.
    pub fn new(op: &'static str, message: impl Into<String>) -> Self {
        Self { op, message: message.into(), operands: Vec::new(), path: String::new() }
    }

    /// Adds an operand with its dimension letters, for example `"N, H, W, C"` (may be empty).
    #[must_use]
    pub fn operand(mut self, name: &str, shape: &[usize], letters: &str) -> Self {
        let (name, shape, letters) = (name.to_owned(), shape.to_vec(), letters.to_owned());
        self.operands.push(Operand { name, shape, letters });
        self
    }

    /// Adds the path of the module that made the call.
    #[must_use]
    pub fn at(mut self, path: impl Into<String>) -> Self {
        self.path = path.into();
        self
    }

    /// Panics with this text, at the caller.
    #[track_caller]
    #[cold]
    pub fn panic(self) -> ! {
        panic!("{self}")
    }
}

impl fmt::Display for ShapeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.op, self.message)?;
        let name_width = self.operands.iter().map(|o| o.name.len()).max().unwrap_or(0);
        let shapes: Vec<String> = self.operands.iter().map(|o| format!("{:?}", o.shape)).collect();
        let shape_width = shapes.iter().map(String::len).max().unwrap_or(0);
        for (operand, shape) in self.operands.iter().zip(&shapes) {
            write!(f, "\n  {:name_width$}  {shape}", operand.name)?;
            if !operand.letters.is_empty() {
                let gap = shape_width - shape.len() + 3;
                write!(f, "{:gap$}({})", "", operand.letters)?;
            }
        }
        if !self.path.is_empty() {
            write!(f, "\n  at {}", self.path)?;
        }
        Ok(())
    }
}

/// Binds dimension letters across the operands of one operation.
///
/// ```
/// use autodiff_lite::Shapes;
///
/// let mut shapes = Shapes::of("linear");
/// let [n, d] = shapes.axes("input", &[8, 3], ["N", "D"])?;
/// let [o, _] = shapes.axes("weight", &[5, 3], ["O", "D"])?;
/// assert_eq!([n, d, o], [8, 3, 5]);
/// assert!(shapes.axes("bias", &[4], ["O"]).is_err());
/// # Ok::<(), autodiff_lite::ShapeError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Shapes {
    op: &'static str,
    path: String,
    bound: Vec<(&'static str, usize, String)>,
    operands: Vec<Operand>,
}

impl Shapes {
    /// Begins the check of operation `op`.
    pub fn of(op: &'static str) -> Self {
        Self { op, path: String::new(), bound: Vec::new(), operands: Vec::new() }
    }

    /// Says where in the model the operation stands.
    #[must_use]
    pub fn at(mut self, path: impl Into<String>) -> Self {
        self.path = path.into();
        self
    }

    /// The sizes of `shape`, whose axes carry these letters.
    ///
    /// # Errors
    /// If the rank differs, or a letter was bound to another size by an earlier operand. `"_"`
    /// binds nothing.
    pub fn axes<const N: usize>(
        &mut self,
        name: &str,
        shape: &[usize],
        letters: [&'static str; N],
    ) -> Result<[usize; N], ShapeError> {
        self.note(name, shape, &letters, false);
        let Ok(sizes) = <[usize; N]>::try_from(shape) else {
            return Err(self.error(format!("{name} has {} axes instead of {N}", shape.len())));
        };
        self.bind(name, letters, sizes)?;
        Ok(sizes)
    }

    /// The product of the leading sizes of `shape`, and those of its last axes, which carry these letters.
    ///
    /// # Errors
    /// As [`axes`](Self::axes), but for any number of leading axes.
    pub(crate) fn last_axes<const N: usize>(
        &mut self,
        name: &str,
        shape: &[usize],
        letters: [&'static str; N],
    ) -> Result<(usize, [usize; N]), ShapeError> {
        self.note(name, shape, &letters, true);
        let Some((leading, &sizes)) = shape.split_last_chunk::<N>() else {
            let message = format!("{name} has {} axes instead of {N} or more", shape.len());
            return Err(self.error(message));
        };
        self.bind(name, letters, sizes)?;
        Ok((leading.iter().product(), sizes))
    }

    fn note(&mut self, name: &str, shape: &[usize], letters: &[&str], leading: bool) {
        let letters = [if leading { ".., " } else { "" }, &letters.join(", ")].concat();
        let (name, shape) = (name.to_owned(), shape.to_vec());
        self.operands.push(Operand { name, shape, letters });
    }

    fn bind<const N: usize>(
        &mut self,
        name: &str,
        letters: [&'static str; N],
        sizes: [usize; N],
    ) -> Result<(), ShapeError> {
        for (&letter, &size) in letters.iter().zip(&sizes).filter(|(l, _)| **l != "_") {
            match self.bound.iter().find(|(known, ..)| *known == letter) {
                Some((_, other, place)) if *other != size => {
                    return Err(
                        self.error(format!("{letter} is {other} in {place} and {size} in {name}"))
                    );
                }
                Some(_) => {}
                None => self.bound.push((letter, size, name.to_owned())),
            }
        }
        Ok(())
    }

    /// An error that lists all operands seen so far.
    pub fn error(&self, message: impl Into<String>) -> ShapeError {
        ShapeError {
            op: self.op,
            message: message.into(),
            operands: self.operands.clone(),
            path: self.path.clone(),
        }
    }
}

/// The shape of `a` combined with `b` by NumPy's rules, or `None` if they do not fit.
///
/// ```
/// use autodiff_lite::broadcast_shape;
///
/// assert_eq!(broadcast_shape(&[8, 1, 3], &[5, 1]), Some(vec![8, 5, 3]));
/// assert_eq!(broadcast_shape(&[2], &[3]), None);
/// ```
pub fn broadcast_shape(a: &[usize], b: &[usize]) -> Option<Vec<usize>> {
    let rank = a.len().max(b.len());
    let size = |shape: &[usize], k: usize| {
        (k + shape.len()).checked_sub(rank).map_or(1, |axis| shape[axis])
    };
    (0..rank)
        .map(|k| match (size(a, k), size(b, k)) {
            (x, y) if x == y => Some(x),
            (1, y) => Some(y),
            (x, 1) => Some(x),
            _ => None,
        })
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn the_house_format() {
        let mut shapes = Shapes::of("conv2d").at("encoder.conv1");
        shapes.axes("input", &[8, 56, 56, 64], ["N", "H", "W", "C"]).expect("four axes");
        let error = shapes.axes("weight", &[128, 32, 3, 3], ["O", "C", "KH", "KW"]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "conv2d: C is 64 in input and 32 in weight\n\
             \x20 input   [8, 56, 56, 64]   (N, H, W, C)\n\
             \x20 weight  [128, 32, 3, 3]   (O, C, KH, KW)\n\
             \x20 at encoder.conv1"
        );
    }

    #[test]
    fn leading_axes_are_shown_as_they_are() {
        let mut shapes = Shapes::of("linear");
        assert_eq!(shapes.last_axes("input", &[2, 3, 4], ["D"]).unwrap(), (6, [4]));
        let error = shapes.axes("weight", &[7, 5], ["O", "D"]).unwrap_err();
        assert!(error.to_string().contains("input   [2, 3, 4]   (.., D)"), "{error}");
        let error = shapes.last_axes("input", &[], ["D"]).unwrap_err();
        assert!(error.to_string().contains("input has 0 axes instead of 1 or more"), "{error}");
    }

    #[test]
    fn a_wrong_rank_is_named() {
        let error = Shapes::of("softmax").axes("input", &[], ["N", "D"]).unwrap_err();
        assert!(error.to_string().contains("input has 0 axes instead of 2"), "{error}");
    }
}
