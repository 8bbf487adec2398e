//! An environment of CLIPS.

use std::ffi::{c_char, c_ushort};
use std::rc::Rc;

use clips_sys as sys;

use super::handle::Alive;
use super::host::Shared;
use super::text::{c_text, size};
use crate::saturate::to_i64;

/// An environment; used from one thread. Others get it from a [`Running`], as a reference.
#[derive(Debug)]
pub(crate) struct Environment {
    pub(super) raw: *mut sys::Environment,
    pub(super) alive: Rc<Alive>,
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

    /// Loads constructs from a text; returns whether all of them are correct. The host receives
    /// the mistakes.
    pub(crate) fn load(&self, text: &str) -> bool {
        // SAFETY: the environment is alive; the text is read while it is loaded.
        unsafe { sys::LoadFromString(self.raw, text.as_ptr().cast::<c_char>(), size(text.len())) }
    }

    /// Runs a command as a batch file does; returns whether it was one.
    pub(crate) fn command(&self, text: &str) -> bool {
        // SAFETY: the environment is alive; the text is copied.
        unsafe { sys::RouteCommand(self.raw, c_text(&format!("{text}\n")).as_ptr(), false) }
    }

    /// Forgets that an evaluation ended with an error.
    pub(crate) fn recover(&self) {
        // SAFETY: the environment is alive.
        unsafe {
            sys::SetEvaluationError(self.raw, false);
            sys::SetHaltExecution(self.raw, false);
        }
    }

    /// Removes a function of CLIPS, so that a program can define one of that name. Nothing may call it yet.
    pub(crate) fn remove_function(&self, name: &str) {
        // SAFETY: the environment is alive; the text is only read.
        unsafe { sys::RemoveUDF(self.raw, c_text(name).as_ptr()) };
    }

    /// Removes all facts and asserts those of `deffacts`.
    pub(crate) fn reset(&self) {
        // SAFETY: the environment is alive.
        unsafe { sys::Reset(self.raw) };
    }

    /// Fires at most so many rules, all that can fire where there is no limit; returns how many fired.
    pub(crate) fn run(&self, limit: Option<u64>) -> u64 {
        let limit = limit.map_or(-1, to_i64);
        // SAFETY: the environment is alive.
        u64::try_from(unsafe { sys::Run(self.raw, limit) }).unwrap_or_default()
    }

    /// Whether the last run ended because a program called `(halt)`.
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
