//! What an environment needs from the program around it.

use std::cell::Cell;
use std::ffi::{CStr, c_int};
use std::rc::Rc;

/// Where a program prints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stream {
    /// `stdout`, or `t`.
    Out,
    /// `stderr`, and the names under which warnings and logs go there.
    Err,
}

impl Stream {
    pub(super) fn named(name: &CStr) -> Option<Self> {
        match name.to_bytes() {
            b"stdout" => Some(Self::Out),
            b"stderr" | b"stdwrn" => Some(Self::Err),
            // As CLIPS 6.30 calls them.
            b"werror" | b"wwarning" | b"wtrace" | b"wdialog" => Some(Self::Err),
            // The logs of Fawkes, of the executive and of the referee box.
            b"error" | b"warn" | b"info" | b"debug" | b"logerror" | b"logwarn" | b"loginfo" | b"logdebug" => {
                Some(Self::Err)
            }
            _ => None,
        }
    }
}

/// The program around an environment.
pub(crate) trait Host {
    /// Called when a program prints.
    fn write(&self, stream: Stream, bytes: &[u8]);
    /// Called when a program reads from stdin: returns the next byte, or nothing at its end.
    fn read(&self) -> Option<u8>;
    /// Called when a program exits with a code.
    fn exit(&self, code: i32);
    /// Called when CLIPS has no reference to this external address any more.
    fn discard(&self, handle: u64);
    /// Called when a text that is being loaded has a mistake, or a warning, at a line.
    fn parsed(&self, line: usize, is_warning: bool, text: &str);
}

/// What C's side of an environment knows of Rust's.
pub(super) struct Shared<'h> {
    pub(super) host: Rc<dyn Host + 'h>,
    /// A character that was read too much.
    pub(super) unread: Cell<Option<c_int>>,
    /// Whether the rule that fired last called `(halt)`.
    pub(super) halted: Cell<bool>,
}
