//! Batches that are loaded ahead, on a thread of their own.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::JoinHandle;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// How samples become batches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BatchPlan {
    /// Samples in a batch.
    pub size: usize,
    /// What the order follows from, together with the epoch.
    pub seed: u64,
    /// Which pass over the samples this is.
    pub epoch: u64,
    /// Whether samples that do not fill a last batch are left out.
    pub drop_last: bool,
    /// How many batches may wait, loaded, beside the one that is being loaded.
    pub ahead: usize,
    /// Threads that load; results do not depend on it.
    pub threads: usize,
}

impl Default for BatchPlan {
    fn default() -> Self {
        Self { size: 8, seed: 0, epoch: 0, drop_last: false, ahead: 2, threads: 1 }
    }
}

/// The numbers below `count` in an order that is a function of seed and epoch.
pub fn shuffled(count: usize, seed: u64, epoch: u64) -> Vec<usize> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(epoch);
    let mut order: Vec<usize> = (0..count).collect();
    // Fisher and Yates. As u64, so that the order is the same on every machine.
    for i in (1..count).rev() {
        order.swap(i, random.random_range(0..=i as u64) as usize);
    }
    order
}

/// One pass over samples in batches, loaded ahead on a thread.
///
/// An iterator of batches, each in the order of the pass; after an error, which is that of the
/// first sample in order that cannot be loaded, it ends. It may be dropped at any time: what is
/// being loaded is finished, and nothing more. A panic while loading is passed on to whoever asks
/// for the batch.
///
/// Loading has threads of its own, so an iterator may be waited on from inside any thread pool,
/// also one with a single thread.
///
/// ```
/// use datasets::{BatchPlan, Batches};
///
/// // Samples are whatever names what is to be loaded: here (object, views).
/// let samples: Vec<(usize, [usize; 2])> = (0..10).map(|i| (i, [0, i % 3])).collect();
/// let plan = BatchPlan { size: 4, seed: 7, ..BatchPlan::default() };
/// let load = |&(object, views): &(usize, [usize; 2])| Ok::<_, std::io::Error>(object + views[1]);
/// let mut seen = 0;
/// for batch in Batches::start(samples, &plan, load) {
///     seen += batch?.len();
/// }
/// assert_eq!(seen, 10);
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct Batches<T, E> {
    /// `None` once there is nothing more to come.
    receiver: Option<Receiver<Result<Vec<T>, E>>>,
    worker: Option<JoinHandle<()>>,
    stopped: Arc<AtomicBool>,
    left: usize,
}

impl<T: Send + 'static, E: Send + 'static> Batches<T, E> {
    /// Begins to load: the samples are shuffled by the plan's seed and epoch.
    ///
    /// # Panics
    /// If the plan has batches of size 0.
    pub fn start<S: Send + Sync + 'static>(
        samples: Vec<S>,
        plan: &BatchPlan,
        load: impl Fn(&S) -> Result<T, E> + Send + Sync + 'static,
    ) -> Self {
        assert!(plan.size > 0, "Batches: a batch of 0 samples");
        let order = shuffled(samples.len(), plan.seed, plan.epoch);
        let (size, threads) = (plan.size, plan.threads.max(1));
        let left = if plan.drop_last { order.len() / size } else { order.len().div_ceil(size) };
        let (sender, receiver) = sync_channel(plan.ahead);
        let stopped = Arc::new(AtomicBool::new(false));
        let stop = Arc::clone(&stopped);
        let work = move || {
            // A pool of its own: readers use threads too, and those of the pool around the
            // consumer may all be waiting for this batch.
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let pool = pool.expect("the system gives a few threads");
            for batch in order.chunks(size).take(left) {
                let one = |&i: &usize| {
                    // Nobody waits any more.
                    if stop.load(Ordering::Relaxed) { None } else { Some(load(&samples[i])) }
                };
                let loaded: Vec<Option<Result<T, E>>> =
                    pool.install(|| batch.par_iter().map(one).collect());
                let Some(loaded) = loaded.into_iter().collect::<Option<Vec<_>>>() else { return };
                let result: Result<Vec<T>, E> = loaded.into_iter().collect();
                let failed = result.is_err();
                if sender.send(result).is_err() || failed {
                    return;
                }
            }
        };
        let worker = std::thread::Builder::new().name("batches".to_owned()).spawn(work);
        let worker = Some(worker.expect("the system gives a thread"));
        Self { receiver: Some(receiver), worker, stopped, left }
    }
}

