//! Threads: rayon's with the feature `rayon`, else the caller's alone. The one place that knows rayon, for the crates above too.

/// Jobs that each thread of a pool has, where there is enough to do.
#[cfg(feature = "rayon")]
const JOBS: usize = 64;

/// Calls `f` for each number below `count`, on as many threads as the current pool has. It knows its work by a pointer: with a type of
/// its own for each kernel, half of what a program of ours was compiled to were copies of it.
pub(crate) fn on_threads(count: usize, f: &(dyn Fn(usize) + Sync)) {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        // Many are small: a job takes several then, since it costs as much as a thousand additions. Few are jobs of their own, so
        // that no thread waits for another that took two.
        let most = (count / (JOBS * rayon::current_num_threads())).max(1);
        (0..count).into_par_iter().with_max_len(most).for_each(f);
    }
    #[cfg(not(feature = "rayon"))]
    (0..count).for_each(f);
}

/// Does two things, at the same time where there is a thread to spare.
pub fn join(a: impl FnOnce() + Send, b: impl FnOnce() + Send) {
    #[cfg(feature = "rayon")]
    rayon::join(a, b);
    #[cfg(not(feature = "rayon"))]
    {
        a();
        b();
    }
}

/// How many threads a loop may run on.
pub fn available() -> usize {
    #[cfg(feature = "rayon")]
    return rayon::current_num_threads();
    #[cfg(not(feature = "rayon"))]
    1
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn everything_is_done_once() {
        let sum = AtomicUsize::new(0);
        on_threads(1000, &|i| {
            sum.fetch_add(i + 1, Ordering::Relaxed);
        });
        assert_eq!(sum.into_inner(), 500_500);
        let (mut a, mut b) = (0, 0);
        join(|| a = 1, || b = 2);
        assert_eq!((a, b), (1, 2));
        assert!(available() >= 1);
    }
}
