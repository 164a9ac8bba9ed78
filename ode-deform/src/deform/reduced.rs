//! The velocity of vertices with the first layer's work on features done beforehand.

use autodiff_lite::{Param, Real, Tape, Var, impl_module};

use super::DeformationField;
use super::field::seen;
use super::reading::{add_readings, reduced_maps};
use crate::VectorField;

/// A [`DeformationField`] that reads maps its first layer was applied to already; see [`DeformationField::reduced`].
///
/// Its parameters are those of the field that it comes from. The inputs of an evaluation are the cameras and the
/// reduced maps.
#[derive(Clone, Debug)]
pub struct ReducedField<F: Real = f32> {
    field: DeformationField<F>,
}
impl_module!(ReducedField { field });

impl<F: Real> DeformationField<F> {
    /// The same field over maps reduced to twice its hidden columns, and these maps.
    ///
    /// Reading a map between its pixels is linear in the map, as the first graph convolution is: what the layer makes of
    /// the features can be computed once for each pixel of an image, instead of once for each vertex at each evaluation.
    /// Equal to the field itself but for rounding; gradients to the maps and to the layer's rows for features flow
    /// outside of the integration.
    ///
    /// An evaluation on `V` vertices saves `2 V ΣC 2 hidden` flops, reducing takes as many for each pixel, of the
    /// channels of its own map only.
    ///
    /// ```
    /// use autodiff_lite::{SparseMatrix, Tape};
    /// use nets::Init;
    /// use ode_deform::VectorField;
    /// use ode_deform::deform::{DeformationField, FieldConfig};
    ///
    /// let graph = SparseMatrix::from_triplets(2, 2, &[(0, 1, 1.0), (1, 0, 1.0)])?;
    /// let config = FieldConfig { hidden: 8, ..FieldConfig::published(5) };
    /// let field = DeformationField::<f32>::new(&Init::new(0), config, graph);
    /// let tape = Tape::eval();
    /// let maps = [3, 2].map(|channels| tape.constant(ndarray::Array4::ones((1, 4, 4, channels))));
    /// let (field, maps) = field.reduced(&maps);
    /// assert_eq!(maps[1].shape(), [1, 4, 4, 16]);
    ///
    /// let camera = ndarray::arr3(&[[[2.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]]);
    /// let mesh = tape.constant(ndarray::arr3(&[[[0.1, 0.0, -1.0], [0.0, 0.2, -1.0]]]));
    /// let velocity = field.eval(0.0, mesh, &[tape.constant(camera), maps[0], maps[1]]);
    /// assert_eq!(velocity.shape(), [1, 2, 3]);
    /// # Ok::<(), autodiff_lite::SparseError>(())
    /// ```
    ///
    /// # Shapes
    /// `maps [N, H, W, C]` of any sizes, `ΣC` the field's features → `[N, H, W, 2 hidden]` each.
    ///
    /// # Panics
    /// If the maps have together another number of channels than the field takes.
    #[track_caller]
    pub fn reduced<'t>(&self, maps: &[Var<'t, F>]) -> (ReducedField<F>, Vec<Var<'t, F>>) {
        let state = self.config.state();
        let reduced = reduced_maps(maps, self.config.features, |tape, rows| {
            self.both(tape, |weight| weight.slice_axis(0, state + rows.start..state + rows.end))
        });
        (ReducedField { field: self.clone() }, reduced)
    }

    /// Rows of the first layer's two matrices side by side: what stays at a vertex, then what it sends.
    fn both<'t>(&self, tape: &'t Tape<F>, rows: impl Fn(Var<'t, F>) -> Var<'t, F>) -> Var<'t, F> {
        let rows = |param: &Param<F>| rows(tape.param(param));
        tape.concat(&[rows(&self.conv1.loop_weight), rows(&self.conv1.weight)], 1)
    }
}

impl<F: Real> VectorField<F> for ReducedField<F> {
    #[track_caller]
    fn eval<'t>(&self, t: f64, y: Var<'t, F>, inputs: &[Var<'t, F>]) -> Var<'t, F> {
        let (field, tape) = (&self.field, y.tape());
        let (points, maps) = seen(y, inputs);
        let weight = field.both(tape, |weight| {
            let place = weight.slice_axis(0, 0..field.config.state());
            field.time_row(weight).map_or(place, |time| tape.concat(&[place, time], 0))
        });
        let placed = field.time_column(t, y).map_or(y, |time| tape.concat(&[y, time], 2));
        let placed = placed.matmul(weight);
        let read = add_readings(placed, maps, points, field.config.sampling);
        let bias = field.conv1.bias.as_ref().map(|bias| tape.param(bias));
        let x = read.graph_sum(&field.graph, bias, field.config.activation);
        field.velocities(x)
    }
}
