//! `deftemplate`: what slots facts have, and what they may hold.

use super::expression::evaluate;
use super::lexer::{Lexer, Token, TokenKind};
use super::value::Value;
use super::writer::write_value;
use crate::formats::{Diagnostic, Span};

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
    /// What follows from its constraints: `?DERIVE`, or nothing said.
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

    fn parse(word: &str) -> Option<Self> {
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
    fn restricted(facet: &str) -> Option<Self> {
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
    fn new(name: &str, multiple: bool) -> Self {
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
            return Err(format!("the slot `{}` expected {wanted}, found {found} `{}`", self.name, text(value)));
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

/// Reads a template behind the word `deftemplate`, with its `)`.
pub(super) fn read(lexer: &mut Lexer<'_>) -> Result<Template, Diagnostic> {
    let name = symbol(lexer, "the name of a template")?;
    let name = lexer.text(name);
    let mut template = Template { name: local(name).to_owned(), documentation: None, slots: Vec::new() };
    if lexer.peek(0)?.kind == TokenKind::Text {
        let token = lexer.next()?;
        if let Value::Text(text) = lexer.value(token)? {
            template.documentation = Some(text);
        }
    }
    loop {
        let token = lexer.next()?;
        match token.kind {
            TokenKind::Close => return Ok(template),
            TokenKind::Open => {
                let start = token.span;
                let (slot, end) = slot(lexer)?;
                if template.slot(&slot.name).is_some() {
                    let message = format!("the slot `{}` is declared twice", slot.name);
                    return Err(Diagnostic::new(lexer.source, start.to(end), message));
                }
                template.slots.push(slot);
            }
            _ => return Err(lexer.wrong(token, "`(slot …)`, `(multislot …)` or `)`")),
        }
    }
}

/// The name of a construct without its module.
pub(super) fn local(name: &str) -> &str {
    name.rsplit_once("::").map_or(name, |(_, name)| name)
}

fn symbol(lexer: &mut Lexer<'_>, expected: &str) -> Result<Token, Diagnostic> {
    let token = lexer.next()?;
    if token.kind == TokenKind::Symbol { Ok(token) } else { Err(lexer.wrong(token, expected)) }
}

fn slot(lexer: &mut Lexer<'_>) -> Result<(Slot, Span), Diagnostic> {
    let keyword = lexer.next()?;
    let multiple = match (keyword.kind, lexer.text(keyword)) {
        (TokenKind::Symbol, "slot" | "field") => false,
        (TokenKind::Symbol, "multislot" | "multifield") => true,
        _ => return Err(lexer.wrong(keyword, "`slot` or `multislot`")),
    };
    let name = symbol(lexer, "the name of a slot")?;
    let mut slot = Slot::new(lexer.text(name), multiple);
    loop {
        let token = lexer.next()?;
        match token.kind {
            TokenKind::Close => {
                consistent(&slot).map_err(|message| Diagnostic::new(lexer.source, name.span, message))?;
                return Ok((slot, token.span));
            }
            TokenKind::Open => facet(lexer, &mut slot)?,
            _ => return Err(lexer.wrong(token, "an attribute like `(type SYMBOL)`, or `)`")),
        }
    }
}

/// Whether the default is one that the slot takes.
fn consistent(slot: &Slot) -> Result<(), String> {
    match &slot.default {
        Default::Values(values) => slot.check(values).map_err(|message| format!("{message} as its default")),
        _ => Ok(()),
    }
}

fn facet(lexer: &mut Lexer<'_>, slot: &mut Slot) -> Result<(), Diagnostic> {
    let keyword = symbol(lexer, "an attribute like `type` or `default`")?;
    let name = lexer.text(keyword);
    if let Some(types) = Types::restricted(name) {
        if anything(lexer)? {
            return close(lexer);
        }
        slot.allowed.push((types, constants(lexer)?));
        return Ok(());
    }
    match name {
        "type" => {
            if anything(lexer)? {
                return close(lexer);
            }
            let mut types: Option<Types> = None;
            while lexer.peek(0)?.kind != TokenKind::Close {
                let token = lexer.next()?;
                let one = Types::parse(lexer.text(token)).filter(|_| token.kind == TokenKind::Symbol);
                let one = one.ok_or_else(|| lexer.wrong(token, "a type like SYMBOL, STRING, INTEGER or FLOAT"))?;
                types = Some(types.map_or(one, |types| types.and(one)));
            }
            let end = lexer.next()?;
            slot.types = types.ok_or_else(|| lexer.wrong(end, "a type"))?;
            Ok(())
        }
        "range" => {
            let least = bound(lexer)?;
            slot.range = (least, bound(lexer)?);
            close(lexer)
        }
        "cardinality" => {
            let (least, most) = (count(lexer)?, count(lexer)?);
            slot.cardinality = (least.unwrap_or(0), most);
            close(lexer)
        }
        "default" | "default-dynamic" => default(lexer, slot),
        // Addresses of instances, which no text can say.
        "allowed-classes" => constants(lexer).map(drop),
        _ => {
            Err(lexer.wrong(keyword, "an attribute like `type`, `default`, `range`, `cardinality` or `allowed-values`"))
        }
    }
}

/// Takes `?VARIABLE`.
fn anything(lexer: &mut Lexer<'_>) -> Result<bool, Diagnostic> {
    let token = lexer.peek(0)?;
    let found = token.kind == TokenKind::Variable && lexer.text(token) == "?VARIABLE";
    if found {
        lexer.next()?;
    }
    Ok(found)
}

fn close(lexer: &mut Lexer<'_>) -> Result<(), Diagnostic> {
    let token = lexer.next()?;
    if token.kind == TokenKind::Close { Ok(()) } else { Err(lexer.wrong(token, "`)`")) }
}

fn constants(lexer: &mut Lexer<'_>) -> Result<Vec<Value>, Diagnostic> {
    let mut values = Vec::new();
    loop {
        let token = lexer.next()?;
        if token.kind == TokenKind::Close {
            return Ok(values);
        }
        values.push(lexer.value(token)?);
    }
}

fn bound(lexer: &mut Lexer<'_>) -> Result<Option<Value>, Diagnostic> {
    if anything(lexer)? {
        return Ok(None);
    }
    let token = lexer.next()?;
    match token.kind {
        TokenKind::Integer | TokenKind::Float => lexer.value(token).map(Some),
        _ => Err(lexer.wrong(token, "a number or ?VARIABLE")),
    }
}

fn count(lexer: &mut Lexer<'_>) -> Result<Option<usize>, Diagnostic> {
    let token = lexer.peek(0)?;
    match bound(lexer)? {
        None => Ok(None),
        Some(Value::Integer(number)) if number >= 0 => Ok(usize::try_from(number).ok()),
        Some(_) => Err(lexer.wrong(token, "a number of values or ?VARIABLE")),
    }
}

fn default(lexer: &mut Lexer<'_>, slot: &mut Slot) -> Result<(), Diagnostic> {
    let token = lexer.peek(0)?;
    if token.kind == TokenKind::Variable {
        slot.default = match lexer.text(token) {
            "?DERIVE" => Default::Derive,
            "?NONE" => Default::None,
            // A global variable, say.
            _ => Default::Unknown,
        };
        lexer.next()?;
        return close(lexer);
    }
    let mut values = Some(Vec::new());
    loop {
        let token = lexer.peek(0)?;
        let more = match token.kind {
            TokenKind::Close => break,
            TokenKind::Open => evaluate(lexer)?.ok(),
            TokenKind::Variable => lexer.next().map(|_| None)?,
            _ => {
                let token = lexer.next()?;
                Some(vec![lexer.value(token)?])
            }
        };
        values = values.zip(more).map(|(mut values, more)| {
            values.extend(more);
            values
        });
    }
    slot.default = values.map_or(Default::Unknown, Default::Values);
    close(lexer)
}
