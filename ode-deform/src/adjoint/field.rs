//! Fields that have parameters.

use autodiff_lite::{Module, Real, Var, Visitor, VisitorMut};

/// `dy/dt = f(t, y; inputs)` on a tape, with parameters.
///
/// Parameters are found through [`Module`]; everything else that a gradient is wanted for (image features, a code)
/// must come in as `inputs`, since an adjoint evaluates the field again on tapes of its own: a variable of another tape
/// that a field holds would be refused there. The field is a function: what it draws (dropout) is the same at every
/// evaluation of one integration, but for [`Direct`](crate::Adjoint::Direct).
pub trait VectorField<F: Real = f32>: Module<F> + Clone + Send + 'static {
    /// The derivative, on the tape of `y`.
    ///
    /// # Shapes
    /// `y`: any, `inputs`: those of the field → that of `y`. `t` is the time.
    fn eval<'t>(&self, t: f64, y: Var<'t, F>, inputs: &[Var<'t, F>]) -> Var<'t, F>;
}

/// A module and a function as a field; see [`field_fn`].
#[derive(Clone, Debug)]
pub struct FieldFn<M, C> {
    module: M,
    function: C,
}

/// A field from a module and a function of it.
///
/// ```
/// use autodiff_lite::{Activation, Tape, Var};
/// use nets::{Init, Mlp};
/// use ode_deform::{Adjoint, field_fn};
/// use ode_deform::solve::{Problem, RK4, StepController};
///
/// let mlp = Mlp::<f32>::new(&Init::new(0), &[2, 16, 2], Activation::Tanh);
/// let field = field_fn(mlp, |mlp: &Mlp, _, y: Var<'_>, _| mlp.forward(y));
/// let tape = Tape::train(0);
/// let points = tape.leaf(ndarray::arr2(&[[1.0, 0.0], [0.0, 1.0]]));
/// let problem = Problem::new([0.0, 1.0], &RK4, StepController::Fixed { step: 0.1 });
/// let flow = Adjoint::default().integrate(&field, points, &[], &problem)?;
/// let gradients = flow.end.square().sum().backward();
/// assert!(gradients.wrt(points).is_some() && gradients.of(&field.module().layers[0].weight).is_some());
/// # Ok::<(), ode_deform::solve::SolveError>(())
/// ```
///
/// # Shapes
/// Those of [`VectorField::eval`]: the function gives the shape of `y`.
pub fn field_fn<F, M, C>(module: M, function: C) -> FieldFn<M, C>
where
    F: Real,
    M: Module<F>,
    C: for<'t> Fn(&M, f64, Var<'t, F>, &[Var<'t, F>]) -> Var<'t, F>,
{
    FieldFn { module, function }
}

impl<M, C> FieldFn<M, C> {
    /// The module.
    pub fn module(&self) -> &M {
        &self.module
    }

    /// The module, to be trained.
    pub fn module_mut(&mut self) -> &mut M {
        &mut self.module
    }
}

impl<F: Real, M: Module<F>, C> Module<F> for FieldFn<M, C> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        self.module.visit(path, visitor);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        self.module.visit_mut(path, visitor);
    }
}

impl<F, M, C> VectorField<F> for FieldFn<M, C>
where
    F: Real,
    M: Module<F> + Clone + Send + 'static,
    C: for<'t> Fn(&M, f64, Var<'t, F>, &[Var<'t, F>]) -> Var<'t, F> + Clone + Send + 'static,
{
    fn eval<'t>(&self, t: f64, y: Var<'t, F>, inputs: &[Var<'t, F>]) -> Var<'t, F> {
        (self.function)(&self.module, t, y, inputs)
    }
}
