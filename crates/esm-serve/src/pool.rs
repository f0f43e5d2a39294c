//! [`Pool`]: the clouds that are worked on, away from the threads that talk; few at a time, and few that wait.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::task::spawn_blocking;

/// Workers and the places in the queue before them.
#[derive(Clone)]
pub(crate) struct Pool {
    /// One for each request that is worked on or waits.
    places: Arc<Semaphore>,
    workers: Arc<Semaphore>,
    waiting: Arc<AtomicI64>,
}

/// A place in the queue.
pub(crate) struct Place {
    pool: Pool,
    /// Sessions have none: each has one cloud at most, and there are few sessions.
    held: Option<OwnedSemaphorePermit>,
}

/// What came of some work.
pub(crate) struct Done<T> {
    pub(crate) value: T,
    /// How long it waited for a worker.
    pub(crate) waited: Duration,
}

/// The work ended in a panic: an error of the program, told in its log.
#[derive(Debug)]
pub(crate) struct Panicked;

impl Pool {
    pub(crate) fn new(workers: usize, queue: usize) -> Self {
        let limit = |n: usize| Arc::new(Semaphore::new(n.min(Semaphore::MAX_PERMITS)));
        Self {
            places: limit(workers.saturating_add(queue)),
            workers: limit(workers),
            waiting: Arc::default(),
        }
    }

    /// A place for a request; `None` where all are taken.
    pub(crate) fn try_enter(&self) -> Option<Place> {
        let held = Arc::clone(&self.places).try_acquire_owned().ok()?;
        Some(Place { pool: self.clone(), held: Some(held) })
    }

    /// A place for the next cloud of a session.
    pub(crate) fn enter(&self) -> Place {
        Place { pool: self.clone(), held: None }
    }

    /// How many wait for a worker now.
    pub(crate) fn waiting(&self) -> i64 {
        self.waiting.load(Ordering::Relaxed)
    }
}

impl Place {
    /// Runs the work when its turn comes. Dropping the future gives up the turn; work that has begun is finished, and
    /// holds its worker for that long, whether or not anybody still waits for it.
    pub(crate) async fn run<T: Send + 'static>(
        self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<Done<T>, Panicked> {
        let asked = Instant::now();
        let turn = {
            let _waiting = Waiting::begin(&self.pool.waiting);
            // Never closed.
            Arc::clone(&self.pool.workers).acquire_owned().await.map_err(|_| Panicked)?
        };
        let waited = asked.elapsed();
        let held = self.held;
        let value = spawn_blocking(move || {
            let _taken = (turn, held);
            work()
        });
        Ok(Done { value: value.await.map_err(|_| Panicked)?, waited })
    }
}

/// Counts itself as long as it lives.
struct Waiting<'a>(&'a AtomicI64);

impl<'a> Waiting<'a> {
    fn begin(count: &'a AtomicI64) -> Self {
        count.fetch_add(1, Ordering::Relaxed);
        Self(count)
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    #[tokio::test]
    async fn more_than_fit_are_refused_and_places_come_free() {
        let pool = Pool::new(1, 1);
        let (go, wait) = mpsc::channel::<()>();
        let first = tokio::spawn(pool.try_enter().unwrap().run(move || wait.recv().is_ok()));
        let second = tokio::spawn(pool.try_enter().unwrap().run(|| 2));
        assert!(pool.try_enter().is_none());
        while pool.waiting() == 0 {
            tokio::task::yield_now().await;
        }
        go.send(()).unwrap();
        assert!(first.await.unwrap().unwrap().value);
        assert_eq!(second.await.unwrap().unwrap().value, 2);
        assert_eq!(pool.waiting(), 0);
        assert!(pool.try_enter().is_some());
    }

    #[tokio::test]
    async fn who_goes_away_gives_up_the_turn_but_not_the_worker() {
        let pool = Pool::new(1, 2);
        let (go, wait) = mpsc::channel::<()>();
        let first = tokio::spawn(pool.try_enter().unwrap().run(move || wait.recv().is_ok()));
        let second = tokio::spawn(pool.try_enter().unwrap().run(|| ()));
        while pool.waiting() == 0 {
            tokio::task::yield_now().await;
        }
        second.abort();
        assert!(second.await.is_err());
        first.abort();
        assert!(first.await.is_err());
        // The first one's work goes on: its worker is not free.
        assert_eq!(pool.workers.available_permits(), 0);
        go.send(()).unwrap();
        assert_eq!(pool.try_enter().unwrap().run(|| 3).await.unwrap().value, 3);
    }

    #[tokio::test]
    async fn a_panic_costs_nothing_but_its_own_answer() {
        let pool = Pool::new(1, 0);
        let panicked = pool.try_enter().unwrap().run(|| assert_eq!(1, 2, "on purpose")).await;
        assert!(panicked.is_err());
        assert_eq!(pool.try_enter().unwrap().run(|| 5).await.unwrap().value, 5);
    }
}
