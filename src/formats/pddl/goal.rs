//! `:goal`, which may hold thousands of facts.
//!
//! A goal of plain facts with `and` and `not` is read off the tokens, as the elements of `:init` are. Any other goes through
//! the grammar as a whole.

use super::ast::{Condition, ConditionKind, Place};
use super::grammar::Rule;
use super::outline::{Token, Tokens};
use super::section::Reader;
use crate::formats::{Diagnostic, Span};

impl Reader<'_> {
    /// Reads the condition of the section.
    pub(super) fn goal(&mut self, section: Span) -> Result<Condition, Diagnostic> {
        match self.plain_goal(section) {
            Some(condition) => Ok(condition),
            None => self.condition(section, Rule::goal),
        }
    }

    fn plain_goal(&mut self, section: Span) -> Option<Condition> {
        let mut tokens = Tokens::new(self.source.text(), section.start + 1);
        tokens.next_token()?;
        let Token::Open(open) = tokens.next_token()? else { return None };
        let condition = self.plain_condition(&mut tokens, open)?;
        (tokens.next_token()? == Token::Close(section.end.checked_sub(1)?)).then_some(condition)
    }

    /// The condition whose bracket opens at `open`, if it has nothing but plain facts, `and` and `not`. The outline bounds how
    /// deep it is.
    fn plain_condition(&mut self, tokens: &mut Tokens<'_>, open: usize) -> Option<Condition> {
        let Token::Word(head) = tokens.next_token()? else { return None };
        let word = self.source.slice(head);
        let (kind, end) = if word.eq_ignore_ascii_case("and") {
            let mut parts = Vec::new();
            loop {
                match tokens.next_token()? {
                    Token::Open(at) => parts.push(self.plain_condition(tokens, at)?),
                    Token::Close(at) => break (ConditionKind::And(parts), at + 1),
                    Token::Word(_) => return None,
                }
            }
        } else if word.eq_ignore_ascii_case("not") {
            let Token::Open(at) = tokens.next_token()? else { return None };
            let inner = self.plain_condition(tokens, at)?;
            let Token::Close(at) = tokens.next_token()? else { return None };
            (ConditionKind::Not(Box::new(inner)), at + 1)
        } else {
            let atom = self.plain_atom(tokens, open, head)?;
            let end = atom.place.0.end;
            (ConditionKind::Atom(atom), end)
        };
        Some(Condition { kind, place: Place(Span::new(open, end)) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::Source;
    use crate::formats::pddl::ast::{Atom, Term};

    /// The goal as it is read off the tokens, and as the grammar reads it.
    fn both(goal: &str) -> (Option<Condition>, Option<Condition>) {
        let source = Source::new("p", format!("  (:goal {goal})"));
        let section = Span::new(2, source.text().len());
        let mut reader = Reader::new(&source, Rule::problem_head);
        let plain = reader.plain_goal(section);
        (plain, reader.condition(section, Rule::goal).ok())
    }

    fn names(atom: &Atom) -> Vec<(String, Span)> {
        let terms = atom.arguments.iter().map(|term| match term {
            Term::Variable(name) | Term::Name(name) => name,
            Term::Call(_) => panic!("{term:?}"),
        });
        std::iter::once(&atom.name).chain(terms).map(|name| (name.to_string(), name.span())).collect()
    }

    /// Every place in a condition; trees compare equal wherever they stood.
    fn places(condition: &Condition) -> Vec<(String, Span)> {
        let mut all = vec![(String::new(), condition.place.0)];
        match &condition.kind {
            ConditionKind::And(parts) => all.extend(parts.iter().flat_map(places)),
            ConditionKind::Not(inner) => all.extend(places(inner)),
            ConditionKind::Atom(atom) => {
                all.push(("atom".to_owned(), atom.place.0));
                all.extend(names(atom));
            }
            other => panic!("{other:?}"),
        }
        all
    }

    #[test]
    fn a_plain_goal_is_what_the_grammar_reads() {
        for goal in [
            "(on a b)",
            "(and)",
            "( AND (on a b)(Not (p))\n ; a comment )\n (and (q a) (not (and (on b a)))) )",
            "(at start x)",
            "(always a)",
            "(preference p)",
        ] {
            let (plain, read) = both(goal);
            assert!(plain.is_some(), "{goal}");
            assert_eq!(plain, read, "{goal}");
            assert_eq!(plain.map(|plain| places(&plain)), read.map(|read| places(&read)), "{goal}");
        }
    }

    #[test]
    fn any_other_goal_is_left_to_the_grammar() {
        for goal in [
            "()",
            "(or (p) (q))",
            "(and (p) (exists (?x) (q ?x)))",
            "(= a b)",
            "(>= (f) 2)",
            "(p ?x)",
            "(and p)",
            "(not)",
            "(not (p) (q))",
            "(preference a (p))",
            "(at start (p))",
            "(p) (q)",
            "(p // x\n)",
            "(and (p)",
        ] {
            assert_eq!(both(goal).0, None, "{goal}");
        }
    }
}
