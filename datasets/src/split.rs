//! Which views are fitted and which are kept back to judge the result.

/// Indices of views, each list ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Split {
    /// Views that the fit may look at.
    pub fit: Vec<usize>,
    /// Views that only the evaluation looks at.
    pub held_out: Vec<usize>,
}

/// Holds back every view whose index leaves the remainder `offset` when divided by `every`.
///
/// `split(100, 5, 4)` holds back 4, 9, 14, .., 99. With `every` 0, and where nothing would remain
/// to fit, nothing is held back.
///
/// ```
/// let split = datasets::split(10, 5, 4);
/// assert_eq!(split.held_out, [4, 9]);
/// assert_eq!(split.fit, [0, 1, 2, 3, 5, 6, 7, 8]);
/// ```
pub fn split(count: usize, every: usize, offset: usize) -> Split {
    if every == 0 {
        return Split { fit: (0..count).collect(), held_out: Vec::new() };
    }
    let (held_out, fit): (Vec<_>, Vec<_>) = (0..count).partition(|i| i % every == offset % every);
    if fit.is_empty() {
        Split { fit: held_out, held_out: Vec::new() }
    } else {
        Split { fit, held_out }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_view_is_on_exactly_one_side() {
        for count in 0..30 {
            for every in 0..7 {
                for offset in 0..9 {
                    let s = split(count, every, offset);
                    let mut all = [s.fit.clone(), s.held_out].concat();
                    all.sort_unstable();
                    assert_eq!(all, (0..count).collect::<Vec<_>>());
                    assert!(count == 0 || !s.fit.is_empty());
                }
            }
        }
    }
}
