//! The names in a planner's messages as the user's domain spells them.

use crate::formats::pddl::ast;

/// A message whose actions and predicates, each behind a word that says what it is, are spelled as in the domain.
pub(super) fn spelled(message: &str, domain: &ast::Domain) -> String {
    let actions = domain.actions.iter().map(|action| &action.name);
    let actions = actions.chain(domain.durative_actions.iter().map(|action| &action.name));
    let names: Vec<&str> =
        actions.chain(domain.predicates.iter().map(|predicate| &predicate.name)).map(|name| name.as_str()).collect();
    let mut is_name = false;
    let words = message.split(' ').map(|word| {
        let known = names.iter().find(|name| is_name && name.eq_ignore_ascii_case(word));
        is_name = matches!(word, "action" | "predicate");
        known.copied().unwrap_or(word)
    });
    words.collect::<Vec<_>>().join(" ")
}
