//! Reads `deftemplate`.

use super::expression::evaluate;
use super::global::Globals;
use super::lexer::{Lexer, Token, TokenKind};
use super::template::{Default, Slot, Template, Types};
use super::value::Value;
use crate::formats::{Diagnostic, Span};

/// Reads a template behind the word `deftemplate`, with its `)`.
pub(super) fn read(lexer: &mut Lexer<'_>, globals: &Globals) -> Result<Template, Diagnostic> {
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
                let (slot, end) = slot(lexer, globals)?;
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

fn slot(lexer: &mut Lexer<'_>, globals: &Globals) -> Result<(Slot, Span), Diagnostic> {
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
            TokenKind::Open => facet(lexer, globals, &mut slot)?,
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

fn facet(lexer: &mut Lexer<'_>, globals: &Globals, slot: &mut Slot) -> Result<(), Diagnostic> {
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
        "default" | "default-dynamic" => default(lexer, globals, slot),
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

fn default(lexer: &mut Lexer<'_>, globals: &Globals, slot: &mut Slot) -> Result<(), Diagnostic> {
    let token = lexer.peek(0)?;
    let special = match lexer.text(token) {
        "?DERIVE" => Some(Default::Derive),
        "?NONE" => Some(Default::None),
        _ => None,
    };
    if let Some(special) = special.filter(|_| token.kind == TokenKind::Variable) {
        slot.default = special;
        lexer.next()?;
        return close(lexer);
    }
    let mut values = Some(Vec::new());
    loop {
        let token = lexer.peek(0)?;
        let more = match token.kind {
            TokenKind::Close => break,
            TokenKind::Open => evaluate(lexer, globals)?.ok(),
            TokenKind::Variable => {
                let token = lexer.next()?;
                globals.values(lexer, token).ok()
            }
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
