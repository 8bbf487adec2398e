//! Plans, their documents and their printed forms.

use bson::{Bson, Document, doc};
use rmem::formats::Source;
use rmem::formats::pddl::{Dialect, ast, read_domain, read_problem};
use rmem::formats::plan::{Spelling, read_plan};
use rmem::pddl::{Plan, Step};
use rmem::plan::{
    Answered, Format, Layout, Lineage, PrintError, PrintedPlan, Status, Stored, failure, from_document, hash,
    to_document,
};

/// A printed plan of which nothing is executed.
fn shown(plan: &Plan, format: Format, id: &str, value: &dyn Fn(&str) -> Bson) -> Result<String, PrintError> {
    let document = to_document(plan, &domain(), Layout::Numbered, value);
    PrintedPlan {
        plan,
        document: &document,
        statuses: &[],
        id,
        value,
        structure: None,
        has_metric: false,
        is_temporal: false,
        lanes: None,
    }
    .print(format)
}

/// Prints what can be printed.
fn print(plan: &Plan, format: Format, id: &str, value: &dyn Fn(&str) -> Bson) -> String {
    shown(plan, format, id, value).unwrap()
}

fn domain() -> ast::Domain {
    let text = "(define (domain d) (:predicates (on ?x ?y))
        (:action unstack :parameters (?x ?y) :effect (not (on ?x ?y)))
        (:action putdown :parameters (?x) :effect (on ?x ?x))
        (:action odd :parameters (?action ?b ?b) :effect (on ?b ?b))
        (:action wait :parameters () :effect (and))
        (:durative-action move :parameters (?r ?start) :duration (= ?duration 5) :effect (at end (on ?r ?r))))";
    read_domain(&Source::new("d", text), Dialect::default()).unwrap()
}

fn step(words: &str) -> Step {
    let mut words = words.split(' ').map(str::to_owned);
    Step { action: words.next().unwrap(), arguments: words.collect(), start: None, duration: None }
}

fn timed(words: &str, start: f64, duration: f64) -> Step {
    Step { start: Some(start), duration: Some(duration), ..step(words) }
}

fn plan(steps: impl IntoIterator<Item = Step>) -> Plan {
    Plan { steps: steps.into_iter().collect(), cost: None }
}

fn value(name: &str) -> Bson {
    Bson::from(name)
}

fn name(value: &Bson) -> Option<String> {
    value.as_str().map(str::to_owned)
}

fn numbered(plan: &Plan) -> Document {
    to_document(plan, &domain(), Layout::Numbered, &value)
}

#[test]
fn steps_have_the_names_of_the_parameters() {
    assert_eq!(
        numbered(&plan([step("unstack B A"), step("putdown B")])),
        doc! { "plan": "success", "1": { "action": "unstack", "x": "B", "y": "A" }, "2": { "action": "putdown", "x": "B" } }
    );
}

#[test]
fn a_goal_that_holds_already_is_a_success_without_steps() {
    assert_eq!(numbered(&Plan::default()), doc! { "plan": "success" });
    let fawkes = to_document(&Plan::default(), &domain(), Layout::Fawkes, &value);
    assert_eq!(fawkes, doc! { "plan": 1, "actions": [] });
}

#[test]
fn the_fawkes_layout_lists_actions() {
    let document = to_document(&plan([step("unstack B A")]), &domain(), Layout::Fawkes, &value);
    assert_eq!(document, doc! { "plan": 1, "actions": [{ "name": "unstack", "args": ["B", "A"] }] });
}

#[test]
fn failures_say_their_outcome() {
    assert_eq!(failure("unsolvable", Layout::Numbered), doc! { "plan": "fail", "outcome": "unsolvable" });
    assert_eq!(failure("unsolvable", Layout::Fawkes), doc! { "plan": 0 });
    let stored = from_document(&failure("gave-up", Layout::Numbered), &name);
    assert_eq!(stored, Ok(Stored::Failure(Some("gave-up".to_owned()))));
    assert_eq!(from_document(&doc! { "plan": 0 }, &name), Ok(Stored::Failure(None)));
}

#[test]
fn no_parameter_takes_the_place_of_another() {
    let document = numbered(&plan([step("odd A B C"), step("unknown A B")]));
    assert_eq!(
        document,
        doc! {
            "plan": "success",
            "1": { "action": "odd", "action_2": "A", "b": "B", "b_2": "C" },
            "2": { "action": "unknown", "arg1": "A", "arg2": "B" },
        }
    );
}

#[test]
fn what_is_stored_reads_back() {
    let twelve = (0..12).map(|number| step(&format!("unstack B{number} A")));
    for plan in [
        Plan::default(),
        plan(twelve),
        plan([step("odd A B C"), step("wait"), step("unknown A B")]),
        plan([timed("move r1 a", 0.001, 5.0), timed("move r2 b", 5.002, 2.5)]),
    ] {
        for layout in [Layout::Numbered, Layout::Fawkes] {
            let document = to_document(&plan, &domain(), layout, &value);
            assert_eq!(from_document(&document, &name), Ok(Stored::Plan(plan.clone())), "{document}");
        }
    }
}

