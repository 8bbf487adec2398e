//! PDDL texts: read, written, complained about.

use std::fs;
use std::path::{Path, PathBuf};

use rmem::formats::Source;
use rmem::formats::pddl::{Dialect, ast, read_domain, read_problem};

fn fixtures(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/pddl").join(folder);
    let mut files: Vec<_> = fs::read_dir(folder)
        .expect("the folder of fixtures")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "pddl"))
        .collect();
    files.sort();
    files
}

fn source(path: &Path) -> Source {
    let name = path.file_name().expect("a name").to_string_lossy().into_owned();
    Source::new(name, fs::read_to_string(path).expect("the file"))
}

fn is_problem(source: &Source) -> bool {
    source.text().to_lowercase().contains("(problem ")
}

fn domain(text: &str) -> Result<ast::Domain, String> {
    read_domain(&Source::new("d.pddl", text), Dialect::default()).map_err(|error| error.to_string())
}

fn problem(text: &str) -> Result<ast::Problem, String> {
    read_problem(&Source::new("p.pddl", text), Dialect::default()).map_err(|error| error.to_string())
}

#[test]
fn what_is_written_reads_back_the_same() {
    for path in fixtures("tasks").into_iter().chain(fixtures("language")) {
        let source = source(&path);
        if source.name().contains("_syntax") {
            continue;
        }
        if is_problem(&source) {
            let tree = read_problem(&source, Dialect::default()).unwrap_or_else(|error| panic!("{error}"));
            let again = read_problem(&Source::new("again", tree.to_string()), Dialect::default());
            assert_eq!(again.unwrap_or_else(|error| panic!("{error}")), tree, "{}", source.name());
        } else {
            let tree = read_domain(&source, Dialect::default()).unwrap_or_else(|error| panic!("{error}"));
            let again = read_domain(&Source::new("again", tree.to_string()), Dialect::default());
            assert_eq!(again.unwrap_or_else(|error| panic!("{error}")), tree, "{}", source.name());
        }
    }
}

