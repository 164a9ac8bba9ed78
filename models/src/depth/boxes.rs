//! Pix3D's photographs cut to their given boxes.

use datasets::{Catalog, Dataset, Pix3d, ReadOptions, ReadViewsError, Truth, Views};

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
        views.views = views
            .views
            .into_iter()
            .map(|view| {
                let annotation = annotations.iter().find(|a| a.image == view.name);
                match annotation {
                    Some(annotation) => {
                        // Views may have been averaged down on the way.
                        let scale = view.color.width as f64 / annotation.size[0] as f64;
                        square(view, annotation.bounds.map(|x| x * scale), MARGIN)
                    }
                    None => view,
                }
            })
            .collect();
        Ok(views)
    }

    fn truth(&self, object: usize) -> Result<Truth, ReadViewsError> {
        self.inner.truth(object)
    }
}
