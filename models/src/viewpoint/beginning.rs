//! Where guesses begin.

use nets::ViewpointHead;

use super::place::Viewpoint;

/// Objects whose cameras tell where guesses begin.
pub(crate) const LOOKED_AT: usize = 16;

/// Lets the guesses of a head begin at the mean elevation and distance of these viewpoints; with none it stays as it is.
pub(crate) fn begin_at(head: &mut ViewpointHead, views: &[Viewpoint]) {
    if views.is_empty() {
        return;
    }
    let mean = |of: fn(&Viewpoint) -> f64| views.iter().map(of).sum::<f64>() / views.len() as f64;
    head.begin_at(mean(|v| v.elevation), mean(|v| v.distance.ln()));
}
