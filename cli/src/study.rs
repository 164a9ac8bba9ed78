//! The studies that can be reproduced, by name.

use studies::Study;
use studies::depth::DepthStudy;
use studies::img2mesh::{ClockStudy, UnseenStudy};
use studies::mcmr::{CubStudy, MeanShapesStudy, PascalStudy, SubdivisionStudy};
use studies::pixel2mesh::{MemoryStudy, PlanesStudy, SolversStudy};

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
