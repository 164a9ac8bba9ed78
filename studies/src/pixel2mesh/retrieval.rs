//! The control that learns nothing: the training object whose image is the likest, as it stood before its camera.

use models::paired::{InputImage, Pair, Pairs, surface_scores};
use models::pixel2mesh::Scored;
use ode_deform::solve::Stats;
use train::{DataError, Subset};

use crate::nearest::{Nearest, features};

/// Points in the place of the vertices of what is found, as many as the models have.
const POINTS: usize = 618;

/// Scores of what the nearest image of the training shows, for each scored image; `views` of each object.
pub(super) fn retrieved(data: &Pairs, views: usize) -> Result<Scored, DataError> {
    let mut known = Nearest::default();
    for &object in data.trained() {
        for view in 0..data.views(object) {
            known.add(seen(&*data.image(object, view)?), [object, view]);
        }
    }
    Scored::of(data, (Subset::Test, views), |pair: &Pair| {
        let found = known.find(&seen(&pair.image));
        let [object, view] = found.expect("objects to train on have views");
        let (image, surface) = (data.image(object, view)?, data.surface(object)?);
        let mesh = surface.mesh.as_ref();
        let mesh = mesh.map(|mesh| image.frame.mesh_placed(mesh)).unwrap_or_default();
        Ok((surface_scores(&mesh, POINTS, &pair.truth), Stats::default()))
    })
}

fn seen(image: &InputImage) -> Vec<f32> {
    features(&image.pixels, &image.mask)
}
