//! Collections of annotated photographs, told apart.

use std::path::Path;

use crate::dataset::Dataset;
use crate::error::ReadViewsError;
use crate::layouts::cub::Cub;
use crate::layouts::mcmr::Mcmr;
use crate::layouts::pascal3d::Pascal3d;
use crate::layouts::pix3d::Pix3d;

/// The dataset of annotated photographs at the path, where it is one.
pub(crate) fn find(path: &Path) -> Result<Option<Box<dyn Dataset>>, ReadViewsError> {
    Ok(Some(if Pix3d::recognises(path) {
        Box::new(Pix3d::open(path)?)
    } else if Pascal3d::recognises(path) {
        Box::new(Pascal3d::open(path)?)
    } else if Cub::recognises(path) {
        Box::new(Cub::open(path)?)
    } else if Mcmr::recognises(path) {
        Box::new(Mcmr::open(path)?)
    } else {
        return Ok(None);
    }))
}