#[test]
fn every_fixture_with_a_syntax_error_says_what_was_expected() {
    let mut seen = String::new();
    for path in fixtures("tasks") {
        let source = source(&path);
        if !source.name().contains("_syntax") {
            continue;
        }
        let error = if is_problem(&source) {
            read_problem(&source, Dialect::default()).map(drop)
        } else {
            read_domain(&source, Dialect::default()).map(drop)
        };
        seen.push_str(&error.expect_err("a syntax error").to_string());
        seen.push_str("\n\n");
    }
    insta::assert_snapshot!(seen, @r"
    dom_syntax.pddl:8:17: in action `pick`: expected `)`, `:effect`, `:parameters (…)`, `:precondition`, or `:vars (…)`, found `:parms`
      |
    8 |   (:action pick :parms (?r - robot ?o - object ?x - room)
      |                 ^^^^^^
      = hint: this is written (:action NAME :parameters (…) :precondition (…) :effect (…))

    p_syntax.pddl:3:3: expected `)`, found `(:init`
      |
    3 |   (:init (at r2 k)
      |   ^^^^^^
      = hint: the list opened at 2:3 is not closed
    ");
}

/// The first line of the complaint about a domain.
fn complaint(text: &str) -> String {
    domain(text).expect_err("a complaint").lines().next().unwrap_or_default().to_owned()
}

#[test]
fn a_complaint_says_where_in_which_action_it_is() {
    let text = "(define (domain d) (:action a :parameters (?x) :precondition (and (p ?x) q) :effect (p ?x)))";
    assert_eq!(
        complaint(text),
        "d.pddl:1:74: in action `a`, in its precondition: expected `)` or a condition, found `q`"
    );
    let text = "(define (domain d) (:action a :parameters ?x))";
    assert_eq!(complaint(text), "d.pddl:1:43: in action `a`, in its parameters: expected `(`, found `?x`");
    let text = "(define (domain d) (:durative-action a :parameters (?x - )))";
    assert_eq!(complaint(text), "d.pddl:1:58: in action `a`, in its parameters: expected a type, found `)`");
}

#[test]
fn a_list_that_is_not_closed_is_complained_about_where_it_shows() {
    let text = "(define (domain d) (:action a :precondition (and (p) (q) :effect (r))\n (:action b))";
    assert_eq!(
        complaint(text),
        "d.pddl:1:58: in action `a`, in its precondition: expected `)` or a condition, found `:effect`"
    );
    let error = domain("(define (domain d)\n  (:predicates (p)\n").expect_err("a complaint");
    assert!(error.starts_with("d.pddl:2:19: expected `)`, found the end of the text"), "{error}");
    assert!(error.ends_with("the list opened at 2:3 is not closed"), "{error}");
}

#[test]
fn what_follows_the_definition_is_complained_about() {
    assert_eq!(complaint("(define (domain d)))"), "d.pddl:1:20: expected the end of the text, found `)`");
    assert_eq!(complaint("x (define (domain d))"), "d.pddl:1:1: expected `(define`, found `x`");
    assert_eq!(complaint(""), "d.pddl:1:1: expected `(define`, found the end of the text");
}

#[test]
fn two_slashes_are_a_comment_only_where_that_is_asked_for() {
    let text = "(define (domain d)\n // (:predicates (q\n (:predicates (p)) // end)\n)";
    let error = domain(text).expect_err("a complaint");
    assert!(error.starts_with("d.pddl:2:2: "), "{error}");
    assert!(error.contains("--lenient"), "{error}");
    let tree = read_domain(&Source::new("d", text), Dialect { lenient: true }).expect("a domain");
    assert_eq!(tree.predicates.len(), 1);
}

#[test]
fn sections_come_once_and_where_they_belong() {
    assert_eq!(complaint("(define (domain d) (:types a) (:types b))"), "d.pddl:1:32: `:types` is there twice");
    let error = domain("(define (domain d) (:objects a))").expect_err("a complaint");
    assert!(error.ends_with("hint: this section belongs in a problem"), "{error}");
    assert_eq!(
        complaint("(define (domain d) (:actoin a))"),
        "d.pddl:1:21: expected a section of a domain, found `:actoin`"
    );
}

#[test]
fn words_keep_their_spelling_and_keywords_ignore_it() {
    let tree = problem("(DEFINE (PROBLEM P) (:Domain D) (:INIT (On A b)) (:Goal (AND (On A b))))").expect("a problem");
    assert_eq!(tree.goal.expect("a goal").to_string(), "(and (On A b))");
}

#[test]
fn brackets_nest_only_so_deep() {
    let deep = 100_000;
    let text = format!("(define (domain d) (:derived (p) {}(p){}))", "(not ".repeat(deep), ")".repeat(deep));
    assert!(complaint(&text).contains("lists nest more than 200 deep"));
    assert!(complaint(&"(".repeat(deep)).contains("lists nest more than 200 deep"));
    assert!(complaint(&")".repeat(deep)).contains("expected `(define`"));
    let deep = rmem::formats::pddl::MAX_DEPTH - 3;
    for (open, inner) in [("(and ", "(p)"), ("(forall (?x) ", "(p)"), ("(preference p ", "()"), ("(at start ", "(p)")] {
        let text = format!("(define (domain d) (:derived (p) {}{inner}{}))", open.repeat(deep), ")".repeat(deep));
        let tree = domain(&text).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(domain(&tree.to_string()).expect("the same"), tree);
    }
    let terms = format!("(define (domain d) (:derived (p) {}x{}))", "(f ".repeat(deep), ")".repeat(deep));
    domain(&terms).unwrap_or_else(|error| panic!("{error}"));
    let effect =
        format!("(define (domain d) (:action a :effect {}(p){}))", "(when (q) ".repeat(deep), ")".repeat(deep));
    domain(&effect).unwrap_or_else(|error| panic!("{error}"));
}

#[test]
fn a_large_problem_is_read_piece_by_piece() {
    let atoms = 20_000;
    let mut text = "(define (problem p) (:domain d) (:objects a) (:init ; (\n".to_owned();
    for index in 0..atoms {
        text.push_str(&format!("(on block{index} a) ;)\n"));
    }
    text.push_str(") (:goal (on a a)))");
    let tree = problem(&text).expect("a problem");
    assert_eq!(tree.init.len(), atoms);
    let broken = text.replace("(on block19999 a)", "(on block19999 a");
    let error = problem(&broken).expect_err("a complaint");
    assert!(error.starts_with("p.pddl:20002:3: expected `)`, found `(:goal`"), "{error}");
    let broken = text.replace("(on block19998 a)", "on block19998 a");
    let error = problem(&broken).expect_err("a complaint");
    assert!(error.starts_with("p.pddl:20000:1: in `:init`: expected"), "{error}");
}

const TOKENS: [&str; 24] = [
    "(",
    ")",
    "((",
    "))",
    " ",
    "-",
    "?x",
    ":action",
    "(:init",
    "and",
    "not",
    "(at 5",
    "#t",
    "1e999",
    "5",
    ";",
    "//",
    "\"",
    "é",
    "\u{feff}",
    "=",
    "(either",
    "?duration",
    "\n",
];

/// A fixture with a piece cut out and a token put in.
fn damaged(path: &str) -> impl proptest::strategy::Strategy<Value = String> + use<> {
    use proptest::prelude::*;
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/pddl").join(path);
    let text = fs::read_to_string(file).expect("the fixture");
    (any::<prop::sample::Index>(), 0..12_usize, prop::sample::select(TOKENS.as_slice())).prop_map(
        move |(start, length, token)| {
            let characters: Vec<char> = text.chars().collect();
            let start = start.index(characters.len());
            let end = (start + length).min(characters.len());
            let parts: [String; 2] = [characters[..start].iter().collect(), characters[end..].iter().collect()];
            parts.join(token)
        },
    )
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig { cases: 100, failure_persistence: None, ..Default::default() })]

    #[test]
    fn damaged_domains_are_read_or_complained_about(text in damaged("language/temporal_domain.pddl"), lenient: bool) {
        let source = Source::new("d", text);
        match read_domain(&source, Dialect { lenient }) {
            Ok(tree) => {
                let again = read_domain(&Source::new("again", tree.to_string()), Dialect { lenient });
                proptest::prop_assert_eq!(again.map_err(|error| error.to_string()), Ok(tree));
                let _ = rmem::pddl::Domain::read(&source, Dialect { lenient });
            }
            Err(error) => proptest::prop_assert!(error.to_string().starts_with("d:")),
        }
    }

    #[test]
    fn damaged_problems_are_read_or_complained_about(text in damaged("language/temporal_problem.pddl"), lenient: bool) {
        let source = Source::new("p", text);
        match read_problem(&source, Dialect { lenient }) {
            Ok(tree) => {
                let again = read_problem(&Source::new("again", tree.to_string()), Dialect { lenient });
                proptest::prop_assert_eq!(again.map_err(|error| error.to_string()), Ok(tree));
            }
            Err(error) => proptest::prop_assert!(error.to_string().starts_with("p:")),
        }
    }

    #[test]
    fn facts_read_the_same_off_the_tokens_and_through_the_grammar(
        words in proptest::collection::vec("[!#-'*->@-~é]{1,4}", 1..5)
    ) {
        let fact = format!("({})", words.join(" "));
        let plain = problem(&format!("(define (problem p) (:init {fact}))"));
        // What stands in a timed literal always goes through the grammar.
        let timed = problem(&format!("(define (problem p) (:init (at 5 {fact})))"));
        match (plain.map(|mut tree| tree.init.pop()), timed.map(|mut tree| tree.init.pop())) {
            (Ok(Some(ast::Init::Atom(plain))), Ok(Some(ast::Init::At(_, true, timed)))) => {
                proptest::prop_assert_eq!(plain, timed);
            }
            (Ok(Some(ast::Init::Value(..))), _) | (Err(_), Err(_)) => {}
            (plain, timed) => proptest::prop_assert!(false, "{plain:?} {timed:?}"),
        }
    }

    #[test]
    fn values_read_the_same_off_the_tokens_and_through_the_grammar(word in "[-+.e0-9]{1,6}") {
        let plain = problem(&format!("(define (problem p) (:init (= (f a) {word})))"));
        // A variable always goes through the grammar.
        let grammar = problem(&format!("(define (problem p) (:init (= (f ?a) {word})))"));
        let value = |tree: ast::Problem| tree.init.into_iter().next().map(|element| match element {
            ast::Init::Value(_, value) => value,
            other => panic!("{other}"),
        });
        proptest::prop_assert_eq!(plain.map(value).ok(), grammar.map(value).ok());
    }
}
