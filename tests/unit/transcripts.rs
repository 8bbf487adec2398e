//! Every recorded planner run, and what it amounts to.

use std::fs;
use std::path::Path;

use rmem::formats::Source;
use rmem::formats::plan::{Spelling, Transcript, Verdict, downward, ff, read_plan, temporal};

use Verdict::{GaveUp, NoCriterion, Plan, Rejected, Unsolvable, Unsupported};

const FF: [(&str, Verdict, usize); 30] = [
    ("actioncost", Unsupported, 0),
    // FF 2.3 is wrong here; whether to believe it is for the planner to decide.
    ("adl", Unsolvable, 0),
    ("dom_syntax", Rejected, 0),
    ("dom_types", Plan, 10),
    ("dom_undeclpred", Rejected, 0),
    ("dom_undeclvar", Rejected, 0),
    ("dom_unktype", Rejected, 0),
    ("durative", Unsupported, 0),
    ("noargs", Rejected, 0),
    ("nofile", Rejected, 0),
    ("noproblem", Rejected, 0),
    ("num", Unsupported, 0),
    ("num_opt", Rejected, 0),
    ("num_unreach", Unsupported, 0),
    ("p_arity", Rejected, 0),
    ("p_disj", Plan, 4),
    ("p_exists", Plan, 4),
    ("p_goalfalse_static", Unsolvable, 0),
    ("p_goalfalse_unreach", Unsolvable, 0),
    ("p_goaltrue", Plan, 0),
    ("p_goaltrue_empty", Plan, 0),
    ("p_init_typemismatch", Rejected, 0),
    ("p_neg", Plan, 1),
    ("p_plan", Plan, 10),
    ("p_syntax", Rejected, 0),
    ("p_typemismatch", Rejected, 0),
    ("p_undeclared_obj", Rejected, 0),
    ("p_undeclared_pred", Rejected, 0),
    ("p_unsolv_search", Unsolvable, 0),
    ("p_wrongdomain", Rejected, 0),
];

const METRIC_FF: [(&str, Verdict, usize); 30] = [
    ("actioncost", Plan, 1),
    ("adl", NoCriterion, 0),
    ("dom_syntax", Rejected, 0),
    ("dom_types", NoCriterion, 0),
    ("dom_undeclpred", Rejected, 0),
    ("dom_undeclvar", Rejected, 0),
    ("dom_unktype", Rejected, 0),
    ("durative", Unsupported, 0),
    ("noargs", Rejected, 0),
    ("nofile", Rejected, 0),
    ("noproblem", Rejected, 0),
    ("num", Plan, 3),
    ("num_opt", Rejected, 0),
    ("num_unreach", GaveUp, 0),
    ("p_arity", Rejected, 0),
    ("p_disj", NoCriterion, 0),
    ("p_exists", NoCriterion, 0),
    ("p_goalfalse_static", Unsolvable, 0),
    ("p_goalfalse_unreach", Unsolvable, 0),
    ("p_goaltrue", NoCriterion, 0),
    ("p_goaltrue_empty", Plan, 0),
    ("p_init_typemismatch", Rejected, 0),
    ("p_neg", NoCriterion, 0),
    ("p_plan", NoCriterion, 0),
    ("p_syntax", Rejected, 0),
    ("p_typemismatch", Rejected, 0),
    ("p_undeclared_obj", Rejected, 0),
    ("p_undeclared_pred", Rejected, 0),
    ("p_unsolv_search", NoCriterion, 0),
    ("p_wrongdomain", Rejected, 0),
];

const DOWNWARD: [(&str, Verdict, usize); 20] = [
    ("actioncost", Plan, 1),
    ("dom_syntax", Rejected, 0),
    ("dom_undeclpred", Rejected, 0),
    ("dom_undeclvar", Rejected, 0),
    ("dom_unktype", Plan, 8),
    ("durative", Unsupported, 0),
    ("num", Unsupported, 0),
    ("p_arity", Rejected, 0),
    ("p_goalfalse_static", Unsolvable, 0),
    ("p_goalfalse_unreach", Unsolvable, 0),
    ("p_goaltrue", Plan, 0),
    ("p_goaltrue_empty", Plan, 0),
    ("p_neg", Plan, 1),
    ("p_plan", Plan, 8),
    ("p_syntax", Rejected, 0),
    ("p_typemismatch", Unsolvable, 0),
    ("p_undeclared_obj", Rejected, 0),
    ("p_undeclared_pred", Rejected, 0),
    ("p_unsolv_search", Unsolvable, 0),
    ("p_wrongdomain", Rejected, 0),
];

const LPG: [(&str, Verdict, usize); 8] = [
    ("durative", Plan, 2),
    // LPG proposes another option itself.
    ("p_goalfalse_unreach", GaveUp, 0),
    ("num", Plan, 3),
    ("p_goaltrue", Plan, 0),
    ("p_plan", Plan, 8),
    ("p_syntax", Rejected, 0),
    ("p_undeclared_pred", Rejected, 0),
    ("p_unsolv_search", Unsolvable, 0),
];

/// A recorded run: what the planner printed, its exit code, the plan file after it.
struct Run {
    output: String,
    code: Option<i32>,
    after: String,
}

fn recorded(planner: &str, case: &str) -> Run {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/transcripts/{planner}/{case}.txt"));
    let text = fs::read_to_string(path).unwrap();
    let (output, rest) = text.split_once("[exit code ").unwrap();
    let (code, after) = rest.split_once(']').unwrap();
    Run { output: output.to_owned(), code: code.parse().ok(), after: after.to_owned() }
}

