//! Frames on their way through three stages: while one is filtered, the next is
//! loaded and the one before is written.
//!
//! ```text
//! load ──▶ filter, slot 0 ──▶ write       frame n is filtered in slot n mod slots
//!      ╰─▶ filter, slot 1 ─╯
//! ```
//!
//! What it promises:
//! - **Order.** Frames are written in their order, whichever is filtered first.
//! - **Bounded memory.** A frame goes from hand to hand: no stage takes a frame
//!   before it is rid of the one it has, and nothing waits in between. So there
//!   are never more frames in flight than stages: one is loaded, one is written,
//!   and each slot filters one.
//! - **Failures stay with their frame.** One that cannot be loaded or filtered
//!   reaches the last stage as its error, when it is that frame's turn.
//! - **Panics go on.** One in a stage ends the others and is then the caller's.
//!
//! Loading and every slot have a thread of their own, and writing has the
//! caller's. They are not rayon's: a stage that waits must not keep one of those
//! from the other stages' work. Of images the pipeline knows nothing.

use std::num::NonZeroUsize;
use std::panic::resume_unwind;
use std::sync::mpsc::sync_channel;
use std::thread;

/// How many frames are in the stages.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pipeline {
    /// How many are filtered at a time.
    slots: NonZeroUsize,
}

impl Pipeline {
    /// A pipeline that filters so many frames at a time.
    pub(super) const fn new(slots: NonZeroUsize) -> Self {
        Self { slots }
    }

