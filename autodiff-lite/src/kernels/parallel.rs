//! Loops over parts of slices: on rayon's threads with the feature `rayon`, one part after another without it.
//!
//! What the parts are is said by the caller, never by the number of threads, and each is written by one call alone. So results have
//! the same bits either way, as long as a call writes nothing but its part. A loop knows its work by a pointer, where rayon's own
//! iterators are compiled anew for each.
//!
//! ```
//! use autodiff_lite::kernels::parallel::{InParts, Parts};
//!
//! let (x, mut sums) = ([1.0, 2.0, 3.0, 4.0, 5.0], [0.0; 3]);
//! sums.par_iter_mut().zip(x.par_chunks(2)).for_each(|(sum, part)| *sum = part.iter().sum::<f64>());
//! assert_eq!(sums, [3.0, 7.0, 5.0]);
//! ```

use std::marker::PhantomData;

use super::blocks::{Shared, for_each_block};

/// A row of parts, each for one call of a loop.
///
/// # Safety
/// [`part`](Self::part) gives different calls nothing that both could write.
pub unsafe trait Parts: Sized + Sync {
    /// A part.
    type Item;

    /// How many there are.
    fn count(&self) -> usize;

    /// The part at `index`.
    ///
    /// # Safety
    /// `index` is below [`count`](Self::count), and asked for once.
    unsafe fn part(&self, index: usize) -> Self::Item;

    /// Each with its index.
    fn enumerate(self) -> Enumerated<Self> {
        Enumerated(self)
    }

    /// Each beside that of `other` at the same index, as many as the shorter has.
    fn zip<P: Parts>(self, other: P) -> Zipped<Self, P> {
        Zipped(self, other)
    }

    /// For small parts: a thread takes `len` in a row.
    ///
    /// # Panics
    /// If `len` is 0.
    fn with_min_len(self, len: usize) -> Runs<Self> {
        assert!(len > 0, "with_min_len: no parts in a run");
        Runs { parts: self, len }
    }

    /// Calls `f` with each part.
    fn for_each(self, f: impl Fn(Self::Item) + Sync) {
        for_each_block(self.count(), true, |index| {
            // SAFETY: below the count, and each once.
            f(unsafe { self.part(index) });
        });
    }
}

/// Runs of parts ([`Parts::with_min_len`]).
#[derive(Debug)]
pub struct Runs<P> {
    parts: P,
    len: usize,
}

impl<P: Parts> Runs<P> {
    /// Calls `f` with each part.
    pub fn for_each(self, f: impl Fn(P::Item) + Sync) {
        self.for_each_init(|| (), |(), part| f(part));
    }

    /// Calls `f` with each part and what `init` made for its run.
    pub fn for_each_init<T>(self, init: impl Fn() -> T + Sync, f: impl Fn(&mut T, P::Item) + Sync) {
        let Self { parts, len } = self;
        let count = parts.count();
        for_each_block(count.div_ceil(len), true, |run| {
            let mut own = init();
            for index in run * len..count.min((run + 1) * len) {
                // SAFETY: below the count, and each once, since runs share none.
                f(&mut own, unsafe { parts.part(index) });
            }
        });
    }
}

/// Parts with their indices ([`Parts::enumerate`]).
#[derive(Debug)]
pub struct Enumerated<P>(P);

// SAFETY: the parts of what is numbered.
unsafe impl<P: Parts> Parts for Enumerated<P> {
    type Item = (usize, P::Item);

    fn count(&self) -> usize {
        self.0.count()
    }

    #[inline(always)]
    unsafe fn part(&self, index: usize) -> Self::Item {
        // SAFETY: the caller's promise.
        (index, unsafe { self.0.part(index) })
    }
}

/// Pairs of parts ([`Parts::zip`]).
#[derive(Debug)]
pub struct Zipped<A, B>(A, B);

// SAFETY: the parts of both.
unsafe impl<A: Parts, B: Parts> Parts for Zipped<A, B> {
    type Item = (A::Item, B::Item);

    fn count(&self) -> usize {
        self.0.count().min(self.1.count())
    }

    #[inline(always)]
    unsafe fn part(&self, index: usize) -> Self::Item {
        // SAFETY: the caller's promise; each has at least as many.
        unsafe { (self.0.part(index), self.1.part(index)) }
    }
}

/// Slices in a row, to be read.
#[derive(Debug)]
pub struct Chunks<'a, T> {
    all: &'a [T],
    len: usize,
    count: usize,
}

// SAFETY: what is given can only be read.
unsafe impl<'a, T: Sync> Parts for Chunks<'a, T> {
    type Item = &'a [T];

    fn count(&self) -> usize {
        self.count
    }

    #[inline(always)]
    unsafe fn part(&self, index: usize) -> Self::Item {
        let start = index * self.len;
        &self.all[start..self.all.len().min(start + self.len)]
    }
}

/// Slices in a row, to be written.
#[derive(Debug)]
pub struct ChunksMut<'a, T> {
    all: Shared<T>,
    size: usize,
    len: usize,
    count: usize,
    lifetime: PhantomData<&'a ()>,
}

