//! The control that learns nothing: the training object whose image is the likest, as it stood before its camera.

use models::depth::{Scene, Scenes, Score, Scored};
use train::{DataError, Subset};

use crate::nearest::{Nearest, features};

/// Images of each object of the training that are looked through.
const VIEWS: usize = 6;

/// Scores of what the nearest image of the training shows, for each scored image; `views` of each object.
pub(super) fn retrieved(data: &Scenes, views: usize) -> Result<Scored, DataError> {
    let mut known = Nearest::default();
    for k in 0..data.pairs().trials(Subset::Train, VIEWS)? {
        let (_, scene) = data.trial(Subset::Train, VIEWS, k)?;
        known.add(seen(&scene), k);
    }
    Scored::of(data, (Subset::Test, views), |scene, truth| {
        let found = known.find(&seen(scene)).expect("objects to train on have views");
        let (object, other) = data.trial(Subset::Train, VIEWS, found)?;
        let surface = data.mesh(object)?;
        let mesh = surface.mesh.as_ref().expect("an object without a mesh is an error");
        Ok(Score::of(&other.depth_targets.frame.mesh_placed(mesh), scene, truth))
    })
}

fn seen(scene: &Scene) -> Vec<f32> {
    features(&scene.image.pixels, &scene.image.mask)
}