    /// Takes frames 0, 1, … through the stages. An error of `write` is none of
    /// its frame's alone: it ends the run, and frames in flight are dropped.
    ///
    /// # Errors
    /// What `write` returned, if it ended the run.
    pub(super) fn run<Loaded: Send, Filtered: Send, Failure: Send, Stop>(
        self,
        frames: usize,
        mut load: impl FnMut(usize) -> Result<Loaded, Failure> + Send,
        filter: impl Fn(usize, Loaded) -> Result<Filtered, Failure> + Sync,
        mut write: impl FnMut(usize, Result<Filtered, Failure>) -> Result<(), Stop>,
    ) -> Result<(), Stop> {
        let slots = self.slots.get().min(frames.max(1));
        let filter = &filter;
        thread::scope(|scope| {
            let mut threads = Vec::with_capacity(slots + 1);
            let (mut to_filter, mut to_write) = (Vec::new(), Vec::new());
            for _ in 0..slots {
                // Channels without room: to send is to put into the other's hands.
                let (loader, loaded) = sync_channel::<(usize, Result<Loaded, Failure>)>(0);
                let (slot, filtered) = sync_channel(0);
                to_filter.push(loader);
                to_write.push(filtered);
                threads.push(scope.spawn(move || {
                    for (frame, loaded) in loaded {
                        let filtered = loaded.and_then(|loaded| filter(frame, loaded));
                        if slot.send(filtered).is_err() {
                            return;
                        }
                    }
                }));
            }
            threads.push(scope.spawn(move || {
                for frame in 0..frames {
                    if to_filter[frame % slots].send((frame, load(frame))).is_err() {
                        return;
                    }
                }
            }));

            let mut result = Ok(());
            for frame in 0..frames {
                // Nobody sends any more only where a thread has panicked.
                let Ok(filtered) = to_write[frame % slots].recv() else { break };
                result = write(frame, filtered);
                if result.is_err() {
                    break;
                }
            }
            // Whoever still has a frame for this stage, or for one before it,
            // learns now that it will not be taken.
            drop(to_write);
            for thread in threads {
                if let Err(panic) = thread.join() {
                    resume_unwind(panic);
                }
            }
            result
        })
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::Barrier;
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

    use super::*;

    fn pipeline(slots: usize) -> Pipeline {
        Pipeline::new(NonZeroUsize::new(slots).expect("tests filter something"))
    }

    /// Every frame with what became of it, in the order of writing.
    fn written<E: Send>(
        slots: usize,
        frames: usize,
        load: impl FnMut(usize) -> Result<usize, E> + Send,
        filter: impl Fn(usize, usize) -> Result<usize, E> + Sync,
    ) -> Vec<(usize, Result<usize, E>)> {
        let mut written = Vec::new();
        let run = pipeline(slots).run(frames, load, filter, |frame, filtered| {
            written.push((frame, filtered));
            Ok::<(), Infallible>(())
        });
        run.expect("nothing stops it");
        written
    }

    #[test]
    fn frames_are_written_in_their_order() {
        for slots in 1..=3 {
            for frames in [0, 1, 2, 7, 64] {
                let load = |frame| Ok::<_, Infallible>(10 * frame);
                let found = written(slots, frames, load, |frame, loaded| Ok(loaded + frame));
                let expected: Vec<_> = (0..frames).map(|frame| (frame, Ok(11 * frame))).collect();
                assert_eq!(found, expected, "{slots} slots");
            }
        }
    }

    #[test]
    fn a_frame_that_is_filtered_first_waits_for_its_turn() {
        let overtaken = AtomicBool::new(false);
        let filter = |frame, loaded| {
            match frame {
                0 => {
                    while !overtaken.load(Ordering::SeqCst) {
                        thread::yield_now();
                    }
                }
                1 => overtaken.store(true, Ordering::SeqCst),
                _ => {}
            }
            Ok::<usize, Infallible>(loaded)
        };
        let order: Vec<usize> =
            written(2, 4, Ok, filter).into_iter().map(|(frame, _)| frame).collect();
        assert_eq!(order, [0, 1, 2, 3]);
    }

    #[test]
    fn all_stages_work_at_the_same_time() {
        for slots in 1..=3 {
            let frames = slots + 2;
            // Whoever comes here waits for the others, so they must all be at work.
            let meeting = Barrier::new(frames);
            let meet = |expected: usize, frame: usize| {
                if frame == expected {
                    meeting.wait();
                }
            };
            let run = pipeline(slots).run(
                frames,
                |frame| {
                    meet(frames - 1, frame);
                    Ok::<usize, Infallible>(frame)
                },
                |frame, loaded| {
                    (1..=slots).for_each(|slot| meet(slot, frame));
                    Ok(loaded)
                },
                |frame, _| {
                    meet(0, frame);
                    Ok::<(), Infallible>(())
                },
            );
            run.expect("nothing stops it");
        }
    }

    #[test]
    fn there_are_never_more_frames_in_flight_than_stages() {
        for slots in 1..=3 {
            let (flying, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
            let run = pipeline(slots).run(
                200,
                |frame| {
                    most.fetch_max(1 + flying.fetch_add(1, Ordering::SeqCst), Ordering::SeqCst);
                    if frame % 5 == 3 { Err(frame) } else { Ok(frame) }
                },
                |frame, loaded| if frame % 7 == 2 { Err(frame) } else { Ok(loaded) },
                |_, _| {
                    // Gives the other stages the chance to run ahead.
                    thread::yield_now();
                    flying.fetch_sub(1, Ordering::SeqCst);
                    Ok::<(), Infallible>(())
                },
            );
            run.expect("nothing stops it");
            assert_eq!(flying.into_inner(), 0);
            let most = most.into_inner();
            assert!(most <= slots + 2, "{most} frames in flight with {slots} slots");
        }
    }

    #[test]
    fn a_frame_that_fails_does_not_stop_the_others() {
        let load = |frame| if frame == 1 { Err("load") } else { Ok(frame) };
        let filter = |frame, loaded| if frame == 3 { Err("filter") } else { Ok(loaded) };
        for slots in 1..=3 {
            let found = written(slots, 5, load, filter);
            let expected = [Ok(0), Err("load"), Ok(2), Err("filter"), Ok(4)];
            assert_eq!(found, expected.into_iter().enumerate().collect::<Vec<_>>());
        }
    }

    #[test]
    fn an_error_of_the_last_stage_ends_the_run() {
        for slots in 1..=3 {
            let loaded = AtomicUsize::new(0);
            let mut written = Vec::new();
            let run = pipeline(slots).run(
                usize::MAX,
                |frame| {
                    loaded.fetch_add(1, Ordering::SeqCst);
                    Ok::<usize, Infallible>(frame)
                },
                |_, loaded| Ok(loaded),
                |frame, _| {
                    written.push(frame);
                    if frame == 2 { Err("full") } else { Ok(()) }
                },
            );
            assert_eq!((run, written), (Err("full"), vec![0, 1, 2]));
            assert!(loaded.into_inner() <= 3 + slots + 1);
        }
    }

    #[test]
    fn a_panic_in_a_stage_is_the_callers() {
        for slots in 1..=3 {
            for stage in ["load", "filter", "write"] {
                let at = |here, frame| {
                    assert!(here != stage || frame != 4, "{here} broke");
                };
                let mut written = Vec::new();
                let run = catch_unwind(AssertUnwindSafe(|| {
                    pipeline(slots).run(
                        usize::MAX,
                        |frame| {
                            at("load", frame);
                            Ok::<usize, Infallible>(frame)
                        },
                        |frame, loaded| {
                            at("filter", frame);
                            Ok(loaded)
                        },
                        |frame, _| {
                            at("write", frame);
                            written.push(frame);
                            Ok::<(), Infallible>(())
                        },
                    )
                }));
                let panic = run.expect_err("a stage panics");
                let message = panic.downcast_ref::<String>().expect("assert! formats");
                assert_eq!(*message, format!("{stage} broke"));
                assert_eq!(written, [0, 1, 2, 3], "{stage} with {slots} slots");
            }
        }
    }
}
