//! Texts and sizes of C.

use std::ffi::{CStr, CString, c_char};

use clips_sys as sys;

/// A size of C's.
pub(super) fn size(size: usize) -> sys::size_t {
    sys::size_t::try_from(size).unwrap_or(sys::size_t::MAX)
}

/// A text of CLIPS; what is not UTF-8 in it is replaced.
///
/// # Safety
/// The pointer is null or to a text that ends with a NUL and stays during the call.
pub(super) unsafe fn text(pointer: *const c_char) -> String {
    if pointer.is_null() {
        return String::new();
    }
    // SAFETY: the caller's promise.
    unsafe { CStr::from_ptr(pointer) }.to_string_lossy().into_owned()
}

/// A text for CLIPS, which ends at its first NUL there.
pub(super) fn c_text(text: &str) -> CString {
    let end = text.find('\0').unwrap_or(text.len());
    CString::new(text.get(..end).unwrap_or_default()).unwrap_or_default()
}
