//! Pairs → tree. A walker takes the pair of its rule and returns its node.
//!
//! Recursion is as deep as the brackets, which the outline bounds. A walker
//! returns nothing where the pair is not what the grammar promises or where a
//! value cannot be had; what to say then is kept in [`Walk::flaw`].

use std::collections::HashSet;
use std::sync::Arc;

use pest::iterators::Pair;

use super::ast::{
    Assigner, Atom, Comparator, Condition, ConditionKind, Effect, EffectKind, Expression, Function, Init, Modal,
    Moment, Name, Operator, Place, Signature, Term, Type, Typed,
};
use super::grammar::{Rule, is_mark};
use super::seeded::Seeded;
use crate::formats::{Diagnostic, Source, Span};

/// Every spelling once, for all sections of a text.
#[derive(Default)]
pub(super) struct Words(HashSet<Arc<str>, Seeded>);

impl Words {
    pub(super) fn share(&mut self, word: &str) -> Arc<str> {
        if let Some(known) = self.0.get(word) {
            return known.clone();
        }
        let word: Arc<str> = word.into();
        self.0.insert(word.clone());
        word
    }
}

/// What walkers need: where the pairs' text begins, and the words seen so far.
pub(super) struct Walk<'a> {
    pub(super) source: &'a Source,
    pub(super) base: usize,
    pub(super) words: &'a mut Words,
    /// Why the last walker returned nothing.
    pub(super) flaw: Option<Diagnostic>,
}

