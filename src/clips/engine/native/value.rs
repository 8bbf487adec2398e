//! Values of CLIPS as values of Rust.

use std::ffi::{CStr, CString, c_char, c_void};

use clips_sys as sys;

use super::environment::Environment;
use super::fact::FactRef;

/// A value that an expression can have.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    /// `green`
    Symbol(String),
    /// `"a text"`
    Text(String),
    /// `3`
    Integer(i64),
    /// `3.0`
    Float(f64),
    /// `[name]`
    Instance(String),
    /// An external address that rmem gave out.
    Address(u64),
    /// A fact.
    Fact(FactRef),
    /// A multifield.
    Many(Vec<Value>),
    /// Nothing.
    Void,
    /// What rmem has no use for: addresses of instances and of others.
    Foreign,
}

impl Value {
    /// TRUE or FALSE.
    pub(crate) fn truth(is: bool) -> Self {
        Self::Symbol(if is { "TRUE" } else { "FALSE" }.to_owned())
    }

    /// What kind it is, as CLIPS says it.
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Symbol(_) => "symbol",
            Self::Text(_) => "string",
            Self::Integer(_) => "integer",
            Self::Float(_) => "float",
            Self::Instance(_) => "instance name",
            Self::Address(_) | Self::Foreign => "address",
            Self::Fact(_) => "fact address",
            Self::Many(_) => "multifield",
            Self::Void => "nothing",
        }
    }
}

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
                sys::FACT_ADDRESS_TYPE => Value::Fact(FactRef::new(header.cast(), self)),
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

    /// The value in CLIPS; it lives until the next garbage collection that nobody keeps it from.
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
                Value::Fact(fact) => match fact.pointer(self) {
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
