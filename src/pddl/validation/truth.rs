//! Whether a condition holds, and which part of it does not.

use super::error::EvaluationError;
use super::state::{Bindings, State, TOLERANCE, UNBOUND, choose_next, value};
use crate::formats::pddl::ast::{Comparator, Moment, Operator};
use crate::pddl::model::{Formula, Number, Quantifier};

impl State<'_> {
    /// Whether `formula` holds with these values of its variables. Preferences always do.
    pub(in crate::pddl) fn is_true(&self, formula: &Formula, bindings: &mut Bindings) -> Result<bool, EvaluationError> {
        match formula {
            Formula::Fact(fact) => self.holds(&self.ground(fact.predicate, &fact.arguments, bindings)?),
            Formula::Same(left, right) => Ok(value(*left, bindings)? == value(*right, bindings)?),
            Formula::Compare(comparator, left, right) => {
                let (left, right) = (self.number(left, bindings)?, self.number(right, bindings)?);
                Ok(compare(*comparator, left, right, self.tolerance))
            }
            Formula::Not(inner) => Ok(!self.is_true(inner, bindings)?),
            Formula::And(parts) => {
                for part in parts {
                    if !self.is_true(part, bindings)? {
                        return Ok(false);
                    }
                }
                Ok(true)
            }
            Formula::Or(parts) => {
                for part in parts {
                    if self.is_true(part, bindings)? {
                        return Ok(true);
                    }
                }
                Ok(false)
            }
            Formula::Imply(left, right) => Ok(!self.is_true(left, bindings)? || self.is_true(right, bindings)?),
            Formula::Forall(quantifier, inner) => {
                Ok(!self.each(quantifier, bindings, |bindings| Ok(!self.is_true(inner, bindings)?))?)
            }
            Formula::Exists(quantifier, inner) => {
                self.each(quantifier, bindings, |bindings| self.is_true(inner, bindings))
            }
            Formula::Timed(_, inner) => self.is_true(inner, bindings),
            Formula::Preference(..) => Ok(true),
            Formula::Modal(modal, ..) => {
                let reason = format!("`{modal}` stands where only a condition of one state can be checked");
                Err(EvaluationError::Unchecked(reason))
            }
        }
    }

    /// Calls `visit` with every choice of values for the variables until it returns true, and says whether it did.
    pub(in crate::pddl) fn each(
        &self,
        quantifier: &Quantifier,
        bindings: &mut Bindings,
        mut visit: impl FnMut(&mut Bindings) -> Result<bool, EvaluationError>,
    ) -> Result<bool, EvaluationError> {
        let first = quantifier.first as usize;
        let count = quantifier.variables.len();
        let members: Vec<_> = quantifier.variables.iter().map(|variable| self.members(&variable.kind)).collect();
        if members.iter().any(|members| members.is_empty()) {
            return Ok(false);
        }
        if bindings.len() < first + count {
            bindings.resize(first + count, UNBOUND);
        }
        let outer: Vec<u32> = bindings[first..first + count].to_vec();
        let mut chosen = vec![0_usize; count];
        let stopped = loop {
            for (offset, members) in members.iter().enumerate() {
                bindings[first + offset] = members[chosen[offset]];
            }
            if visit(bindings)? {
                break true;
            }
            if !choose_next(&mut chosen, &members) {
                break false;
            }
        };
        bindings[first..first + count].copy_from_slice(&outer);
        Ok(stopped)
    }

    /// The value of an expression.
    pub(in crate::pddl) fn number(&self, number: &Number, bindings: &Bindings) -> Result<f64, EvaluationError> {
        match number {
            Number::Constant(value) => Ok(*value),
            Number::Fluent(fluent) => {
                let ground = self.ground(fluent.function, &fluent.arguments, bindings)?;
                match self.values.get(&ground) {
                    Some(value) => Ok(*value),
                    None => Err(EvaluationError::Wrong(format!("{} has no value", self.ground_function_text(&ground)))),
                }
            }
            Number::Operation(operator, operands) => self.operation(*operator, operands, bindings),
            Number::Duration => self.duration.ok_or_else(|| {
                EvaluationError::Unchecked("`?duration` means nothing outside a durative action".to_owned())
            }),
            Number::TotalTime => Ok(self.time),
            Number::Elapsed => Err(EvaluationError::Unchecked("continuous effects are not simulated".to_owned())),
            Number::Violations(name) => match &self.violations {
                Some(violations) => Ok(violations.count(name)),
                None => Err(EvaluationError::Unchecked("preferences are not counted".to_owned())),
            },
        }
    }

    fn operation(&self, operator: Operator, operands: &[Number], bindings: &Bindings) -> Result<f64, EvaluationError> {
        let mut values = Vec::with_capacity(operands.len());
        for operand in operands {
            values.push(self.number(operand, bindings)?);
        }
        Ok(match (operator, values.as_slice()) {
            (Operator::Add, all) => all.iter().sum(),
            (Operator::Multiply, all) => all.iter().product(),
            (Operator::Subtract, [only]) => -only,
            (Operator::Subtract, [left, right]) => left - right,
            (Operator::Divide, [_, 0.0]) => return Err(EvaluationError::Wrong("a division by zero".to_owned())),
            (Operator::Divide, [left, right]) => left / right,
            _ => return Err(EvaluationError::Unchecked(format!("`{operator}` with {} operands", values.len()))),
        })
    }

    /// The smallest part of a false condition that makes it false, and the values of its variables.
    pub(super) fn faulty<'f>(
        &self,
        formula: &'f Formula,
        bindings: &mut Bindings,
    ) -> Result<(&'f Formula, Bindings), EvaluationError> {
        match formula {
            Formula::And(parts) => {
                for part in parts {
                    if !self.is_true(part, bindings)? {
                        return self.faulty(part, bindings);
                    }
                }
            }
            Formula::Forall(quantifier, inner) => {
                let mut fault = None;
                self.each(quantifier, bindings, |bindings| {
                    if !self.is_true(inner, bindings)? {
                        fault = Some(self.faulty(inner, bindings)?);
                    }
                    Ok(fault.is_some())
                })?;
                if let Some(fault) = fault {
                    return Ok(fault);
                }
            }
            Formula::Timed(_, inner) => return self.faulty(inner, bindings),
            _ => {}
        }
        Ok((formula, bindings.clone()))
    }

    /// What is false of every false part of a conjunction.
    pub(super) fn all_faulty<'f>(
        &self,
        formula: &'f Formula,
        limit: usize,
    ) -> Result<Vec<(&'f Formula, Bindings)>, EvaluationError> {
        let mut faults = Vec::new();
        let mut pending = vec![formula];
        while let Some(formula) = pending.pop() {
            if faults.len() >= limit {
                break;
            }
            match formula {
                Formula::And(parts) => pending.extend(parts.iter().rev()),
                other => {
                    if !self.is_true(other, &mut Bindings::new())? {
                        faults.push(self.faulty(other, &mut Bindings::new())?);
                    }
                }
            }
        }
        Ok(faults)
    }
}

