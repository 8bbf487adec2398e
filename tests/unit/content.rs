//! What a problem says, for comparing two.

use rmem::formats::pddl::ast;
use rmem::problem::names;

/// What a problem says, whatever the order of its objects and its initial state, and the case of its names.
pub(crate) fn content(problem: &ast::Problem) -> Vec<String> {
    let plain = |text: String| {
        let words = text.split_inclusive([' ', '(', ')', '\n']).map(|word| {
            let name = word.trim_end_matches([' ', '(', ')', '\n']);
            format!("{}{}", names::restore(name).to_lowercase(), &word[name.len()..])
        });
        words.collect::<String>()
    };
    let kind = |object: &ast::Typed| object.kind.as_ref().map_or("[\"object\"]".to_owned(), |kind| format!("{kind:?}"));
    let mut lines: Vec<String> =
        problem.objects.iter().map(|object| plain(format!("{} - {}", object.name, kind(object)))).collect();
    lines.extend(problem.init.iter().map(|element| plain(element.to_string())));
    lines.sort();
    let mut rest = problem.clone();
    (rest.objects, rest.init) = (Vec::new(), Vec::new());
    lines.push(plain(rest.to_string()).replace(" - object", ""));
    lines
}
