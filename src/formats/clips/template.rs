//! Templates: what slots facts have, and what they may hold.

use super::value::Value;
use super::writer::write_value;

/// A template.
#[derive(Debug, Clone, PartialEq)]
pub struct Template {
    /// Its name, without a module.
    pub name: String,
    /// Its documentation.
    pub documentation: Option<String>,
    /// Its slots, in order.
    pub slots: Vec<Slot>,
}

/// A slot of a template with its constraints.
#[derive(Debug, Clone, PartialEq)]
pub struct Slot {
    /// Its name.
    pub name: String,
    /// Whether it holds any number of values.
    pub multiple: bool,
    /// What values it takes.
    pub types: Types,
    /// What it holds where a fact does not say.
    pub default: Default,
    /// The values that are allowed of these types; others are not restricted.
    pub allowed: Vec<(Types, Vec<Value>)>,
    /// The least and the greatest number.
    pub range: (Option<Value>, Option<Value>),
    /// How many values a multislot takes, at least and at most.
    pub cardinality: (usize, Option<usize>),
}

/// What a slot holds where a fact does not say.
#[derive(Debug, Clone, PartialEq)]
pub enum Default {
    /// What follows from its constraints: `?DERIVE`, which is the default.
    Derive,
    /// A fact has to say: `?NONE`.
    None,
    /// These values.
    Values(Vec<Value>),
    /// What only a running CLIPS knows.
    Unknown,
}

/// A set of types.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Types(u8);

impl Types {
    /// `SYMBOL`
    pub const SYMBOL: Self = Self(1);
    /// `STRING`
    pub const STRING: Self = Self(2);
    /// `INTEGER`
    pub const INTEGER: Self = Self(4);
    /// `FLOAT`
    pub const FLOAT: Self = Self(8);
    /// `INSTANCE-NAME`
    pub const INSTANCE: Self = Self(16);
    /// Addresses, which no text can say.
    const ADDRESS: Self = Self(32);
    /// `?VARIABLE`: anything.
    pub const ANY: Self = Self(63);

    /// In the order in which a default is derived.
    const NAMES: [(Self, &'static str); 6] = [
        (Self::SYMBOL, "SYMBOL"),
        (Self::STRING, "STRING"),
        (Self::INTEGER, "INTEGER"),
        (Self::FLOAT, "FLOAT"),
        (Self::INSTANCE, "INSTANCE-NAME"),
        (Self::ADDRESS, "an address"),
    ];

    /// The type of a value.
    #[must_use]
    pub const fn of(value: &Value) -> Self {
        match value {
            Value::Symbol(_) => Self::SYMBOL,
            Value::Text(_) => Self::STRING,
            Value::Integer(_) => Self::INTEGER,
            Value::Float(_) => Self::FLOAT,
            Value::Instance(_) => Self::INSTANCE,
        }
    }

    /// Both.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether the other types are among these.
    #[must_use]
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The names, for messages.
    #[must_use]
    pub fn names(self) -> String {
        let names = Self::NAMES.iter().filter(|(one, _)| self.has(*one)).map(|(_, name)| *name);
        names.collect::<Vec<_>>().join(" or ")
    }

    pub(super) fn parse(word: &str) -> Option<Self> {
        Some(match word {
            "SYMBOL" => Self::SYMBOL,
            "STRING" => Self::STRING,
            "LEXEME" => Self::SYMBOL.and(Self::STRING),
            "INTEGER" => Self::INTEGER,
            "FLOAT" => Self::FLOAT,
            "NUMBER" => Self::INTEGER.and(Self::FLOAT),
            "INSTANCE-NAME" => Self::INSTANCE,
            "INSTANCE" => Self::INSTANCE.and(Self::ADDRESS),
            "INSTANCE-ADDRESS" | "EXTERNAL-ADDRESS" | "FACT-ADDRESS" => Self::ADDRESS,
            _ => return None,
        })
    }

    /// What `allowed-…` restricts.
    pub(super) fn restricted(facet: &str) -> Option<Self> {
        Some(match facet {
            "allowed-values" => Self::ANY,
            "allowed-symbols" => Self::SYMBOL,
            "allowed-strings" => Self::STRING,
            "allowed-lexemes" => Self::SYMBOL.and(Self::STRING),
            "allowed-integers" => Self::INTEGER,
            "allowed-floats" => Self::FLOAT,
            "allowed-numbers" => Self::INTEGER.and(Self::FLOAT),
            "allowed-instance-names" | "allowed-instances" => Self::INSTANCE,
            _ => return None,
        })
    }
}

impl Template {
    /// The slot of this name.
    #[must_use]
    pub fn slot(&self, name: &str) -> Option<&Slot> {
        self.slots.iter().find(|slot| slot.name == name)
    }
}

impl Slot {
    pub(super) fn new(name: &str, multiple: bool) -> Self {
        Self {
            name: name.to_owned(),
            multiple,
            types: Types::ANY,
            default: Default::Derive,
            allowed: Vec::new(),
            range: (None, None),
            cardinality: (0, None),
        }
    }

