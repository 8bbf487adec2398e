//! The grammar, and its complaints in the user's words.

use pest::Parser as _;
use pest::iterators::Pair;
use pest_derive::Parser;

use super::outline::{Token, Tokens};
use crate::formats::{Diagnostic, Source, Span};

/// The parser that pest makes of the grammar.
#[derive(Parser)]
#[grammar = "grammars/pddl.pest"]
struct Grammar;

/// Parses the text at `span` by `rule`.
pub(super) fn parse(source: &Source, span: Span, rule: Rule) -> Result<Pair<'_, Rule>, Diagnostic> {
    let mut pairs = Grammar::parse(rule, source.slice(span)).map_err(|error| {
        let flaw = Diagnostic::from_pest_at(source, span.start, &error, words);
        Diagnostic::new(source, token_at(source, flaw.span().start), flaw.message())
    })?;
    pairs.next().ok_or_else(|| Diagnostic::new(source, span, "expected something here"))
}

/// The bracket or word at `offset`, for the caret.
fn token_at(source: &Source, offset: usize) -> Span {
    match Tokens::new(source.text(), offset).next_token() {
        Some(Token::Word(span)) if span.start == offset => span,
        _ => Span::at(offset),
    }
}

/// Whether a pair only marks a place: brackets, words that say which rule it is.
pub(super) fn is_mark(rule: Rule) -> bool {
    use Rule as R;
    matches!(
        rule,
        R::open
            | R::close
            | R::dash
            | R::keyword
            | R::EOI
            | R::either_word
            | R::and_word
            | R::or_word
            | R::not_word
            | R::imply_word
            | R::forall_word
            | R::exists_word
            | R::preference_word
            | R::when_word
            | R::at_word
            | R::over_word
            | R::start_word
            | R::end_word
            | R::all_word
            | R::define_word
            | R::domain_word
            | R::problem_word
            | R::parameters_word
            | R::locals_word
            | R::precondition_word
            | R::condition_word
            | R::duration_word
            | R::effect_word
            | R::equals
    )
}

/// A rule as it is called in messages.
fn words(rule: &Rule) -> String {
    use Rule as R;
    let words = match rule {
        R::open => "`(`",
        R::close => "`)`",
        R::dash | R::of_type => "`-` and a type",
        R::r#type => "a type",
        R::either | R::either_word => "`(either …)`",
        R::name | R::names => "a name",
        R::head => "a predicate or function",
        R::variable | R::variables => "a variable",
        R::number => "a number",
        R::keyword => "a keyword",
        R::requirement => "a requirement such as `:strips`",
        R::signature => "`(NAME ?x - TYPE …)`",
        R::atom | R::initial_atom => "`(NAME …)`",
        R::expression | R::elapsed | R::operation => "an expression",
        R::operator => "an operator",
        R::comparator | R::reserved | R::equals => "a comparison",
        R::start_word => "`start`",
        R::end_word => "`end`",
        R::all_word => "`all`",
        R::parameters | R::parameters_word => "`:parameters (…)`",
        R::locals | R::locals_word => "`:vars (…)`",
        R::precondition | R::precondition_word => "`:precondition`",
        R::durative_condition | R::condition_word => "`:condition`",
        R::duration | R::duration_word => "`:duration`",
        R::effects | R::effect_word => "`:effect`",
        R::define_word => "`define`",
        R::domain_word | R::domain_head => "`domain`",
        R::problem_word | R::problem_head => "`problem`",
        R::direction => "`minimize` or `maximize`",
        R::bound | R::length_word => "`(:serial NUMBER)` or `(:parallel NUMBER)`",
        R::and_word
        | R::or_word
        | R::not_word
        | R::imply_word
        | R::forall_word
        | R::exists_word
        | R::when_word
        | R::preference_word
        | R::assigner
        | R::assignment
        | R::at_word
        | R::over_word
        | R::moment
        | R::at_start
        | R::at_end
        | R::over_all
        | R::modal
        | R::unary_modal
        | R::binary_modal
        | R::unary_deadline
        | R::binary_deadline
        | R::unary_interval => "a word such as `and`, `not`",
        R::effect | R::joint_effect | R::universal_effect | R::conditional_effect | R::timed_effect | R::deletion => {
            "an effect"
        }
        R::initial_value | R::timed_literal | R::initial_negation => "an element of `:init`",
        R::EOI => "the end of the text",
        _ => "a condition",
    };
    words.to_owned()
}
