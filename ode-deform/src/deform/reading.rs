//! How fields read feature maps that a matrix was applied to before.

use std::ops::Range;

use autodiff_lite::{Padding, Real, Tape, Var};
use nets::{MapSampling, pool_features};

/// Maps `[N, H, W, C]`, of together `features` channels, times their rows of a matrix.
///
/// # Panics
/// If the maps have together another number of channels.
#[track_caller]
pub(super) fn reduced_maps<'t, F: Real>(
    maps: &[Var<'t, F>],
    features: usize,
    rows: impl Fn(&'t Tape<F>, Range<usize>) -> Var<'t, F>,
) -> Vec<Var<'t, F>> {
    let channels = |map: &Var<'t, F>| map.dims::<4>()[3];
    let found = maps.iter().map(channels).sum::<usize>();
    assert!(found == features, "reduced: {found} channels in all maps, expected {features}");
    let mut first = 0;
    let reduce = |&map: &Var<'t, F>| {
        let its = first..first + channels(&map);
        first = its.end;
        map.matmul(rows(map.tape(), its))
    };
    maps.iter().map(reduce).collect()
}

/// `sum [N, V, C]` and what all maps show at the points.
pub(super) fn add_readings<'t, F: Real>(
    sum: Var<'t, F>,
    maps: &[Var<'t, F>],
    points: Var<'t, F>,
    sampling: MapSampling,
) -> Var<'t, F> {
    match sampling {
        MapSampling::Bilinear => sum.add_bilinear_samples(maps, points, Padding::Border, false),
        MapSampling::Centers => sum.add_bilinear_samples(maps, points, Padding::Zeros, true),
        MapSampling::Nearest | MapSampling::Corners | MapSampling::Truncated => {
            maps.iter().fold(sum, |sum, &map| sum + pool_features(&[map], points, sampling))
        }
    }
}