impl<T, E> Iterator for Batches<T, E> {
    type Item = Result<Vec<T>, E>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.left == 0 {
            self.receiver = None;
        }
        let receiver = self.receiver.as_ref()?;
        if let Ok(result) = receiver.recv() {
            self.left = if result.is_ok() { self.left - 1 } else { 0 };
            return Some(result);
        }
        // The thread has gone without a word: it has panicked.
        self.receiver = None;
        if let Some(Err(panic)) = self.worker.take().map(JoinHandle::join) {
            std::panic::resume_unwind(panic);
        }
        None
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        // An error may end it early.
        (0, Some(self.left))
    }
}

impl<T, E> Drop for Batches<T, E> {
    fn drop(&mut self) {
        self.stopped.store(true, Ordering::Relaxed);
        // First the receiver: a thread that waits for room in the channel is let go.
        self.receiver = None;
        if let Some(worker) = self.worker.take() {
            // Its panic, if any, concerns a batch that nobody asked for.
            let _ = worker.join();
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;
    use std::time::Duration;

    fn all(plan: &BatchPlan) -> Vec<Vec<usize>> {
        let load = |&i: &usize| Ok::<_, ()>(i);
        Batches::start((0..23).collect(), plan, load).collect::<Result<_, _>>().unwrap()
    }

    #[test]
    fn the_order_is_a_function_of_seed_and_epoch() {
        let plan = BatchPlan { size: 5, seed: 3, epoch: 2, ..BatchPlan::default() };
        let batches = all(&plan);
        assert_eq!(batches.iter().map(Vec::len).collect::<Vec<_>>(), [5, 5, 5, 5, 3]);
        assert_eq!(batches.concat(), shuffled(23, 3, 2));
        let mut sorted = batches.concat();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..23).collect::<Vec<_>>());
        for (ahead, threads) in [(0, 1), (1, 2), (9, 3)] {
            assert_eq!(all(&BatchPlan { ahead, threads, ..plan }), batches);
        }
        assert_ne!(all(&BatchPlan { epoch: 3, ..plan }), batches);
        assert_ne!(all(&BatchPlan { seed: 4, ..plan }), batches);
        assert_eq!(all(&BatchPlan { drop_last: true, ..plan }), batches[..4]);
        // Pinned: a pass that was stopped goes on elsewhere with the same order.
        assert!(shuffled(0, 1, 1).is_empty());
        assert_eq!(shuffled(8, 7, 0), shuffled(8, 7, 0));
    }

    #[test]
    fn an_error_ends_the_pass_in_its_place() {
        for threads in [1, 3] {
            let plan = BatchPlan { size: 4, threads, ..BatchPlan::default() };
            let order = shuffled(23, 0, 0);
            let (first, second) = (order[9], order[10]);
            let fails = move |&i: &usize| {
                if i == first || i == second { Err(i) } else { Ok(i) }
            };
            let mut batches = Batches::start((0..23).collect(), &plan, fails);
            assert!(batches.next().unwrap().is_ok() && batches.next().unwrap().is_ok());
            assert_eq!(batches.next().unwrap(), Err(first));
            assert!(batches.next().is_none() && batches.next().is_none());
        }
    }

    #[test]
    fn dropping_early_stops_the_loading_and_does_not_hang() {
        let loaded = Arc::new(AtomicUsize::new(0));
        for (taken, ahead) in [(0, 0), (0, 2), (3, 0), (3, 1)] {
            let (count, plan) =
                (Arc::clone(&loaded), BatchPlan { size: 2, ahead, ..BatchPlan::default() });
            loaded.store(0, Ordering::SeqCst);
            let slow = move |&i: &usize| {
                count.fetch_add(1, Ordering::SeqCst);
                Ok::<usize, ()>(i)
            };
            let mut batches = Batches::start((0..100_000).collect(), &plan, slow);
            assert_eq!(batches.by_ref().take(taken).count(), taken);
            drop(batches);
            // Taken, waiting, blocked on its way into the channel, and in work.
            assert!(loaded.load(Ordering::SeqCst) <= 2 * (taken + ahead + 2));
        }
    }

    #[test]
    fn a_pool_of_one_thread_may_wait_for_readers_that_use_threads() {
        let (sender, done) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            let sum = |i: &usize| Ok::<_, ()>((0..*i).into_par_iter().sum::<usize>());
            let count = pool
                .install(|| Batches::start((0..9).collect(), &BatchPlan::default(), sum).count());
            sender.send(count).unwrap();
        });
        assert_eq!(done.recv_timeout(Duration::from_secs(60)), Ok(2));
    }

    #[test]
    #[should_panic(expected = "the disk is on fire")]
    fn a_panic_is_passed_on() {
        let burn = |_: &usize| -> Result<(), ()> { panic!("the disk is on fire") };
        let _ = Batches::start(vec![1], &BatchPlan::default(), burn).next();
    }
}