#[test]
fn values_of_the_memory_go_into_documents_and_names_come_back() {
    let value =
        |name: &str| name.strip_prefix("n-").map_or(Bson::from(name), |number| Bson::Int32(number.parse().unwrap()));
    let name = |value: &Bson| match value {
        Bson::Int32(number) => Some(format!("n-{number}")),
        value => value.as_str().map(str::to_owned),
    };
    let plan = plan([step("putdown n-3")]);
    let document = to_document(&plan, &domain(), Layout::Numbered, &value);
    assert_eq!(document, doc! { "plan": "success", "1": { "action": "putdown", "x": 3 } });
    assert_eq!(from_document(&document, &name), Ok(Stored::Plan(plan)));
}

#[test]
fn what_is_not_a_stored_plan_is_refused_with_its_key() {
    for (document, error) in [
        (doc! {}, "`plan` is neither"),
        (doc! { "plan": 7 }, "`plan` is neither"),
        (doc! { "plan": "success", "1": 3 }, "`1` is not a document"),
        (doc! { "plan": "success", "1": {} }, "`1` does not name an action"),
        (doc! { "plan": "success", "2": { "action": "a" } }, "step 1 is missing"),
        (doc! { "plan": "success", "1": { "action": "a", "x": 3 } }, "`1.x` is not a value"),
        (doc! { "plan": 1, "actions": [{ "name": "a", "args": [null] }] }, "`actions.0.args.0` is not a value"),
    ] {
        let printed = from_document(&document, &name).unwrap_err().to_string();
        assert!(printed.starts_with(error), "{document}: {printed}");
    }
}

#[test]
fn text_is_what_the_planning_competitions_write() {
    let shown = |plan: &Plan| print(plan, Format::Text, "p", &value);
    assert_eq!(shown(&plan([step("unstack B A"), step("wait")])), "(unstack B A)\n(wait)\n; cost = 2 (unit cost)\n");
    assert_eq!(shown(&Plan { cost: Some(7.5), ..plan([step("wait")]) }), "(wait)\n; cost = 7.5 (general cost)\n");
    assert_eq!(shown(&Plan::default()), "; cost = 0 (unit cost)\n");
    let text = "0.001: (move r1 a) [5.000]\n; makespan = 5.001\n";
    assert_eq!(shown(&plan([timed("move r1 a", 0.001, 5.0)])), text);
    let counted = Plan { cost: Some(1.0), ..plan([timed("move r1 a", 0.001, 5.0)]) };
    assert_eq!(shown(&counted), text);
    let costly = Plan { cost: Some(5.001), ..counted };
    assert_eq!(shown(&costly), text);
    assert_eq!(shown(&plan([timed("move r1 a", 0.0002, 5.0)])), "0.0002: (move r1 a) [5.000]\n; makespan = 5.0002\n");
}

#[test]
fn text_and_ff_read_back() {
    for (format, plan, spelling) in [
        (Format::Text, plan([step("unstack B A"), step("wait")]), Spelling::Ipc),
        (Format::Text, plan([timed("move r1 a", 0.001, 5.0)]), Spelling::Temporal),
        (Format::Ff, plan([step("unstack B A"), step("wait")]), Spelling::Ff),
        (Format::Ff, plan([timed("move r1 a", 0.001, 5.0)]), Spelling::Temporal),
    ] {
        let text = print(&plan, format, "p", &value);
        let read = read_plan(&Source::new("plan", text.clone())).unwrap();
        assert_eq!((read.spelling, read.actions.len()), (spelling, plan.steps.len()), "{text}");
        for (action, step) in read.actions.iter().zip(&plan.steps) {
            assert_eq!((&action.name, &action.arguments), (&step.action, &step.arguments));
            assert_eq!((action.start, action.duration), (step.start, step.duration));
        }
    }
}

#[test]
fn facts_are_symbols_where_they_can_be() {
    let plan = plan([step("unstack B two%20words"), timed("move 1 r", 0.0, 5.0)]);
    let value = |name: &str| Bson::from(name.replace("%20", " "));
    assert_eq!(
        print(&plan, Format::Clips, "p1", &value),
        "(plan (id p1))\n\
         (plan-action (id 1) (plan-id p1) (name unstack) (arguments B \"two words\") (status FORMULATED))\n\
         (plan-action (id 2) (plan-id p1) (name move) (arguments \"1\" r) (start 0.0) (duration 5.0) (status FORMULATED))\n"
    );
}

#[test]
fn a_value_that_clips_would_cut_short_is_an_error() {
    let value = |_: &str| Bson::from("A\0B");
    let shown = |format| self::shown(&plan([step("putdown x")]), format, "p", &value);
    assert!(shown(Format::Clips).unwrap_err().to_string().contains("NUL"));
    assert!(shown(Format::Document).unwrap().contains(r"A\u0000B"));
}

#[test]
fn json_is_the_document_on_one_line() {
    let text = print(&plan([step("putdown B")]), Format::Document, "p", &value);
    assert_eq!(text, "{\"plan\":\"success\",\"1\":{\"action\":\"putdown\",\"x\":\"B\"}}\n");
}

