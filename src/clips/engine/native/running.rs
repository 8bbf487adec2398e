//! An environment with the functions that it can call.

use std::cell::Cell;
use std::ffi::{CStr, c_char, c_ushort, c_void};
use std::ops::Deref;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;

use clips_sys as sys;

use super::call::{CallError, Function, called, length};
use super::environment::Environment;
use super::handle::Alive;
use super::host::{Host, Shared};
use super::router;
use super::text::c_text;
use super::value::Value;

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

impl<'h> Running<'h> {
    /// Makes a function known; of `most` none there may be any number of arguments.
    ///
    /// # Errors
    /// Where CLIPS has a function of that name.
    pub(crate) fn define(
        &mut self,
        name: &str,
        least: u16,
        most: Option<u16>,
        body: impl Fn(&Environment, &[Value]) -> Result<Value, CallError> + 'h,
    ) -> Result<(), String> {
        let function = Box::new(Function { name: c_text(name), body: Box::new(body), environment: self.share() });
        let most = most.unwrap_or(u16::MAX);
        let context = std::ptr::from_ref::<Function<'h>>(&function).cast_mut().cast();
        let word = function.name.as_ptr();
        // SAFETY: name and function live in a box that is kept until the environment is gone, and
        // there is no mutable reference to it.
        let error = unsafe {
            sys::AddUDF(self.raw(), word, std::ptr::null(), least, most, std::ptr::null(), Some(called), word, context)
        };
        if error != sys::AddUDFError_AUE_NO_ERROR {
            return Err(format!("CLIPS has a function `{name}` already"));
        }
        self.keep(function);
        Ok(())
    }
}

impl Running<'_> {
    /// Makes `length` known, which CLIPS 6.40 has no more, and lets `length$` take texts again.
    ///
    /// # Errors
    /// Where CLIPS has a function of that name.
    pub(crate) fn define_length(&mut self, name: &'static CStr) -> Result<(), String> {
        // SAFETY: the names are there as long as the program, and nothing that would call the removed function is loaded.
        let error = unsafe {
            sys::RemoveUDF(self.raw(), name.as_ptr());
            let (own, one) = (c"length".as_ptr(), c"msy".as_ptr());
            sys::AddUDF(self.raw(), name.as_ptr(), c"l".as_ptr(), 1, 1, one, Some(length), own, std::ptr::null_mut())
        };
        match error {
            sys::AddUDFError_AUE_NO_ERROR => Ok(()),
            _ => Err(format!("CLIPS has a function `{}` already", name.to_string_lossy())),
        }
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
