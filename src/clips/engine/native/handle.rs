//! A reference to a fact that Rust keeps.

use std::cell::Cell;
use std::ffi::c_ushort;
use std::rc::Rc;

use clips_sys as sys;

/// Whether the environment still exists, and the type of its external addresses.
#[derive(Debug)]
pub(super) struct Alive {
    pub(super) is: Cell<bool>,
    pub(super) address_type: c_ushort,
}

impl Alive {
    pub(super) fn is(&self) -> bool {
        self.is.get()
    }
}

/// A fact, there or retracted. It is told apart from any later one.
#[derive(Debug)]
pub(crate) struct FactRef {
    fact: *mut sys::Fact,
    alive: Rc<Alive>,
}

impl FactRef {
    /// # Safety
    /// The pointer is to a fact of the environment.
    pub(super) unsafe fn new(fact: *mut sys::Fact, alive: &Rc<Alive>) -> Self {
        // SAFETY: the caller's promise.
        unsafe { sys::RetainFact(fact) };
        Self { fact, alive: Rc::clone(alive) }
    }

    /// The pointer, where the fact is one of this environment and that is alive.
    pub(super) fn pointer(&self, alive: &Rc<Alive>) -> Option<*mut sys::Fact> {
        (self.alive.is() && Rc::ptr_eq(&self.alive, alive)).then_some(self.fact)
    }
}

impl Clone for FactRef {
    fn clone(&self) -> Self {
        if self.alive.is() {
            // SAFETY: the environment is alive, and keeps the fact because it is retained.
            unsafe { sys::RetainFact(self.fact) };
        }
        Self { fact: self.fact, alive: Rc::clone(&self.alive) }
    }
}

impl Drop for FactRef {
    fn drop(&mut self) {
        if self.alive.is() {
            // SAFETY: as for `clone`; this gives back what was retained.
            unsafe { sys::ReleaseFact(self.fact) };
        }
    }
}

impl PartialEq for FactRef {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self.fact, other.fact) && Rc::ptr_eq(&self.alive, &other.alive)
    }
}
