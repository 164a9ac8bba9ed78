//! All studies, by system.

use crate::{Study, depth, img2mesh, mcmr, pixel2mesh};

/// All studies, in the order of lists.
pub fn studies() -> impl Iterator<Item = &'static dyn Study> {
    [img2mesh::STUDIES, pixel2mesh::STUDIES, mcmr::STUDIES, depth::STUDIES]
        .into_iter()
        .flatten()
        .copied()
}
