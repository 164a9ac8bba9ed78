//! Fragments with the positions that they are of, and what can be drawn of them.

use std::sync::Arc;

use autodiff_lite::{Tensor, Var, Vjp};
use diff_raster::{Fragments, Frame, Scratch};
use pyo3::prelude::*;

use crate::arrays::Floats;
use crate::precision::{self, Precision};
use crate::recorded::{Call, Recorded};
use crate::topology::Topology;
use crate::wanted::Wanted;

/// Projected positions with their fragments.
#[derive(Clone)]
pub(crate) struct Drawn<F: Precision> {
    pub(crate) projected: Tensor<F>,
    pub(crate) fragments: Arc<Fragments<F>>,
    pub(crate) scratch: Scratch<F>,
}

/// The same in either precision.
pub(crate) enum Seen {
    Single(Drawn<f32>),
    Double(Drawn<f64>),
}

/// A precision that is drawn in.
pub(crate) trait Drawable: Precision {
    /// The memory for drawing a topology.
    fn scratch(topology: &Topology) -> &Scratch<Self>;

    /// What was seen, under its precision.
    fn seen(drawn: Drawn<Self>) -> Seen;
}

macro_rules! drawable {
    ($number:ty, $variant:ident, $scratch:ident) => {
        impl Drawable for $number {
            fn scratch(topology: &Topology) -> &Scratch<Self> {
                &topology.$scratch
            }

            fn seen(drawn: Drawn<Self>) -> Seen {
                Seen::$variant(drawn)
            }
        }
    };
}
drawable!(f32, Single, single);
drawable!(f64, Double, double);

/// A drawing of positions alone, in either precision.
pub(crate) trait Draw: Send {
    /// Its name.
    const OP: &'static str;

    /// Draws it.
    fn draw<'t, F: Precision>(&self, frame: &Frame<'t, F>) -> Var<'t, F>;
}

/// Attributes of what.
#[derive(Clone, Copy)]
pub(crate) enum Attributes {
    Vertices,
    Corners,
}

impl Attributes {
    pub(crate) fn op(self) -> &'static str {
        match self {
            Self::Vertices => "interpolate",
            Self::Corners => "interpolate_corners",
        }
    }
}

impl<F: Precision> Drawn<F> {
    fn frame(self, projected: Var<'_, F>) -> Frame<'_, F> {
        Frame::new(projected, self.fragments, self.scratch)
    }

    /// Draws what depends on the positions alone.
    pub(crate) fn draw<D: Draw>(
        &self,
        py: Python<'_>,
        drawing: D,
        wrt: Option<&Wanted>,
    ) -> PyResult<Recorded> {
        let call = Call::new(D::OP, &[("projected", self.projected.shape())], wrt)?;
        let (tape, own, wanted) = (precision::tape::<F>(), self.clone(), call.wanted());
        Recorded::new(py, call, move || {
            let inputs = [own.projected.clone()];
            Vjp::new(tape, inputs, wanted, |[projected]| drawing.draw(&own.frame(projected)))
        })
    }

    /// Draws attributes, with gradients to positions and attributes.
    pub(crate) fn interpolate(
        &self,
        py: Python<'_>,
        attributes: &Floats<'_>,
        of: Attributes,
        wrt: Option<&Wanted>,
    ) -> PyResult<Recorded> {
        let shapes = [("projected", self.projected.shape()), ("attributes", attributes.shape())];
        let call = Call::new(of.op(), &shapes, wrt)?;
        let (tape, own, wanted) = (precision::tape::<F>(), self.clone(), call.wanted());
        let values = attributes.tensor(&format!("{}: attributes", of.op()), &tape)?;
        Recorded::new(py, call, move || {
            let inputs = [own.projected.clone(), values];
            Vjp::new(tape, inputs, wanted, |[projected, values]| {
                let frame = own.frame(projected);
                match of {
                    Attributes::Vertices => frame.interpolate(values),
                    Attributes::Corners => frame.interpolate_corners(values),
                }
            })
        })
    }

    /// Looks a texture up, with gradients to coordinates and texels.
    pub(crate) fn texture(
        &self,
        py: Python<'_>,
        uv: &Floats<'_>,
        image: &Floats<'_>,
        wrt: Option<&Wanted>,
    ) -> PyResult<Recorded> {
        let call = Call::new("texture", &[("uv", uv.shape()), ("image", image.shape())], wrt)?;
        let (tape, own, wanted) = (precision::tape::<F>(), self.clone(), call.wanted());
        let inputs = [uv.tensor("texture: uv", &tape)?, image.tensor("texture: image", &tape)?];
        Recorded::new(py, call, move || {
            Vjp::new(tape, inputs, wanted, |[uv, image]| {
                // It needs no positions, only where something is seen.
                let still = uv.tape().constant(own.projected.clone());
                own.frame(still).texture(uv, image)
            })
        })
    }
}

/// Fragments can be shared with Python.
const _: fn() = || {
    fn shared<T: Send + Sync>() {}
    shared::<Fragments<f32>>();
};