/// Whether two numbers compare so. Of `<`, `=` and `>` always one holds; `<=` and `>=` are the negations of `>` and
/// `<`. A greater tolerance than that of numbers, as durations have it, forgives and makes nothing stricter.
fn compare(comparator: Comparator, left: f64, right: f64, tolerance: f64) -> bool {
    let strict = tolerance.min(TOLERANCE);
    match comparator {
        Comparator::Equal => left >= right - tolerance && left <= right + tolerance,
        Comparator::Less => left < right - strict,
        Comparator::AtMost => left <= right + tolerance,
        Comparator::Greater => left > right + strict,
        Comparator::AtLeast => left >= right - tolerance,
    }
}

/// The part of a condition that is about one moment of a durative action; what names no moment is about its start.
pub(super) fn at_moment(formula: &Formula, moment: Moment) -> Formula {
    match formula {
        Formula::Timed(other, inner) if *other == moment => (**inner).clone(),
        Formula::Timed(..) => Formula::truth(),
        Formula::And(parts) => Formula::And(parts.iter().map(|part| at_moment(part, moment)).collect()),
        Formula::Forall(quantifier, inner) => Formula::Forall(quantifier.clone(), Box::new(at_moment(inner, moment))),
        Formula::Preference(..) => Formula::truth(),
        other if moment == Moment::Start => other.clone(),
        _ => Formula::truth(),
    }
}
