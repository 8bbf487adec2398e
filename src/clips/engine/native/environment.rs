//! An environment of CLIPS and what it needs to live.

use std::cell::Cell;
use std::ffi::{c_char, c_int, c_ushort, c_void};
use std::ops::Deref;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;

use clips_sys as sys;

use super::call::Function;
use super::router::{self, Stream};
use super::value::{c_text, size};

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

/// Whether the environment is still there.
#[derive(Debug)]
pub(super) struct Alive {
    is: Cell<bool>,
    address_type: c_ushort,
}

impl Alive {
    pub(super) fn is(&self) -> bool {
        self.is.get()
    }
}

/// What C's side of an environment knows of Rust's.
pub(super) struct Shared<'h> {
    pub(super) host: Rc<dyn Host + 'h>,
    /// A character that was read too much.
    pub(super) unread: Cell<Option<c_int>>,
    /// Whether the rule that fired last said `(halt)`.
    halted: Cell<bool>,
}

/// An environment; used from one thread. Others get it from a [`Running`], as a reference.
#[derive(Debug)]
pub(crate) struct Environment {
    raw: *mut sys::Environment,
    alive: Rc<Alive>,
}

/// An environment with its functions. Dropping it destroys the environment.
pub(crate) struct Running<'h> {
    environment: Environment,
    #[expect(clippy::vec_box, reason = "C has pointers to them, so that they must not move")]
    functions: Vec<Box<Function<'h>>>,
    shared: Box<Shared<'h>>,
}

impl<'h> Running<'h> {
    /// A new environment, in which nothing is but what CLIPS has by itself.
    pub(crate) fn new(host: Rc<dyn Host + 'h>) -> Option<Self> {
        let shared = Box::new(Shared { host, unread: Cell::new(None), halted: Cell::new(false) });
        // SAFETY: the context is a box that is kept until the environment is gone; CLIPS copies
        // the description of the addresses.
        unsafe {
            let raw = sys::CreateEnvironment();
            if raw.is_null() {
                return None;
            }
            sys::SetEnvironmentContext(raw, std::ptr::from_ref::<Shared<'h>>(&shared).cast_mut().cast());
            router::install(raw);
            sys::AddAfterRuleFiresFunction(raw, c"rmem".as_ptr(), Some(fired), 0, std::ptr::null_mut());
            let mut addresses = sys::externalAddressType {
                name: c"rmem".as_ptr(),
                shortPrintFunction: Some(print),
                longPrintFunction: Some(print),
                discardFunction: Some(discard),
                newFunction: None,
                callFunction: None,
            };
            let kind = sys::InstallExternalAddressType(raw, &raw mut addresses);
            let alive = Alive { is: Cell::new(true), address_type: c_ushort::try_from(kind).unwrap_or_default() };
            let alive = Rc::new(alive);
            Some(Self { environment: Environment { raw, alive }, functions: Vec::new(), shared })
        }
    }

    /// Keeps a function as long as the environment.
    pub(super) fn keep(&mut self, function: Box<Function<'h>>) {
        self.functions.push(function);
    }
}

impl Deref for Running<'_> {
    type Target = Environment;

    fn deref(&self) -> &Environment {
        &self.environment
    }
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        self.environment.alive.is.set(false);
        self.shared.unread.set(None);
        // SAFETY: nothing uses the environment any more: facts see that it is gone. What C has
        // pointers to is dropped after this.
        unsafe { sys::DestroyEnvironment(self.environment.raw) };
    }
}

impl Environment {
    pub(super) fn raw(&self) -> *mut sys::Environment {
        self.raw
    }

    pub(super) fn alive(&self) -> &Rc<Alive> {
        &self.alive
    }

    pub(super) fn address_type(&self) -> c_ushort {
        self.alive.address_type
    }

    /// The same environment, for what a [`Running`] keeps.
    pub(super) fn share(&self) -> Self {
        Self { raw: self.raw, alive: Rc::clone(&self.alive) }
    }

    /// Loads constructs from a text; says whether all of them are good. The host is told what
    /// is not.
    pub(crate) fn load(&self, text: &str) -> bool {
        // SAFETY: the environment is alive; the text is read while it is loaded.
        unsafe { sys::LoadFromString(self.raw, text.as_ptr().cast::<c_char>(), size(text.len())) }
    }

    /// Removes all facts and asserts those of `deffacts`.
    pub(crate) fn reset(&self) {
        // SAFETY: the environment is alive.
        unsafe { sys::Reset(self.raw) };
    }

    /// Fires at most so many rules, all that can fire where there is no limit; gives how many fired.
    pub(crate) fn run(&self, limit: Option<u64>) -> u64 {
        let limit = limit.map_or(-1, |limit| i64::try_from(limit).unwrap_or(i64::MAX));
        // SAFETY: the environment is alive.
        u64::try_from(unsafe { sys::Run(self.raw, limit) }).unwrap_or_default()
    }

    /// Whether the last run ended because a program said `(halt)`.
    pub(crate) fn is_halted(&self) -> bool {
        // SAFETY: the environment is alive, and its context with it.
        unsafe { (*sys::GetEnvironmentContext(self.raw).cast::<Shared<'_>>()).halted.get() }
    }

    /// Prints on `stderr`, a line.
    pub(crate) fn complain(&self, line: &str) {
        // SAFETY: the environment is alive; the texts are only read.
        unsafe { sys::WriteString(self.raw, c"stderr".as_ptr(), c_text(&format!("{line}\n")).as_ptr()) };
    }

    /// Ends the evaluation that is going on, as an error.
    pub(crate) fn fail(&self) {
        // SAFETY: the environment is alive.
        unsafe {
            sys::SetEvaluationError(self.raw, true);
            sys::SetHaltExecution(self.raw, true);
        }
    }

    /// Whether an evaluation ended with an error.
    pub(crate) fn has_failed(&self) -> bool {
        // SAFETY: the environment is alive.
        unsafe { sys::GetEvaluationError(self.raw) || sys::GetHaltExecution(self.raw) }
    }
}

unsafe extern "C" fn fired(raw: *mut sys::Environment, _: *mut sys::Activation, _: *mut c_void) {
    // SAFETY: the context is the box that was given, which outlives the environment.
    unsafe { (*sys::GetEnvironmentContext(raw).cast::<Shared<'_>>()).halted.set(sys::GetHaltRules(raw)) };
}

unsafe extern "C" fn print(raw: *mut sys::Environment, stream: *const c_char, contents: *mut c_void) {
    let text = c_text(&format!("<Pointer-rmem-{:x}>", contents as usize));
    // SAFETY: CLIPS gives the environment and a stream of it.
    unsafe { sys::WriteString(raw, stream, text.as_ptr()) };
}

unsafe extern "C" fn discard(raw: *mut sys::Environment, contents: *mut c_void) -> bool {
    // SAFETY: the context is the box that was given, which outlives the environment.
    let shared = unsafe { &*sys::GetEnvironmentContext(raw).cast::<Shared<'_>>() };
    let _ = catch_unwind(AssertUnwindSafe(|| shared.host.discard(contents as u64)));
    true
}
