//! The studies that can be reproduced, by name.

use recon::depth::DepthStudy;
use recon::img2mesh::{ClockStudy, UnseenStudy};
use recon::mcmr::{CubStudy, MeanShapesStudy, PascalStudy, SubdivisionStudy};
use recon::pixel2mesh::{MemoryStudy, PlanesStudy, SolversStudy};
use recon::reproduce::Study;

/// All of them, in the order of the list.
pub(crate) const STUDIES: &[&dyn Study] = &[
    &ClockStudy,
    &UnseenStudy,
    &PlanesStudy,
    &SolversStudy,
    &MemoryStudy,
    &MeanShapesStudy,
    &SubdivisionStudy,
    &PascalStudy,
    &CubStudy,
    &DepthStudy,
];

/// The study of this name.
pub(crate) fn study(name: &str) -> Option<&'static dyn Study> {
    STUDIES.iter().copied().find(|study| study.name() == name)
}