/// The pairs inside, without marks.
pub(super) fn parts(pair: Pair<'_, Rule>) -> impl Iterator<Item = Pair<'_, Rule>> {
    pair.into_inner().filter(|part| !is_mark(part.as_rule()))
}

impl Walk<'_> {
    pub(super) fn span(&self, pair: &Pair<'_, Rule>) -> Span {
        let span = pair.as_span();
        Span::new(self.base + span.start(), self.base + span.end())
    }

    pub(super) fn place(&self, pair: &Pair<'_, Rule>) -> Place {
        Place(self.span(pair))
    }

    /// Keeps what to say, and returns nothing.
    pub(super) fn fail<T>(&mut self, span: Span, message: &str) -> Option<T> {
        self.flaw.get_or_insert_with(|| Diagnostic::new(self.source, span, message));
        None
    }

    pub(super) fn name(&mut self, pair: &Pair<'_, Rule>) -> Name {
        Name::new(self.words.share(pair.as_str()), self.span(pair))
    }

    pub(super) fn number(&mut self, pair: &Pair<'_, Rule>) -> Option<f64> {
        match pair.as_str().parse::<f64>() {
            Ok(number) if number.is_finite() => Some(number),
            _ => self.fail(self.span(pair), "expected a number that fits 64 bits"),
        }
    }

    fn kind(&mut self, of_type: Pair<'_, Rule>) -> Option<Type> {
        let alternatives = parts(parts(of_type).next()?).next()?;
        Some(match alternatives.as_rule() {
            Rule::either => parts(alternatives).map(|name| self.name(&name)).collect(),
            _ => [self.name(&alternatives)].into(),
        })
    }

    /// `names` and `variables`.
    pub(super) fn typed(&mut self, list: Pair<'_, Rule>) -> Option<Vec<Typed>> {
        let mut typed: Vec<Typed> = Vec::new();
        let mut untyped = 0;
        for part in parts(list) {
            if part.as_rule() == Rule::of_type {
                let span = self.span(&part);
                let kind = self.kind(part)?;
                let waiting = typed.get_mut(untyped..).unwrap_or_default();
                if waiting.is_empty() {
                    return self.fail(span, "expected a name before `-` and a type");
                }
                waiting.iter_mut().for_each(|typed| typed.kind = Some(kind.clone()));
                untyped = typed.len();
            } else {
                typed.push(Typed { name: self.name(&part), kind: None });
            }
        }
        Some(typed)
    }

    pub(super) fn signature(&mut self, pair: Pair<'_, Rule>) -> Option<Signature> {
        let mut parts = parts(pair);
        Some(Signature { name: self.name(&parts.next()?), parameters: self.typed(parts.next()?)? })
    }

    pub(super) fn functions(&mut self, section: Pair<'_, Rule>) -> Option<Vec<Function>> {
        let mut functions: Vec<Function> = Vec::new();
        let mut untyped = 0;
        for part in parts(section) {
            if part.as_rule() == Rule::of_type {
                let span = self.span(&part);
                let kind = self.kind(part)?;
                let waiting = functions.get_mut(untyped..).unwrap_or_default();
                if waiting.is_empty() {
                    return self.fail(span, "expected a function before `-` and a type");
                }
                waiting.iter_mut().for_each(|function| function.kind = Some(kind.clone()));
                untyped = functions.len();
            } else {
                functions.push(Function { signature: self.signature(part)?, kind: None });
            }
        }
        Some(functions)
    }

    pub(super) fn atom(&mut self, pair: Pair<'_, Rule>) -> Option<Atom> {
        let place = self.place(&pair);
        let mut parts = parts(pair);
        let name = self.name(&parts.next()?);
        let arguments = parts.map(|part| self.term(part)).collect::<Option<_>>()?;
        Some(Atom { name, arguments, place })
    }

    fn term(&mut self, pair: Pair<'_, Rule>) -> Option<Term> {
        Some(match pair.as_rule() {
            Rule::variable => Term::Variable(self.name(&pair)),
            Rule::name => Term::Name(self.name(&pair)),
            _ => Term::Call(Box::new(self.atom(pair)?)),
        })
    }

    pub(super) fn expression(&mut self, pair: Pair<'_, Rule>) -> Option<Expression> {
        let pair = pair.into_inner().next()?;
        let place = self.place(&pair);
        Some(match pair.as_rule() {
            Rule::number => Expression::Number(self.number(&pair)?, place),
            Rule::elapsed => Expression::Elapsed(place),
            Rule::operation => {
                let mut parts = parts(pair);
                let operator = Operator::from_word(parts.next()?.as_str())?;
                Expression::Operation(operator, parts.map(|part| self.expression(part)).collect::<Option<_>>()?, place)
            }
            _ => Expression::Term(self.term(pair)?),
        })
    }

    pub(super) fn condition(&mut self, pair: Pair<'_, Rule>) -> Option<Condition> {
        let pair = pair.into_inner().next()?;
        let place = self.place(&pair);
        Some(Condition { kind: self.condition_kind(pair)?, place })
    }

    fn condition_kind(&mut self, pair: Pair<'_, Rule>) -> Option<ConditionKind> {
        if pair.as_rule() == Rule::atom {
            return Some(ConditionKind::Atom(self.atom(pair)?));
        }
        let rule = pair.as_rule();
        let mut parts = parts(pair);
        Some(match rule {
            Rule::empty => ConditionKind::And(Vec::new()),
            Rule::conjunction => ConditionKind::And(self.conditions(parts)?),
            Rule::disjunction => ConditionKind::Or(self.conditions(parts)?),
            Rule::negation => ConditionKind::Not(self.boxed(parts.next()?)?),
            Rule::implication => ConditionKind::Imply(self.boxed(parts.next()?)?, self.boxed(parts.next()?)?),
            Rule::universal => ConditionKind::Forall(self.typed(parts.next()?)?, self.boxed(parts.next()?)?),
            Rule::existential => ConditionKind::Exists(self.typed(parts.next()?)?, self.boxed(parts.next()?)?),
            Rule::comparison => {
                let comparator = Comparator::from_word(parts.next()?.as_str())?;
                let left = self.expression(parts.next()?)?;
                ConditionKind::Comparison(comparator, Box::new(left), Box::new(self.expression(parts.next()?)?))
            }
            Rule::timed_condition => ConditionKind::Timed(moment(parts.next()?.as_rule())?, self.boxed(parts.next()?)?),
            Rule::preference => {
                let mut first = parts.next()?;
                let name = (first.as_rule() == Rule::name).then(|| self.name(&first));
                if name.is_some() {
                    first = parts.next()?;
                }
                ConditionKind::Preference(name, self.boxed(first)?)
            }
            Rule::modal => self.modal(parts)?,
            _ => return None,
        })
    }

    fn conditions<'i>(&mut self, parts: impl Iterator<Item = Pair<'i, Rule>>) -> Option<Vec<Condition>> {
        parts.map(|part| self.condition(part)).collect()
    }

    fn boxed(&mut self, pair: Pair<'_, Rule>) -> Option<Box<Condition>> {
        self.condition(pair).map(Box::new)
    }

    fn modal<'i>(&mut self, mut parts: impl Iterator<Item = Pair<'i, Rule>>) -> Option<ConditionKind> {
        let modal = Modal::from_word(parts.next()?.as_str())?;
        let (mut numbers, mut conditions) = (Vec::new(), Vec::new());
        for part in parts {
            if part.as_rule() == Rule::number {
                numbers.push(self.number(&part)?);
            } else {
                conditions.push(self.condition(part)?);
            }
        }
        Some(ConditionKind::Modal(modal, numbers, conditions))
    }

    pub(super) fn effect(&mut self, pair: Pair<'_, Rule>) -> Option<Effect> {
        let pair = pair.into_inner().next()?;
        let place = self.place(&pair);
        Some(Effect { kind: self.effect_kind(pair)?, place })
    }

    fn effect_kind(&mut self, pair: Pair<'_, Rule>) -> Option<EffectKind> {
        if pair.as_rule() == Rule::atom {
            return Some(EffectKind::Add(self.atom(pair)?));
        }
        let rule = pair.as_rule();
        let mut parts = parts(pair);
        Some(match rule {
            Rule::empty => EffectKind::And(Vec::new()),
            Rule::joint_effect => EffectKind::And(parts.map(|part| self.effect(part)).collect::<Option<_>>()?),
            Rule::universal_effect => {
                EffectKind::Forall(self.typed(parts.next()?)?, Box::new(self.effect(parts.next()?)?))
            }
            Rule::conditional_effect => {
                EffectKind::When(self.boxed(parts.next()?)?, Box::new(self.effect(parts.next()?)?))
            }
            Rule::deletion => EffectKind::Delete(self.atom(parts.next()?)?),
            Rule::timed_effect => {
                EffectKind::Timed(moment(parts.next()?.as_rule())?, Box::new(self.effect(parts.next()?)?))
            }
            Rule::assignment => {
                let assigner = Assigner::from_word(parts.next()?.as_str())?;
                EffectKind::Assign(assigner, self.term(parts.next()?)?, Box::new(self.expression(parts.next()?)?))
            }
            _ => return None,
        })
    }

    pub(super) fn init(&mut self, pair: Pair<'_, Rule>) -> Option<Init> {
        if pair.as_rule() == Rule::initial_atom {
            return Some(Init::Atom(self.atom(pair)?));
        }
        let rule = pair.as_rule();
        let mut parts = parts(pair);
        Some(match rule {
            Rule::initial_negation => Init::Not(self.atom(parts.next()?)?),
            Rule::initial_value => Init::Value(self.term(parts.next()?)?, self.expression(parts.next()?)?),
            Rule::timed_literal => {
                let time = self.number(&parts.next()?)?;
                match self.init(parts.next()?)? {
                    Init::Atom(atom) => Init::At(time, true, atom),
                    Init::Not(atom) => Init::At(time, false, atom),
                    _ => return None,
                }
            }
            _ => return None,
        })
    }
}

fn moment(rule: Rule) -> Option<Moment> {
    match rule {
        Rule::at_start => Some(Moment::Start),
        Rule::at_end => Some(Moment::End),
        Rule::over_all => Some(Moment::All),
        _ => None,
    }
}
