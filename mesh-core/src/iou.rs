//! Intersection over union.

/// Intersection over union of two sets, given as pairs of memberships; `None` where both are empty.
///
/// What two empty sets are worth is the caller's to say: full agreement to a metric, nothing to a search.
///
/// ```
/// let pairs = [(true, true), (true, false), (false, true), (false, false)];
/// assert_eq!(mesh_core::iou(pairs), Some(1.0 / 3.0));
/// assert_eq!(mesh_core::iou([(false, false)]), None);
/// ```
pub fn iou(pairs: impl IntoIterator<Item = (bool, bool)>) -> Option<f64> {
    let (mut both, mut either) = (0_u64, 0_u64);
    for (a, b) in pairs {
        both += u64::from(a && b);
        either += u64::from(a || b);
    }
    (either > 0).then(|| both as f64 / either as f64)
}
