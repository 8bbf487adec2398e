//! What programs print and read, and how they ask to end.

use std::ffi::{CStr, c_char, c_int, c_long, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

use clips_sys as sys;

use super::host::{Shared, Stream};
use super::text::text;

/// Puts rmem in place of the terminal.
///
/// # Safety
/// The environment is alive, and its context is a [`Shared`] that outlives it.
pub(super) unsafe fn install(raw: *mut sys::Environment) {
    // SAFETY: the caller's promise. The name is copied.
    unsafe {
        sys::AddRouter(
            raw,
            c"rmem".as_ptr(),
            20,
            Some(wants),
            Some(write),
            Some(read),
            Some(unread),
            Some(exit),
            std::ptr::null_mut(),
        );
        sys::SetParserErrorCallback(raw, Some(parsed), std::ptr::null_mut());
    }
}

/// What is shared with the environment.
///
/// # Safety
/// The environment is one that a [`super::Running`] owns.
unsafe fn shared<'a>(raw: *mut sys::Environment) -> &'a Shared<'a> {
    // SAFETY: its context is never anything else, and outlives it.
    unsafe { &*sys::GetEnvironmentContext(raw).cast::<Shared<'a>>() }
}

unsafe extern "C" fn wants(_: *mut sys::Environment, name: *const c_char, _: *mut c_void) -> bool {
    // SAFETY: CLIPS gives the name of a stream.
    let name = unsafe { CStr::from_ptr(name) };
    Stream::named(name).is_some() || name == c"stdin"
}

unsafe extern "C" fn write(raw: *mut sys::Environment, name: *const c_char, text: *const c_char, _: *mut c_void) {
    // SAFETY: CLIPS gives texts that stay during the call.
    let (shared, name, text) = unsafe { (shared(raw), CStr::from_ptr(name), CStr::from_ptr(text)) };
    if let Some(stream) = Stream::named(name) {
        let _ = catch_unwind(AssertUnwindSafe(|| shared.host.write(stream, text.to_bytes())));
    }
}

unsafe extern "C" fn read(raw: *mut sys::Environment, _: *const c_char, _: *mut c_void) -> c_int {
    // SAFETY: as for `write`.
    let shared = unsafe { shared(raw) };
    if let Some(character) = shared.unread.take() {
        return character;
    }
    let read = catch_unwind(AssertUnwindSafe(|| shared.host.read()));
    read.ok().flatten().map_or(-1, c_int::from)
}

unsafe extern "C" fn unread(raw: *mut sys::Environment, _: *const c_char, character: c_int, _: *mut c_void) -> c_int {
    // SAFETY: as for `write`.
    unsafe { shared(raw) }.unread.set(Some(character));
    character
}

unsafe extern "C" fn exit(raw: *mut sys::Environment, code: c_int, _: *mut c_void) {
    // SAFETY: as for `write`. CLIPS goes on after that, until the flags stop it.
    unsafe {
        sys::AbortExit(raw);
        let _ = catch_unwind(AssertUnwindSafe(|| shared(raw).host.exit(code)));
        sys::SetHaltExecution(raw, true);
    }
}

unsafe extern "C" fn parsed(
    raw: *mut sys::Environment,
    _: *const c_char,
    warning: *const c_char,
    error: *const c_char,
    line: c_long,
    _: *mut c_void,
) {
    // SAFETY: as for `write`; one of the texts is null.
    let (shared, warning, error) = unsafe { (shared(raw), text(warning), text(error)) };
    let line = usize::try_from(line).unwrap_or_default();
    let (doubtful, text) = if error.is_empty() { (true, warning) } else { (false, error) };
    let _ = catch_unwind(AssertUnwindSafe(|| shared.host.parsed(line, doubtful, &text)));
}
