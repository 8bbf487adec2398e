//! Resolved conditions as PDDL text again, with objects for variables.

use super::state::{Bindings, State, UNBOUND};
use crate::pddl::model::{Arg, Formula, Number, Quantifier, Variable};
use crate::pddl::table::{Named, Table};

/// Variables of the quantifiers around, by slot, which keep their names.
type Names = Vec<(u32, String)>;

impl State<'_> {
    /// A condition with the objects of these values.
    pub(super) fn text(&self, formula: &Formula, bindings: &Bindings) -> String {
        self.formula_text(formula, bindings, &mut Names::new())
    }

    /// As [`Self::text`]; variables without a value keep their names.
    pub(in crate::pddl) fn open_text(&self, formula: &Formula, bindings: &Bindings, variables: &[Variable]) -> String {
        let is_open = |slot: &u32| bindings.get(*slot as usize).is_none_or(|value| *value == UNBOUND);
        let names = (0_u32..).zip(variables).filter(|(slot, _)| is_open(slot));
        let mut names: Names = names.map(|(slot, variable)| (slot, variable.name.as_str().to_owned())).collect();
        self.formula_text(formula, bindings, &mut names)
    }

    fn formula_text(&self, formula: &Formula, bindings: &Bindings, names: &mut Names) -> String {
        let list = |word: &str, parts: &[Formula], names: &mut Names| {
            let mut text = format!("({word}");
            for part in parts {
                text.push(' ');
                text.push_str(&self.formula_text(part, bindings, names));
            }
            text.push(')');
            text
        };
        match formula {
            Formula::Fact(fact) => {
                let name = name_of(&self.domain.vocabulary.predicates, fact.predicate);
                self.call_text(name, &fact.arguments, bindings, names)
            }
            Formula::Same(left, right) => self.call_text("=", &[*left, *right], bindings, names),
            Formula::Compare(comparator, left, right) => {
                let (left, right) = (self.number_text(left, bindings, names), self.number_text(right, bindings, names));
                format!("({comparator} {left} {right})")
            }
            Formula::Not(inner) => format!("(not {})", self.formula_text(inner, bindings, names)),
            Formula::And(parts) => list("and", parts, names),
            Formula::Or(parts) => list("or", parts, names),
            Formula::Imply(left, right) => {
                let left = self.formula_text(left, bindings, names);
                format!("(imply {left} {})", self.formula_text(right, bindings, names))
            }
            Formula::Forall(quantifier, inner) => self.quantified_text("forall", quantifier, inner, bindings, names),
            Formula::Exists(quantifier, inner) => self.quantified_text("exists", quantifier, inner, bindings, names),
            Formula::Timed(moment, inner) => format!("({moment} {})", self.formula_text(inner, bindings, names)),
            Formula::Preference(name, inner) => {
                let name = name.as_ref().map_or_else(String::new, |name| format!("{name} "));
                format!("(preference {name}{})", self.formula_text(inner, bindings, names))
            }
            Formula::Modal(modal, numbers, parts) => {
                let numbers: String = numbers.iter().map(|number| format!(" {number}")).collect();
                list(&format!("{modal}{numbers}"), parts, names)
            }
        }
    }

    fn quantified_text(
        &self,
        word: &str,
        quantifier: &Quantifier,
        inner: &Formula,
        bindings: &Bindings,
        names: &mut Names,
    ) -> String {
        let outer = names.len();
        let mut list = Vec::new();
        for (slot, variable) in (quantifier.first..).zip(&quantifier.variables) {
            names.push((slot, variable.name.as_str().to_owned()));
            list.push(format!("{} - {}", variable.name, self.domain.vocabulary.types.kind_text(&variable.kind)));
        }
        let inner = self.formula_text(inner, bindings, names);
        names.truncate(outer);
        format!("({word} ({}) {inner})", list.join(" "))
    }

    fn call_text(&self, name: &str, arguments: &[Arg], bindings: &Bindings, names: &Names) -> String {
        let mut text = format!("({name}");
        for argument in arguments {
            text.push(' ');
            match argument {
                Arg::Object(number) => text.push_str(self.object_name(*number)),
                Arg::Fluent => text.push('…'),
                Arg::Slot(slot) => match names.iter().rev().find(|(bound, _)| bound == slot) {
                    Some((_, name)) => text.push_str(name),
                    None => {
                        let object = bindings.get(*slot as usize).copied().unwrap_or(UNBOUND);
                        text.push_str(self.object_name(object));
                    }
                },
            }
        }
        text.push(')');
        text
    }

    fn number_text(&self, number: &Number, bindings: &Bindings, names: &Names) -> String {
        match number {
            Number::Constant(value) => value.to_string(),
            Number::Fluent(fluent) => {
                let name = name_of(&self.domain.vocabulary.functions, fluent.function);
                self.call_text(name, &fluent.arguments, bindings, names)
            }
            Number::Operation(operator, operands) => {
                let operands: Vec<String> =
                    operands.iter().map(|operand| self.number_text(operand, bindings, names)).collect();
                format!("({operator} {})", operands.join(" "))
            }
            Number::Duration => "?duration".to_owned(),
            Number::Elapsed => "#t".to_owned(),
            Number::TotalTime => "(total-time)".to_owned(),
            Number::Violations(name) => format!("(is-violated {name})"),
        }
    }

    pub(super) fn object_name(&self, number: u32) -> &str {
        name_of(&self.problem.objects, number)
    }

    /// A ground function as text.
    pub(super) fn ground_function_text(&self, ground: &[u32]) -> String {
        self.ground_text(name_of(&self.domain.vocabulary.functions, head(ground)), ground)
    }

    /// A ground fact as text; an object that is not known is a question mark.
    pub(super) fn fact_text(&self, ground: &[u32]) -> String {
        self.ground_text(name_of(&self.domain.vocabulary.predicates, head(ground)), ground)
    }

    fn ground_text(&self, name: &str, ground: &[u32]) -> String {
        let mut words = vec![name];
        words.extend(ground.iter().skip(1).map(|number| self.object_name(*number)));
        format!("({})", words.join(" "))
    }
}

fn head(ground: &[u32]) -> u32 {
    ground.first().copied().unwrap_or(UNBOUND)
}

fn name_of<T: Named>(table: &Table<T>, number: u32) -> &str {
    table.get(number).map_or("?", |item| item.name().as_str())
}
