//! Threads: rayon's with the feature `rayon`, else the caller's alone. What the parts of a work are is the same either way, so
//! are its bits.

#[cfg(feature = "rayon")]
use rayon::prelude::*;

/// `f` of each number below `count`, in order.
pub(crate) fn map<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    #[cfg(feature = "rayon")]
    return (0..count).into_par_iter().map(&f).collect();
    #[cfg(not(feature = "rayon"))]
    (0..count).map(f).collect()
}

/// Calls `f` with each of these parts.
pub(crate) fn for_each<T: Send>(parts: impl Iterator<Item = T>, f: impl Fn(T) + Sync + Send) {
    #[cfg(feature = "rayon")]
    match parts.collect::<Vec<_>>() {
        // Another thread would have to wake for it.
        one if one.len() < 2 => one.into_iter().for_each(f),
        parts => parts.into_par_iter().for_each(f),
    }
    #[cfg(not(feature = "rayon"))]
    parts.for_each(f);
}

/// Calls `f` on one of the threads, so that what it gives the others is theirs sooner.
pub(crate) fn on_one<R: Send>(f: impl FnOnce() -> R + Send) -> R {
    #[cfg(feature = "rayon")]
    return rayon::scope(|_| f());
    #[cfg(not(feature = "rayon"))]
    f()
}

/// Calls `f` with parts of `len` elements of both slices.
pub(crate) fn for_each_pair<A: Sync, B: Send>(
    from: &[A],
    to: &mut [B],
    len: usize,
    f: impl Fn(&[A], &mut [B]) + Sync,
) {
    #[cfg(feature = "rayon")]
    from.par_chunks(len).zip(to.par_chunks_mut(len)).for_each(|(from, to)| f(from, to));
    #[cfg(not(feature = "rayon"))]
    from.chunks(len).zip(to.chunks_mut(len)).for_each(|(from, to)| f(from, to));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_come_in_order_and_once() {
        assert_eq!(map(5, |i| i * i), [0, 1, 4, 9, 16]);
        let mut parts = [0; 5];
        on_one(|| for_each(parts.chunks_mut(2).enumerate(), |(k, part)| part.fill(k)));
        assert_eq!(parts, [0, 0, 1, 1, 2]);
        let mut to = [0; 7];
        for_each_pair(&[1, 2, 3, 4, 5, 6, 7], &mut to, 3, |from, to| {
            to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
        });
        assert_eq!(to, [1, 2, 3, 4, 5, 6, 7]);
    }
}
