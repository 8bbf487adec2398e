use rmem::formats::Source;
use rmem::formats::marker::{Node, QueryKind, parse};

#[test]
fn nodes_know_their_places_in_the_template() {
    let text = "a <<#ON||[{$match: {x: 1}}]>>\n<<rings_0>><<#ON_separator>>, <</ON_separator>><</ON>>";
    let source = Source::new("t", text);
    let template = parse(&source).unwrap_or_else(|error| panic!("{error}"));
    let [Node::Text(before), Node::Section(section)] = template.nodes.as_slice() else { panic!("{template:?}") };
    assert_eq!(source.slice(*before), "a ");
    assert_eq!(source.slice(section.span), "<<#ON||[{$match: {x: 1}}]>>");
    let query = section.query.as_ref().expect("a query");
    assert_eq!((query.kind, source.slice(query.span)), (QueryKind::Pipeline, "[{$match: {x: 1}}]"));
    let [Node::Text(_), Node::Value { key, span }, Node::Separator(_)] = section.body.as_slice() else {
        panic!("{section:?}")
    };
    assert_eq!((key.as_str(), source.slice(*span)), ("rings_0", "<<rings_0>>"));
}

#[test]
fn a_section_with_anothers_end_is_complained_about_with_both_places() {
    let error = parse(&Source::new("t", "x <<#A|{}>>\n  <</B>>")).expect_err("mismatched").to_string();
    assert!(error.starts_with("t:2:3: expected `<</A>>`"), "{error}");
    assert!(error.contains("section `A` was opened at 1:3"), "{error}");
}

#[test]
fn large_and_broken_templates_end_in_a_result() {
    for text in ["<<#A|{}>>".repeat(50_000), "<<".repeat(50_000), "<<#".repeat(50_000), "<<a>>".repeat(50_000)] {
        let _ = parse(&Source::new("t", text));
    }
}
