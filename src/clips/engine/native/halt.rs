//! Ending an evaluation that does not end by itself, from another thread.

use std::ffi::c_int;
use std::sync::Condvar;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::time::Duration;

use clips_sys as sys;

use super::environment::Environment;

/// How often to check whether an evaluation is to halt: a user does not notice the delay.
const POLL_INTERVAL: Duration = Duration::from_millis(5);

/// How deep calls of functions may be nested: each takes some hundred bytes of the stack.
pub(super) const DEEPEST: i32 = 40_000;

/// The flags of an environment that end its evaluation.
struct Flags {
    error: *const AtomicBool,
    halt: *const AtomicBool,
    depth: *const AtomicI32,
}

// SAFETY: the flags are read and written as a whole.
unsafe impl Send for Flags {}

impl Environment {
    /// Does something with this environment. Whatever CLIPS evaluates meanwhile ends soon after `stop`
    /// says so, or when its functions call themselves too deeply; then `deep` is set.
    pub(crate) fn watched<T>(
        &self,
        stop: &(dyn Fn() -> bool + Sync),
        deep: &AtomicBool,
        work: impl FnOnce() -> T,
    ) -> T {
        let flags = self.flags();
        let (over, ended) = (Mutex::new(false), Condvar::new());
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let flags = flags;
                let mut guard = over.lock().unwrap_or_else(PoisonError::into_inner);
                while !*guard {
                    flags.look(stop, deep);
                    guard = ended.wait_timeout(guard, POLL_INTERVAL).unwrap_or_else(PoisonError::into_inner).0;
                }
            });
            let _ended = Ended { over: &over, ended: &ended };
            work()
        })
    }

    fn flags(&self) -> Flags {
        // SAFETY: the data stays where it is as long as the environment, of which a caller of
        // `watched` has a living one. C's `bool` and `int` are as large and as aligned as the
        // atomics, whose loads and stores are plain ones on the machine.
        unsafe {
            let data = (*self.raw().cast::<sys::environmentData>()).theData;
            let evaluation = (*data.add(sys::EVALUATION_DATA as usize)).cast::<sys::evaluationData>();
            Flags {
                error: std::ptr::addr_of_mut!((*evaluation).EvaluationError).cast(),
                halt: std::ptr::addr_of_mut!((*evaluation).HaltExecution).cast(),
                depth: std::ptr::addr_of_mut!((*evaluation).CurrentEvaluationDepth).cast::<c_int>().cast(),
            }
        }
    }
}

impl Flags {
    fn look(&self, stop: &(dyn Fn() -> bool + Sync), deep: &AtomicBool) {
        // SAFETY: the environment is alive while it is watched.
        let (error, halt, depth) = unsafe { (&*self.error, &*self.halt, &*self.depth) };
        let is_deep = depth.load(Ordering::Relaxed) > DEEPEST;
        if is_deep {
            deep.store(true, Ordering::Relaxed);
        }
        if is_deep || stop() {
            error.store(true, Ordering::Relaxed);
            halt.store(true, Ordering::Relaxed);
        }
    }
}

/// Ends the watching when the work is over, however that ends.
struct Ended<'a> {
    over: &'a Mutex<bool>,
    ended: &'a Condvar,
}

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        *self.over.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.ended.notify_all();
    }
}