#[track_caller]
fn expect(planner: &str, case: &str, transcript: &Transcript, verdict: Verdict, length: usize) {
    assert_eq!((transcript.verdict, transcript.actions.len()), (verdict, length), "{planner}/{case}: {transcript:?}");
    let printed = !transcript.message.is_empty();
    assert_eq!(printed, verdict != Plan, "{planner}/{case} says {:?}", transcript.message);
}

fn files(planner: &str) -> usize {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/transcripts").join(planner);
    fs::read_dir(path).unwrap().count()
}

#[test]
fn every_run_of_ff_has_its_outcome() {
    assert_eq!(FF.len(), files("ff"));
    for (case, verdict, length) in FF {
        let run = recorded("ff", case);
        expect("ff", case, &ff::read(&run.output, ""), verdict, length);
        expect("ff", case, &ff::read("", &run.output), verdict, length);
    }
}

#[test]
fn every_run_of_metric_ff_has_its_outcome() {
    assert_eq!(METRIC_FF.len(), files("metric-ff"));
    for (case, verdict, length) in METRIC_FF {
        let run = recorded("metric-ff", case);
        expect("metric-ff", case, &ff::read(&run.output, ""), verdict, length);
    }
}

#[test]
fn every_run_of_fast_downward_has_its_outcome() {
    assert_eq!(DOWNWARD.len(), files("fast-downward"));
    for (case, verdict, length) in DOWNWARD {
        let run = recorded("fast-downward", case);
        let plan = run.after.replace("--- plan file:\n", "");
        let plans = match plan.contains("; cost") {
            true => vec![Source::new("plan", plan)],
            false => Vec::new(),
        };
        expect("fast-downward", case, &downward::read(&plans, run.code, &run.output, ""), verdict, length);
    }
}

#[test]
fn every_run_of_lpg_has_its_outcome() {
    assert_eq!(LPG.len(), files("lpg"));
    for (case, verdict, length) in LPG {
        let run = recorded("lpg", case);
        let plan = run.after.split_once("\n; Version").map_or("", |(_, plan)| plan);
        let plan = format!("; Version{plan}");
        for plans in [vec![], vec![Source::new("plan", plan)]] {
            expect("lpg", case, &temporal::read(&plans, &run.output, ""), verdict, length);
        }
    }
}

#[test]
fn ff_names_file_line_and_token_of_a_syntax_error() {
    let transcript = ff::read(&recorded("ff", "p_syntax").output, "");
    let complaint = transcript.complaint.unwrap();
    assert_eq!(complaint.file.as_deref(), Some("p_syntax.pddl"));
    assert_eq!((complaint.line, complaint.token.as_deref()), (Some(3), Some("(")));
    assert_eq!(transcript.message, "p_syntax.pddl:3: syntax error, 'define' expected at `(`");
}

#[test]
fn costs_are_read() {
    assert_eq!(ff::read(&recorded("metric-ff", "num").output, "").cost, Some(7.0));
    let plan = Source::new("plan", "(go a c)\n; cost = 9 (general cost)\n");
    assert_eq!(downward::read(&[plan], Some(0), "", "").cost, Some(9.0));
    assert_eq!(temporal::read(&[], &recorded("lpg", "num").output, "").cost, Some(7.0));
}

#[test]
fn plan_files_are_read_in_their_spelling() {
    for (file, spelling, length) in [
        ("plan_ok", Spelling::Ipc, 10),
        ("plan_upper", Spelling::Ipc, 10),
        ("plan_timed", Spelling::Temporal, 10),
        ("plan_empty", Spelling::Ipc, 0),
        ("plan_noaction", Spelling::Ipc, 1),
    ] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/plans/{file}.txt"));
        let plan = read_plan(&Source::new(file, fs::read_to_string(path).unwrap())).unwrap();
        assert_eq!((plan.spelling, plan.actions.len()), (spelling, length), "{file}");
    }
}

#[test]
fn a_plan_file_that_is_cut_off_is_an_error_at_its_place() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/plans/plan_syntax.txt");
    let error = read_plan(&Source::new("plan_syntax.txt", fs::read_to_string(path).unwrap())).unwrap_err();
    assert_eq!(
        error.to_string(),
        "plan_syntax.txt:1:11: expected `)`, found the end of the text\n  |\n1 | (move r2 k\n  |           ^"
    );
}

proptest::proptest! {
    #[test]
    fn any_text_is_read(words in proptest::collection::vec(word(), 0..40), code in -1..300_i32) {
        let text: String = words.concat();
        let source = Source::new("plan", text.clone());
        let _ = ff::read(&text, &text);
        let _ = temporal::read(std::slice::from_ref(&source), &text, &text);
        let _ = downward::read(std::slice::from_ref(&source), Some(code), &text, &text);
        if let Err(error) = read_plan(&source) {
            assert!(error.span().end <= text.len(), "{error}");
        }
    }
}

/// Pieces of what planners say, and anything else.
fn word() -> impl proptest::strategy::Strategy<Value = String> {
    use proptest::strategy::Strategy as _;
    const PIECES: [&str; 24] = [
        "\n",
        " ",
        "(",
        ")",
        ":",
        "[",
        "]",
        ";",
        "0",
        "1.5",
        "-",
        "move",
        "step ",
        "é",
        "\0",
        "\r\n",
        "ff: found legal plan as follows\n",
        "time spent:",
        "plan cost: ",
        "; cost = ",
        " (unit cost)",
        "'",
        "p.pddl: syntax error in line 3, '",
        "REACH-GOAL",
    ];
    proptest::prop_oneof![
        9 => proptest::sample::select(&PIECES[..]).prop_map(str::to_owned),
        1 => ".{0,8}",
    ]
}
