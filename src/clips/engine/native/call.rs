//! Functions of Rust that programs of CLIPS call.

use std::ffi::CString;
use std::panic::{AssertUnwindSafe, catch_unwind};

use clips_sys as sys;

use super::environment::Environment;
use super::text::{c_text, size, text};
use super::value::Value;
use crate::saturate::to_i64;

/// Why a function has no value. The evaluation that called it ends.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum CallError {
    /// An argument, counted from 1, is not what was expected.
    Argument(u32, &'static str),
    /// Anything else, as a sentence.
    Failed(String),
    /// An argument could not be evaluated; CLIPS has printed why.
    Reported,
}

/// A function with its name.
pub(super) struct Function<'h> {
    pub(super) name: CString,
    #[allow(clippy::type_complexity, reason = "it is spelled out once")]
    pub(super) body: Box<dyn Fn(&Environment, &[Value]) -> Result<Value, CallError> + 'h>,
    pub(super) environment: Environment,
}

/// What CLIPS calls, whichever function is meant.
pub(super) unsafe extern "C" fn called(
    _: *mut sys::Environment,
    context: *mut sys::UDFContext,
    returned: *mut sys::UDFValue,
) {
    // SAFETY: `context` is what CLIPS has of the call, with the box that `define` gave it, which
    // lives as long as the environment that calls.
    let function = unsafe { &*(*context).context.cast::<Function<'_>>() };
    let environment = &function.environment;
    let value = catch_unwind(AssertUnwindSafe(|| {
        // SAFETY: the context is that of this call.
        let arguments = unsafe { arguments(environment, context) }.ok_or(CallError::Reported)?;
        (function.body)(environment, &arguments)
    }));
    let value = value.unwrap_or_else(|_| Err(CallError::Failed("it failed in a way that it should not".to_owned())));
    let value = value.unwrap_or_else(|error| {
        complain(function, &error);
        Value::truth(false)
    });
    let native = environment.to_native(&value);
    // SAFETY: CLIPS wants the value there; a multifield's range is all of it.
    unsafe {
        (*returned).__bindgen_anon_1.header = native.__bindgen_anon_1.header;
        if let Value::Many(values) = &value {
            (*returned).begin = 0;
            (*returned).range = size(values.len());
        }
    }
}

/// `(length VALUE)` and `(length$ VALUE)` as CLIPS 6.30 has them: how many values a multifield has, or characters a text.
/// They are called often, and take no copy of the value.
pub(super) unsafe extern "C" fn length(
    raw: *mut sys::Environment,
    context: *mut sys::UDFContext,
    returned: *mut sys::UDFValue,
) {
    const TAKEN: u32 = sys::CLIPSType_MULTIFIELD_BIT | sys::CLIPSType_SYMBOL_BIT | sys::CLIPSType_STRING_BIT;
    // SAFETY: `context` is that of this call; the value stays while it is looked at, and `returned` is where CLIPS wants
    // the result.
    unsafe {
        let mut value = sys::UDFValue::default();
        let mut length = -1;
        if sys::UDFNthArgument(context, 1, TAKEN, &raw mut value) {
            let header = value.__bindgen_anon_1.header;
            length = match u32::from((*header).type_) {
                sys::MULTIFIELD_TYPE => to_i64(value.range),
                _ => {
                    let text = text((*header.cast::<sys::CLIPSLexeme>()).contents);
                    to_i64(text.chars().count())
                }
            };
        }
        (*returned).__bindgen_anon_1.integerValue = sys::CreateInteger(raw, length);
    }
}

/// The values of all arguments, or nothing where one could not be evaluated.
///
/// # Safety
/// The context is that of a call that is going on.
unsafe fn arguments(environment: &Environment, context: *mut sys::UDFContext) -> Option<Vec<Value>> {
    const ANY: u32 = (sys::CLIPSType_BOOLEAN_BIT << 1) - 1;
    // SAFETY: the caller's promise; each value is read before the next one is made.
    unsafe {
        let count = sys::UDFArgumentCount(context);
        (1..=count)
            .map(|nth| {
                let mut native = sys::UDFValue::default();
                if !sys::UDFNthArgument(context, nth, ANY, &raw mut native) || environment.has_failed() {
                    return None;
                }
                let header = native.__bindgen_anon_1.header;
                Some(match u32::from((*header).type_) {
                    sys::MULTIFIELD_TYPE => {
                        Value::Many(environment.elements(header.cast(), native.begin, native.range))
                    }
                    _ => environment.value(header),
                })
            })
            .collect()
    }
}

/// Prints the error as CLIPS does, and ends the evaluation.
fn complain(function: &Function<'_>, error: &CallError) {
    let environment = &function.environment;
    match error {
        CallError::Reported => {}
        CallError::Argument(nth, expected) => {
            // SAFETY: the environment is alive, and the texts are only read.
            unsafe {
                sys::ExpectedTypeError1(environment.raw(), function.name.as_ptr(), *nth, c_text(expected).as_ptr());
            }
        }
        CallError::Failed(message) => {
            environment.complain(&format!("[RMEM1] Function '{}': {message}", function.name.to_string_lossy()));
        }
    }
    environment.fail();
}
