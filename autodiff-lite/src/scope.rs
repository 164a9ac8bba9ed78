//! Named parts of a model: what panics name, and what an eval tape frees.

use std::cell::RefCell;

use crate::{Real, ShapeError, Shapes, Tape, Var};

impl<F: Real> Tape<F> {
    /// Runs a part of a model under a name.
    ///
    /// The names of the open scopes, joined by dots, are the module path in panics. On an eval
    /// tape everything computed inside is freed at the end, but for what the closure returns;
    /// touching a freed value panics with the name of its operation.
    ///
    /// ```
    /// use autodiff_lite::Tape;
    ///
    /// let tape = Tape::<f32>::eval();
    /// let x = tape.constant(ndarray::arr1(&[1.0, 2.0]));
    /// let y = tape.scope("block", || x.square().sum());
    /// assert_eq!(y.item(), 5.0);
    /// ```
    pub fn scope<'t, R: Handles<'t, F>>(&'t self, name: &str, f: impl FnOnce() -> R) -> R {
        let _path = self.enter(name);
        let start = self.len();
        let result = f();
        if !self.is_recording() {
            let mut kept = Vec::new();
            result.for_each(&mut |var| kept.push(var.id as usize));
            let mut nodes = self.nodes.borrow_mut();
            for (id, node) in nodes.iter_mut().enumerate().skip(start) {
                // A parameter is only a reference count, and may be asked for again.
                if node.param.is_none()
                    && !kept.contains(&id)
                    && let Some(value) = node.value.take()
                {
                    self.recycle(value);
                }
            }
        }
        result
    }

    /// Opens a name without freeing anything; dropping the guard closes it.
    fn enter(&self, name: &str) -> PathGuard<'_> {
        let mut path = self.path.borrow_mut();
        let len = path.len();
        if len > 0 {
            path.push('.');
        }
        path.push_str(name);
        PathGuard { path: &self.path, len }
    }

    /// The names of the open scopes, joined by dots.
    pub fn path(&self) -> String {
        self.path.borrow().clone()
    }

    /// What an operation takes from the shapes of its operands, once `check` has named their axes.
    ///
    /// ```
    /// use autodiff_lite::Tape;
    ///
    /// let tape = Tape::<f32>::eval();
    /// let [n, d] = tape.check("linear", |shapes| {
    ///     let sizes = shapes.axes("input", &[8, 3], ["N", "D"])?;
    ///     shapes.axes("weight", &[5, 3], ["O", "D"])?;
    ///     Ok(sizes)
    /// });
    /// assert_eq!([n, d], [8, 3]);
    /// ```
    ///
    /// # Panics
    /// With the mistake that `check` has found, at the caller.
    #[track_caller]
    pub fn check<R>(
        &self,
        op: &'static str,
        check: impl FnOnce(&mut Shapes) -> Result<R, ShapeError>,
    ) -> R {
        // The path is copied for those that fail alone.
        match check(&mut Shapes::of(op)) {
            Ok(found) => found,
            Err(error) => error.at(self.path()).panic(),
        }
    }

    /// Panics at the caller of operation `op`: a [`ShapeError`] with the names, shapes and dimension
    /// letters of its operands.
    #[track_caller]
    #[cold]
    pub fn refuse(
        &self,
        op: &'static str,
        message: impl Into<String>,
        operands: &[(&str, &[usize], &str)],
    ) -> ! {
        let mut error = ShapeError::new(op, message).at(self.path());
        for (name, shape, letters) in operands {
            error = error.operand(name, shape, letters);
        }
        error.panic()
    }
}

struct PathGuard<'t> {
    path: &'t RefCell<String>,
    len: usize,
}

impl Drop for PathGuard<'_> {
    fn drop(&mut self) {
        self.path.borrow_mut().truncate(self.len);
    }
}

/// What a [scope](Tape::scope) may return: handles, and arrays, vectors, options, tuples of them.
pub trait Handles<'t, F: Real> {
    /// Calls `f` with each handle.
    ///
    /// # Shapes
    /// Any; the handles need not be alike.
    fn for_each(&self, f: &mut dyn FnMut(Var<'t, F>));
}

impl<'t, F: Real> Handles<'t, F> for Var<'t, F> {
    fn for_each(&self, f: &mut dyn FnMut(Var<'t, F>)) {
        f(*self);
    }
}

impl<'t, F: Real, H: Handles<'t, F>> Handles<'t, F> for Vec<H> {
    fn for_each(&self, f: &mut dyn FnMut(Var<'t, F>)) {
        for handles in self {
            handles.for_each(f);
        }
    }
}

impl<'t, F: Real, H: Handles<'t, F>, const N: usize> Handles<'t, F> for [H; N] {
    fn for_each(&self, f: &mut dyn FnMut(Var<'t, F>)) {
        for handles in self {
            handles.for_each(f);
        }
    }
}

impl<'t, F: Real, H: Handles<'t, F>> Handles<'t, F> for Option<H> {
    fn for_each(&self, f: &mut dyn FnMut(Var<'t, F>)) {
        if let Some(handles) = self {
            handles.for_each(f);
        }
    }
}

impl<'t, F: Real, A: Handles<'t, F>, B: Handles<'t, F>> Handles<'t, F> for (A, B) {
    fn for_each(&self, f: &mut dyn FnMut(Var<'t, F>)) {
        self.0.for_each(f);
        self.1.for_each(f);
    }
}

impl<'t, F, A, B, C> Handles<'t, F> for (A, B, C)
where
    F: Real,
    A: Handles<'t, F>,
    B: Handles<'t, F>,
    C: Handles<'t, F>,
{
    fn for_each(&self, f: &mut dyn FnMut(Var<'t, F>)) {
        self.0.for_each(f);
        self.1.for_each(f);
        self.2.for_each(f);
    }
}

#[cfg(test)]
mod tests {
    use ndarray::arr1;

    use super::*;

    #[test]
    #[should_panic(expected = "the result of `square` was freed when its scope ended")]
    fn an_eval_scope_frees_what_it_does_not_return() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(arr1(&[1.0, 2.0]));
        let mut inner = None;
        let y = tape.scope("block", || {
            let square = x.square();
            inner = Some(square);
            square.sum()
        });
        assert_eq!(y.item(), 5.0);
        assert_eq!(x.value().len(), 2, "what came from outside stays");
        let _ = inner.expect("set in the scope").value();
    }

    #[test]
    fn a_training_scope_frees_nothing() {
        let tape = Tape::<f32>::train(0);
        let x = tape.leaf(arr1(&[1.0, 2.0]));
        let mut inner = None;
        let _ = tape.scope("block", || {
            inner = Some(x.square());
            x.sum()
        });
        assert_eq!(inner.expect("set in the scope").value().len(), 2);
    }

    #[test]
    fn paths_nest() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(arr1(&[1.0]));
        let _ = tape.scope("encoder", || {
            tape.scope("layer1.0", || {
                assert_eq!(tape.path(), "encoder.layer1.0");
                x
            })
        });
        assert_eq!(tape.path(), "");
    }
}