    /// Whether the slot takes these values.
    ///
    /// # Errors
    /// What it expected, as a fragment.
    pub fn check(&self, values: &[Value]) -> Result<(), String> {
        let name = &self.name;
        if !self.multiple && values.len() != 1 {
            return Err(format!("the slot `{name}` expected one value, found {}", values.len()));
        }
        let (least, most) = self.cardinality;
        if self.multiple && (values.len() < least || most.is_some_and(|most| values.len() > most)) {
            let most = most.map_or("any number of".to_owned(), |most| most.to_string());
            return Err(format!("the slot `{name}` expected {least} to {most} values, found {}", values.len()));
        }
        values.iter().try_for_each(|value| self.check_value(value))
    }

    fn check_value(&self, value: &Value) -> Result<(), String> {
        let kind = Types::of(value);
        if !self.types.has(kind) {
            let (wanted, found) = (self.types.names(), kind.names());
            let instead = match value {
                Value::Integer(number) if self.types.has(Types::FLOAT) => format!("; write {number}.0"),
                _ => String::new(),
            };
            return Err(format!(
                "the slot `{}` expected {wanted}, found {found} `{}`{instead}",
                self.name,
                text(value)
            ));
        }
        let restricted = |(types, _): &&(Types, Vec<Value>)| types.has(kind);
        if let Some((_, allowed)) = self.allowed.iter().filter(restricted).find(|(_, allowed)| !allowed.contains(value))
        {
            let allowed = allowed.iter().map(text).collect::<Vec<_>>().join(", ");
            return Err(format!("the slot `{}` expected one of {allowed}, found `{}`", self.name, text(value)));
        }
        let (least, greatest) = &self.range;
        let outside = least.as_ref().is_some_and(|least| less(value, least))
            || greatest.as_ref().is_some_and(|greatest| less(greatest, value));
        if outside {
            let end = |end: &Option<Value>| end.as_ref().map_or_else(|| "?VARIABLE".to_owned(), text);
            let (least, greatest) = (end(least), end(greatest));
            let name = &self.name;
            return Err(format!(
                "the slot `{name}` expected a number from {least} to {greatest}, found `{}`",
                text(value)
            ));
        }
        Ok(())
    }

    /// What the slot holds in a fact that does not say; nothing where a fact has
    /// to say, or only a running CLIPS knows.
    #[must_use]
    pub fn fill(&self) -> Option<Vec<Value>> {
        match &self.default {
            Default::Values(values) => Some(values.clone()),
            Default::None | Default::Unknown => None,
            Default::Derive if self.multiple => Some(vec![self.derived(); self.cardinality.0]),
            Default::Derive => Some(vec![self.derived()]),
        }
    }

    fn derived(&self) -> Value {
        let kinds = Types::NAMES.iter().map(|(kind, _)| *kind);
        let kind = kinds.into_iter().find(|kind| self.types.has(*kind)).unwrap_or(Types::SYMBOL);
        let first = |(types, allowed): &(Types, Vec<Value>)| match types.has(kind) {
            true => allowed.iter().find(|value| self.types.has(Types::of(value))).cloned(),
            false => None,
        };
        if let Some(value) = self.allowed.iter().find_map(first) {
            return value;
        }
        let end = self.range.0.clone().or_else(|| self.range.1.clone());
        match kind {
            Types::STRING => Value::Text(String::new()),
            Types::INTEGER => end.filter(|end| matches!(end, Value::Integer(_))).unwrap_or(Value::Integer(0)),
            Types::FLOAT => match end {
                Some(Value::Float(number)) => Value::Float(number),
                #[allow(clippy::cast_precision_loss, reason = "as CLIPS does it")]
                Some(Value::Integer(number)) => Value::Float(number as f64),
                _ => Value::Float(0.0),
            },
            Types::INSTANCE => Value::Instance("nil".to_owned()),
            _ => Value::Symbol("nil".to_owned()),
        }
    }
}

fn text(value: &Value) -> String {
    let mut out = String::new();
    write_value(value, &mut out);
    out
}

/// Whether both are numbers and the first is less.
#[allow(clippy::cast_precision_loss, reason = "as CLIPS compares them")]
fn less(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Integer(a), Value::Integer(b)) => a < b,
        (Value::Integer(a), Value::Float(b)) => (*a as f64) < *b,
        (Value::Float(a), Value::Integer(b)) => *a < *b as f64,
        (Value::Float(a), Value::Float(b)) => a < b,
        _ => false,
    }
}