#[test]
fn the_graph_runs_from_start_to_goal() {
    let text = print(&plan([step("putdown B"), step("wait")]), Format::Dot, "a\"b", &value);
    assert!(text.starts_with("digraph \"a\\\"b\" {"), "{text}");
    assert!(text.contains("s1 [label=\"1: (putdown B)\"]") && text.contains("init -> s1 -> s2 -> goal;"), "{text}");
}

#[test]
fn the_graph_shows_the_values_of_the_memory() {
    let value = |name: &str| if name == "n-3" { Bson::Int32(3) } else { Bson::from("Ann \"the\\cook\"\n") };
    let text = print(&plan([step("unstack x--1 n-3")]), Format::Dot, "p", &value);
    assert!(text.contains(r#"s1 [label="1: (unstack \"Ann \\\"the\\\\cook\\\"\\n\" 3)"]"#), "{text}");
}

#[test]
fn the_lineage_says_where_a_plan_comes_from() {
    let lineage = Lineage {
        domain: hash(""),
        goal: "(on a b)".to_owned(),
        queries: vec![Answered { name: "ON".into(), namespace: "r.w".into(), query: "{}".into(), count: 3, line: 9 }],
        cost: Some(2.0),
        length: Some(2),
        ..Lineage::default()
    };
    let document = lineage.to_document();
    assert_eq!(
        document.get_str("domain").ok(),
        Some("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855")
    );
    assert!(!document.contains_key("template"));
    let mut stored = numbered(&plan([step("wait")]));
    stored.insert("_robmem_info", doc! { "lineage": document });
    let Ok(Stored::Plan(read)) = from_document(&stored, &name) else { panic!("{stored}") };
    assert_eq!((read.cost, read.steps.len()), (Some(2.0), 1));
}

#[test]
fn an_imported_plan_gets_the_spelling_of_its_task() {
    let text = "(define (problem n) (:domain d) (:objects Box-A b) (:init) (:goal (and)))";
    let problem = read_problem(&Source::new("p", text), Dialect::default()).unwrap();
    let file = read_plan(&Source::new("plan", "step    0: UNSTACK BOX-A B\n        1: FLY C\n")).unwrap();
    let plan = Plan::from(file).spelled(&domain(), &problem);
    assert_eq!(plan.steps, [step("unstack Box-A b"), step("FLY C")]);
}

#[test]
fn what_was_executed_is_seen_in_every_format() {
    let plan = plan([step("putdown B"), step("wait"), step("putdown A")]);
    let document = to_document(&plan, &domain(), Layout::Numbered, &value);
    let statuses = [Status::Done, Status::Running];
    let page = PrintedPlan {
        plan: &plan,
        document: &document,
        statuses: &statuses,
        id: "p",
        value: &value,
        structure: None,
        has_metric: false,
        is_temporal: false,
        lanes: None,
    };
    let text = page.print(Format::Text).unwrap();
    assert_eq!(text, "(putdown B) ; done\n(wait) ; running\n(putdown A)\n; cost = 3 (unit cost)\n");
    assert_eq!(read_plan(&Source::new("plan", text)).unwrap().actions.len(), 3);
    let clips = page.print(Format::Clips).unwrap();
    for status in ["(status FINAL)", "(status RUNNING)", "(status FORMULATED)"] {
        assert_eq!(clips.matches(status).count(), 1, "{clips}");
    }
    assert_eq!(page.print(Format::Dot).unwrap().matches("style=filled").count(), 2);
    assert_eq!(page.print(Format::Svg).unwrap().matches("fill=\"#c3e6d8\"").count(), 2, "the step and the legend");
}

#[test]
fn a_drawing_has_a_box_or_a_bar_a_step_and_no_markup_of_the_memory() {
    let boxes = print(&plan([step("putdown A<&\u{1}"), step("wait")]), Format::Svg, "\"p\"", &value);
    assert_eq!(boxes.matches("height=\"44\"").count(), 2, "{boxes}");
    assert!(boxes.contains("A&lt;&amp;\\u{1}") && boxes.contains("<title>&quot;p&quot;</title>"), "{boxes}");
    let bars = print(&plan([timed("move r1 a", 0.0, 5.0), timed("move r2 a", 5.0, 5.0)]), Format::Svg, "p", &value);
    assert!(bars.contains("width=\"450.0\" height=\"44\"") && bars.contains(">10</text>"), "{bars}");
    assert!(bars.contains(">time (s)</text>") && bars.contains("makespan 10 s"), "{bars}");
    assert!(print(&Plan::default(), Format::Svg, "p", &value).ends_with("</svg>\n"));
}

#[test]
fn what_is_noted_in_a_step_is_no_argument() {
    let document = doc! { "plan": "success", "1": { "action": "putdown", "x": "B", "_status": "done" } };
    let Ok(Stored::Plan(read)) = from_document(&document, &name) else { panic!("no plan") };
    assert_eq!(read.steps, [step("putdown B")]);
}
