//! What a rendering compared whose types differ, and what is told of it.

use std::collections::BTreeMap;
use std::sync::Mutex;

use minijinja::value::Value;

use super::direct::lock;
use crate::formats::{Diagnostic, Span, Texts};

/// One side of a comparison, as it is written.
#[derive(Debug)]
pub(super) struct Side {
    pub(super) span: Span,
    pub(super) text: String,
}

/// What was compared.
#[derive(Debug, Default)]
pub(super) struct Compared {
    /// The two sides, by the number of the comparison.
    pub(super) sides: BTreeMap<usize, (Side, Side)>,
    /// Left sides whose right sides are not known yet, with the numbers of their comparisons.
    pub(super) open: Mutex<Vec<(usize, Value)>>,
    /// The first pair of each comparison whose types keep it from being equal.
    pub(super) mixed: Mutex<BTreeMap<usize, Mixed>>,
    /// The texts that are parameters and read as numbers, by name.
    pub(super) given: Vec<(String, String)>,
    /// The comparison that ended the rendering.
    pub(super) refused: Mutex<Option<Span>>,
}

/// A pair that would be equal if the types were.
#[derive(Debug)]
pub(super) struct Mixed {
    pub(super) message: String,
    pub(super) remedy: Remedy,
}

/// The filter that makes two values comparable, and for which of them it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Remedy {
    pub(super) is_left: bool,
    pub(super) filter: &'static str,
}

impl Compared {
    pub(super) fn new(sides: BTreeMap<usize, (Side, Side)>) -> Self {
        Self { sides, ..Self::default() }
    }

    /// Whether any values were unequal only by their types.
    pub(super) fn is_mixed(&self) -> bool {
        !lock(&self.mixed).is_empty()
    }

    /// The comparison that ended the rendering.
    pub(super) fn refused(&self) -> Option<Span> {
        *lock(&self.refused)
    }

    /// What to write instead, or how to give a parameter.
    pub(super) fn hint(&self, remedy: Remedy, sides: Option<&(Side, Side)>) -> String {
        let hint = remedy.hint(sides);
        let written = sides.map(|(left, right)| if remedy.is_left { &left.text } else { &right.text });
        let given = written.and_then(|written| self.given.iter().find(|(name, _)| name == written));
        match given.filter(|_| ["int", "float"].contains(&remedy.filter)) {
            Some((name, text)) => format!("{hint}, or give it as a number: -D {name}:={text}"),
            None => hint,
        }
    }

    /// What to tell of the comparisons of values that were unequal only by their types.
    pub(super) fn remarks(&self, template: &Texts) -> Vec<Diagnostic> {
        let mixed = lock(&self.mixed);
        let remark = |(site, mixed): (&usize, &Mixed)| {
            let sides = self.sides.get(site)?;
            Some(template.complain(whole(sides), mixed.message.as_str()).hint(self.hint(mixed.remedy, Some(sides))))
        };
        mixed.iter().filter_map(remark).collect()
    }
}

/// The place of a comparison.
pub(super) fn whole((left, right): &(Side, Side)) -> Span {
    Span::new(left.span.start, right.span.end)
}

impl Remedy {
    /// What to write instead.
    pub(super) fn hint(self, sides: Option<&(Side, Side)>) -> String {
        let Self { is_left, filter } = self;
        let Some((left, right)) = sides else { return format!("convert one of them, for example with `|{filter}`") };
        let written = if is_left { &left.text } else { &right.text };
        let number = written.trim_matches(['"', '\'']);
        match filter {
            "int" | "float" if number.len() < written.len() && !number.contains(['"', '\'']) => {
                format!("write {} without quotes", number.trim())
            }
            "string" if written.parse::<f64>().is_ok() => format!("write \"{written}\""),
            _ if written.contains(|c: char| c.is_whitespace() || "+-*/~%".contains(c)) => {
                format!("write ({written})|{filter}")
            }
            _ => format!("write {written}|{filter}"),
        }
    }
}
