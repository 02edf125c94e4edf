//! Tasks on all cores: each worker takes the next one as soon as it is free.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::thread;

use crate::RunError;

/// Stack of a worker. Solvers keep fixed-size matrices on it, and a spawned thread gets less than
/// the main one unless told otherwise.
const STACK_BYTES: usize = 16 << 20;

/// Does `work` for each seed, `jobs` at a time, and hands the results to `keep` on the calling
/// thread, in the order in which they are done. The first error of `keep` ends it all.
pub fn for_each<T: Send>(
    seeds: &[u64],
    jobs: NonZeroUsize,
    work: &(dyn Fn(u64) -> T + Sync),
    mut keep: impl FnMut(T) -> Result<(), RunError>,
) -> Result<(), RunError> {
    let next = AtomicUsize::new(0);
    let (sender, results) = mpsc::sync_channel(jobs.get());
    thread::scope(|scope| {
        for worker in 0..jobs.get().min(seeds.len()) {
            let (sender, next) = (sender.clone(), &next);
            thread::Builder::new()
                .name(format!("flight-{worker}"))
                .stack_size(STACK_BYTES)
                .spawn_scoped(scope, move || {
                    while let Some(seed) = seeds.get(next.fetch_add(1, Ordering::Relaxed)) {
                        if sender.send(work(*seed)).is_err() {
                            break;
                        }
                    }
                })
                .map_err(no_thread)?;
        }
        drop(sender);
        // Returning drops `results`, at which the workers stop.
        results.into_iter().try_for_each(&mut keep)
    })
}

fn no_thread(error: std::io::Error) -> RunError {
    RunError::Input {
        what: "--jobs".into(),
        finding: format!("the system refuses a thread: {error}"),
        remedy: "Ask for fewer".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jobs(n: usize) -> NonZeroUsize {
        NonZeroUsize::new(n).unwrap()
    }

    #[test]
    fn every_task_is_done_once() {
        let seeds: Vec<u64> = (0..100).collect();
        for n in [1, 3, 200] {
            let mut done = Vec::new();
            for_each(&seeds, jobs(n), &|seed| seed, |seed| {
                done.push(seed);
                Ok(())
            })
            .unwrap();
            done.sort_unstable();
            assert_eq!(done, seeds);
        }
    }

    #[test]
    fn an_error_ends_the_work() {
        let seeds: Vec<u64> = (0..1000).collect();
        let worked = AtomicUsize::new(0);
        let work = |seed| {
            worked.fetch_add(1, Ordering::Relaxed);
            seed
        };
        let found = for_each(&seeds, jobs(2), &work, |_| {
            Err(no_thread(std::io::Error::other("test")))
        });
        assert!(found.is_err());
        // One was kept, the channel holds two, each worker holds one that it cannot hand over.
        assert!(worked.into_inner() <= 5);
    }
}