// SAFETY: no element is in two of them.
unsafe impl<'a, T: Send + 'a> Parts for ChunksMut<'a, T> {
    type Item = &'a mut [T];

    fn count(&self) -> usize {
        self.count
    }

    #[inline(always)]
    unsafe fn part(&self, index: usize) -> Self::Item {
        let start = index * self.len;
        // SAFETY: they lie within the slice, which is borrowed for as long, and no other part has them.
        unsafe { self.all.slice(start, self.len.min(self.size - start)) }
    }
}

/// Elements in a row, to be read.
#[derive(Debug)]
pub struct Each<'a, T>(&'a [T]);

// SAFETY: what is given can only be read.
unsafe impl<'a, T: Sync> Parts for Each<'a, T> {
    type Item = &'a T;

    fn count(&self) -> usize {
        self.0.len()
    }

    #[inline(always)]
    unsafe fn part(&self, index: usize) -> Self::Item {
        &self.0[index]
    }
}

/// Elements in a row, to be written.
#[derive(Debug)]
pub struct EachMut<'a, T>(ChunksMut<'a, T>);

// SAFETY: as slices of one element.
unsafe impl<'a, T: Send + 'a> Parts for EachMut<'a, T> {
    type Item = &'a mut T;

    fn count(&self) -> usize {
        self.0.count
    }

    #[inline(always)]
    unsafe fn part(&self, index: usize) -> Self::Item {
        // SAFETY: the caller's promise.
        unsafe { &mut self.0.part(index)[0] }
    }
}

/// Slices, cut into parts.
pub trait InParts<T> {
    /// Parts of `len` elements, the last of what is left.
    ///
    /// # Panics
    /// If `len` is 0, here and below.
    fn par_chunks(&self, len: usize) -> Chunks<'_, T>;

    /// Parts of `len` elements, without what is left.
    fn par_chunks_exact(&self, len: usize) -> Chunks<'_, T>;

    /// The elements.
    fn par_iter(&self) -> Each<'_, T>;

    /// Parts of `len` elements to be written, the last of what is left.
    fn par_chunks_mut(&mut self, len: usize) -> ChunksMut<'_, T>;

    /// Parts of `len` elements to be written, without what is left.
    fn par_chunks_exact_mut(&mut self, len: usize) -> ChunksMut<'_, T>;

    /// The elements, to be written.
    fn par_iter_mut(&mut self) -> EachMut<'_, T>;
}

impl<T> InParts<T> for [T] {
    fn par_chunks(&self, len: usize) -> Chunks<'_, T> {
        Chunks { all: self, len, count: self.len().div_ceil(len) }
    }

    fn par_chunks_exact(&self, len: usize) -> Chunks<'_, T> {
        Chunks { all: self, len, count: self.len() / len }
    }

    fn par_iter(&self) -> Each<'_, T> {
        Each(self)
    }

    fn par_chunks_mut(&mut self, len: usize) -> ChunksMut<'_, T> {
        let (size, count) = (self.len(), self.len().div_ceil(len));
        ChunksMut { all: Shared::new(self), size, len, count, lifetime: PhantomData }
    }

    fn par_chunks_exact_mut(&mut self, len: usize) -> ChunksMut<'_, T> {
        let (size, count) = (self.len(), self.len() / len);
        ChunksMut { all: Shared::new(self), size, len, count, lifetime: PhantomData }
    }

    fn par_iter_mut(&mut self) -> EachMut<'_, T> {
        EachMut(self.par_chunks_mut(1))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn every_part_is_taken_once() {
        for size in [0, 1, 2, 6, 7, 1000] {
            for len in [1, 3, 7, 2000] {
                let read: Vec<usize> = (0..size).collect();
                let mut found = vec![0; size];
                found.par_chunks_mut(len).zip(read.par_chunks(len)).enumerate().for_each(
                    |(index, (found, read))| {
                        assert_eq!(read.first(), Some(&(index * len)));
                        found.iter_mut().zip(read).for_each(|(f, r)| *f += r + 1);
                    },
                );
                assert!(found.iter().copied().eq(1..=size));

                let mut whole = vec![0; size];
                whole
                    .par_chunks_exact_mut(len)
                    .zip(read.par_chunks_exact(len))
                    .for_each(|(w, r)| w.copy_from_slice(r));
                let whole_parts = size / len * len;
                assert_eq!(whole[..whole_parts], read[..whole_parts]);
                assert!(whole[whole_parts..].iter().all(|&x| x == 0));
            }
        }
    }

    #[test]
    fn runs_make_what_they_need_once() {
        let made = AtomicUsize::new(0);
        let mut found = [0; 10];
        found.par_iter_mut().enumerate().with_min_len(4).for_each_init(
            || made.fetch_add(1, Ordering::Relaxed),
            |_, (index, found)| *found += index,
        );
        assert_eq!(found, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
        assert_eq!(made.into_inner(), 3);
    }

    #[test]
    fn the_shorter_of_two_ends_a_loop() {
        let mut long = [0; 5];
        long.par_iter_mut().zip([1, 2, 3].par_iter()).for_each(|(to, &from)| *to = from);
        assert_eq!(long, [1, 2, 3, 0, 0]);
    }
}
