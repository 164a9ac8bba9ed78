//! Pix3D's photographs cut to their given boxes.

use datasets::{
    Catalog, Dataset, Pix3d, Pix3dAnnotation, ReadOptions, ReadViewsError, Truth, View, Views,
};

use crate::square::square;

/// What a box is widened by, so that the object does not touch the image's border.
const MARGIN: f64 = 1.1;

/// Pix3D with every photograph cut to a square around the object's given box, the camera with it.
///
/// What the square has beyond the photograph is background.
#[derive(Debug)]
pub struct Boxes {
    inner: Pix3d,
}

impl Boxes {
    /// Over Pix3D's annotations.
    pub fn new(inner: Pix3d) -> Self {
        Self { inner }
    }
}

impl Dataset for Boxes {
    fn catalog(&self) -> &Catalog {
        self.inner.catalog()
    }

    fn views(
        &self,
        object: usize,
        which: Option<&[usize]>,
        options: &ReadOptions,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Views, ReadViewsError> {
        let mut views = self.inner.views(object, which, options, progress)?;
        let annotations = self.inner.annotations(object);
        let all: Vec<usize> = (0..annotations.len()).collect();
        // In the order of the views, of which some may be left out: one image may show the model twice, each in a box of its own.
        let mut asked = which.unwrap_or(&all).iter().map(|&view| &annotations[view]);
        let cut = |view: View| match asked.find(|annotation| annotation.image == view.name) {
            Some(annotation) => boxed(view, annotation),
            None => view,
        };
        views.views = views.views.into_iter().map(cut).collect();
        Ok(views)
    }

    fn truth(&self, object: usize) -> Result<Truth, ReadViewsError> {
        self.inner.truth(object)
    }
}

/// The part of a photograph around its annotation's box.
fn boxed(view: View, annotation: &Pix3dAnnotation) -> View {
    // Views may have been averaged down on the way.
    let scale = view.color.width as f64 / annotation.size[0] as f64;
    square(view, annotation.bounds.map(|x| x * scale), MARGIN)
}
