//! Values of CLIPS to values of Rust, and back.

use std::ffi::c_void;

use clips_sys as sys;

use super::environment::Environment;
use super::handle::FactRef;
use super::text::{c_text, size, text};
use super::value::Value;

impl Environment {
    /// The value that CLIPS has at a place.
    ///
    /// # Safety
    /// `header` is null or points to a value of this environment that stays during the call.
    pub(super) unsafe fn value(&self, header: *mut sys::TypeHeader) -> Value {
        if header.is_null() {
            return Value::Void;
        }
        // SAFETY: every value of CLIPS begins with its header, which says what the rest is.
        unsafe {
            match u32::from((*header).type_) {
                sys::SYMBOL_TYPE => Value::Symbol(text((*header.cast::<sys::CLIPSLexeme>()).contents)),
                sys::STRING_TYPE => Value::Text(text((*header.cast::<sys::CLIPSLexeme>()).contents)),
                sys::INSTANCE_NAME_TYPE => Value::Instance(text((*header.cast::<sys::CLIPSLexeme>()).contents)),
                sys::INTEGER_TYPE => Value::Integer((*header.cast::<sys::CLIPSInteger>()).contents),
                sys::FLOAT_TYPE => Value::Float((*header.cast::<sys::CLIPSFloat>()).contents),
                sys::MULTIFIELD_TYPE => {
                    let many = header.cast::<sys::Multifield>();
                    Value::Many(self.elements(many, 0, (*many).length))
                }
                sys::FACT_ADDRESS_TYPE => Value::Fact(FactRef::new(header.cast(), self.alive())),
                sys::EXTERNAL_ADDRESS_TYPE => {
                    let address = header.cast::<sys::CLIPSExternalAddress>();
                    match (*address).type_ == self.address_type() {
                        true => Value::Address((*address).contents as u64),
                        false => Value::Foreign,
                    }
                }
                sys::VOID_TYPE => Value::Void,
                _ => Value::Foreign,
            }
        }
    }

    /// Some values of a multifield.
    ///
    /// # Safety
    /// The multifield is one of this environment and has so many values.
    pub(super) unsafe fn elements(
        &self,
        many: *mut sys::Multifield,
        begin: sys::size_t,
        count: sys::size_t,
    ) -> Vec<Value> {
        // SAFETY: `contents` is declared with one element and continues behind it; no reference
        // to the declared array is made.
        unsafe {
            let first = std::ptr::addr_of!((*many).contents).cast::<sys::CLIPSValue>();
            (begin..begin.saturating_add(count))
                .map(|nth| self.value((*first.add(usize::try_from(nth).unwrap_or_default())).__bindgen_anon_1.header))
                .collect()
        }
    }

    /// The value in CLIPS; it lives until the next garbage collection, unless it is retained.
    pub(super) fn to_native(&self, value: &Value) -> sys::CLIPSValue {
        let raw = self.raw();
        // SAFETY: the environment is alive, and the functions copy the texts. A fact is one of
        // this environment, or another value takes its place.
        let header: *mut sys::TypeHeader = unsafe {
            match value {
                Value::Symbol(text) => sys::CreateSymbol(raw, c_text(text).as_ptr()).cast(),
                Value::Text(text) => sys::CreateString(raw, c_text(text).as_ptr()).cast(),
                Value::Instance(name) => sys::CreateInstanceName(raw, c_text(name).as_ptr()).cast(),
                Value::Integer(number) => sys::CreateInteger(raw, *number).cast(),
                Value::Float(number) => sys::CreateFloat(raw, *number).cast(),
                Value::Address(handle) => {
                    let contents = usize::try_from(*handle).unwrap_or_default() as *mut c_void;
                    sys::CreateExternalAddress(raw, contents, self.address_type()).cast()
                }
                Value::Fact(fact) => match fact.pointer(self.alive()) {
                    Some(fact) => fact.cast(),
                    None => sys::CreateSymbol(raw, c"FALSE".as_ptr()).cast(),
                },
                Value::Many(values) => {
                    let builder = sys::CreateMultifieldBuilder(raw, size(values.len()));
                    for value in values {
                        let mut value = self.to_native(value);
                        sys::MBAppend(builder, &raw mut value);
                    }
                    let many = sys::MBCreate(builder);
                    sys::MBDispose(builder);
                    many.cast()
                }
                Value::Void | Value::Foreign => (*raw.cast::<sys::environmentData>()).VoidConstant.cast(),
            }
        };
        let mut native = sys::CLIPSValue::default();
        native.__bindgen_anon_1.header = header;
        native
    }
}
