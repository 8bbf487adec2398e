//! What an environment needs from the program around it.

use std::cell::Cell;
use std::ffi::{CStr, c_int};
use std::rc::Rc;

/// Where a program prints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stream {
    /// `stdout`, or `t`.
    Out,
    /// `stderr` and `stdwrn`.
    Err,
}

impl Stream {
    pub(super) fn named(name: &CStr) -> Option<Self> {
        match name.to_bytes() {
            b"stdout" => Some(Self::Out),
            b"stderr" | b"stdwrn" => Some(Self::Err),
            _ => None,
        }
    }
}

/// Who an environment talks to.
pub(crate) trait Host {
    /// A program prints.
    fn write(&self, stream: Stream, bytes: &[u8]);
    /// A program reads from stdin: the next byte, or nothing at its end.
    fn read(&self) -> Option<u8>;
    /// A program wants to end with a code.
    fn exit(&self, code: i32);
    /// Nothing knows this external address any more.
    fn discard(&self, handle: u64);
    /// A text that is being loaded has a mistake, or something doubtful, at a line.
    fn parsed(&self, line: usize, doubtful: bool, text: &str);
}

/// What C's side of an environment knows of Rust's.
pub(super) struct Shared<'h> {
    pub(super) host: Rc<dyn Host + 'h>,
    /// A character that was read too much.
    pub(super) unread: Cell<Option<c_int>>,
    /// Whether the rule that fired last said `(halt)`.
    pub(super) halted: Cell<bool>,
}
