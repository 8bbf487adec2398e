//! Several planners at once: which one wins, which are stopped, and what is printed when none wins.

use std::path::Path;

use crate::lab::{Finished, Lab, assert_run};

/// Planners that cannot be had from real ones: one that never ends, one that is right once that one is there, one whose
/// plan is wrong, and one that is right once all others are over.
const PLANNERS: &str = "[planner.sleeper]\ncommand = [\"/bin/sh\", \"-c\", \"echo $$ > PID; exec sleep 100\"]\noutput = \"ff\"\n\
     [planner.second]\ncommand = [\"/bin/sh\", \"-c\", \"until [ -s PID ]; do sleep 0.05; done; exec RMEM ff -o {domain} -f {problem}\"]\noutput = \"ff\"\n\
     [planner.liar]\ncommand = [\"/bin/sh\", \"-c\", \"echo '(light a)' > {plan}; echo '; cost = 1 (unit cost)' >> {plan}\"]\noutput = \"downward\"\n\
     [planner.late]\ncommand = [\"/bin/sh\", \"-c\", \"ALONE; exec RMEM ff -o {domain} -f {problem}\"]\noutput = \"ff\"\n\
     [planner.absent]\ncommand = [\"/nonexistent/planner\"]\noutput = \"ff\"\n\
     [planner.believer]\ncommand = [\"/bin/sh\", \"-c\", \"echo 'The problem is unsolvable'\"]\noutput = \"temporal\"\n\
     [planner.quitter]\ncommand = [\"/bin/sh\", \"-c\", \"echo 'search cap reached!'\"]\noutput = \"ff\"\n";

/// Waits until no other planner runs: each has a folder beside this one's, until it is known what it came to.
const ALONE: &str = "until [ $(ls .. | wc -l) = 1 ]; do sleep 0.05; done";

/// A lab whose planners can see each other.
fn lab() -> Lab {
    let lab = Lab::new();
    let folder = lab.path().join("runs");
    std::fs::create_dir(&folder).unwrap();
    lab.env("TMPDIR", &folder.display().to_string())
}

/// Runs planners against each other on a task of the fixtures.
fn race(lab: &Lab, task: &str, planners: &[&str], more: &[&str]) -> Finished {
    let pid = lab.path().join("sleeper.pid").display().to_string();
    let rmem = crate::lab::rmem().display().to_string();
    lab.write("rmem.toml", &PLANNERS.replace("PID", &pid).replace("ALONE", ALONE).replace("RMEM", &rmem));
    let (domain, problem) =
        (format!("fixtures/tasks/{task}/domain.pddl"), format!("fixtures/tasks/{task}/problem.pddl"));
    let mut words = vec!["plan", "-d", &domain, "-p", &problem, "--no-store"];
    planners.iter().for_each(|name| words.extend(["--planner", name]));
    lab.rmem(&[&words[..], more].concat())
}

/// The row of a planner in the table on stderr.
fn row<'r>(run: &'r Finished, planner: &str) -> &'r str {
    let mut rows = run.stderr.lines().filter_map(|line| line.trim_start().strip_prefix(planner));
    rows.next_back().unwrap_or_else(|| panic!("no row of {planner}: {run}"))
}

#[test]
fn the_first_valid_plan_wins_and_the_other_planners_are_stopped() {
    for winner in ["builtin", "second"] {
        let lab = Lab::new();
        let run = race(&lab, "solvable", &["sleeper", winner], &[]).exits(0);
        assert!(run.stdout.starts_with('('), "{run}");
        assert!(row(&run, winner).contains("success") && row(&run, winner).ends_with("wins"), "{run}");
        assert!(row(&run, "sleeper").contains("stopped"), "{run}");
        // The second has waited until the sleeper was there.
        if winner == "second" {
            let pid = lab.read("sleeper.pid");
            assert!(!Path::new("/proc").join(pid.trim()).exists(), "the sleeper is still there");
        }
    }
}

#[test]
fn a_wrong_plan_does_not_win() {
    let run = race(&lab(), "solvable", &["liar", "late"], &[]).exits(0);
    assert!(row(&run, "liar").contains("invalid"), "{run}");
    assert!(row(&run, "late").ends_with("wins"), "{run}");
}

#[test]
fn a_proof_ends_the_race() {
    let run = race(&Lab::new(), "unreachable", &["sleeper", "builtin"], &[]).exits(11);
    assert!(row(&run, "sleeper").contains("stopped") && row(&run, "builtin").contains("unsolvable"), "{run}");
}

#[test]
fn a_planner_that_cannot_run_keeps_no_other_from_winning() {
    // The one that can is late, so that the others are done.
    let run = race(&lab(), "numeric", &["fast-downward", "absent", "late"], &[]).exits(0);
    assert!(row(&run, "fast-downward").contains("unsupported"), "{run}");
    assert!(row(&run, "absent").contains("not-found"), "{run}");
}

#[test]
fn without_a_winner_the_exit_code_is_the_most_informative_one() {
    let lab = Lab::new();
    race(&lab, "solvable", &["absent", "liar"], &[]).exits(32);
    race(&lab, "solvable", &["liar", "quitter", "absent"], &[]).exits(12);
    race(&lab, "solvable", &["quitter", "sleeper"], &["--timeout", "300ms"]).exits(23);
}

#[test]
fn what_a_configured_planner_lacks_is_refused_with_the_line() {
    let lab = Lab::new();
    let task = ["plan", "-d", "fixtures/tasks/numeric/domain.pddl", "-p", "fixtures/tasks/numeric/problem.pddl"];
    let modest = |lacks: &str| {
        format!(
            "[planner.modest]\ncommand = [\"/bin/sh\", \"-c\", \"touch ran\"]\noutput = \"ff\"\nlacks = [{lacks}]\n"
        )
    };
    lab.write("rmem.toml", &modest("'durative-actions', ':numeric-fluents'"));
    assert_run!(lab.rmem(&[&task[..], &["--planner", "modest"]].concat()), @r"
    ------- stderr -------
    stored in robmem.plans as [ID]
    error: modest: the planner cannot handle the task: fixtures/tasks/numeric/domain.pddl:9:45: the planner `modest` cannot handle numeric fluents
      |
    9 |     :precondition (and (at ?a) (road ?a ?b) (>= (charge) (distance ?a ?b)))
      |                                             ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: name another planner with --planner
    [exit code: 34]
    ");
    lab.write("rmem.toml", &modest("'numbers'"));
    assert_run!(lab.rmem(&[&task[..], &["--planner", "modest"]].concat()), @r"
    ------- stderr -------
    error: $LAB/rmem.toml:4:10: `numbers` is not a feature of PDDL; expected one of typing, equality, negative-preconditions, disjunctive-preconditions, existential-preconditions, universal-preconditions, conditional-effects, derived-predicates, action-costs, numeric-fluents, object-fluents, durative-actions, duration-inequalities, continuous-effects, timed-initial-literals, preferences, constraints, action-variables, fractional-numbers, other-metrics
      |
    4 | lacks = ['numbers']
      |          ^^^^^^^^^
    [exit code: 3]
    ");
}

#[test]
fn a_claim_without_a_proof_ends_no_race() {
    let lab = lab();
    let run = race(&lab, "solvable", &["believer", "late"], &[]).exits(0);
    assert!(row(&run, "believer").contains("gave-up") && row(&run, "late").ends_with("wins"), "{run}");
    race(&lab, "solvable", &["believer"], &[]).exits(12);
}

/// A planner that needs much memory, and has its plan when the other one of its kind is gone.
const ELEPHANT: &str = "echo $$ > $1.new; mv $1.new $1
until [ -e $2 ]; do sleep 0.05; done
other=$(cat $2)
{ head -c 200000000 /dev/zero; while [ -e /proc/$other ]; do sleep 0.05; done; } | tail -c 200000000 > /dev/null
echo 'ff: found legal plan as follows'
echo 'step 0: WALK DOOR WINDOW'
echo '1: PUSH WINDOW CORNER'
echo '2: CLIMB CORNER'
echo '3: SWITCH-ON CORNER'
";

#[test]
fn the_limit_of_memory_is_one_for_all() {
    let lab = Lab::new();
    let place = |name: &str| lab.path().join(name).display().to_string();
    let elephant = |name: &str, other: &str| {
        let program = place("elephant.sh");
        format!(
            "[planner.{name}]\ncommand = [\"/bin/sh\", \"{program}\", \"{}\", \"{}\"]\noutput = \"ff\"\n",
            place(&format!("{name}.pid")),
            place(&format!("{other}.pid"))
        )
    };
    lab.write("elephant.sh", ELEPHANT);
    lab.write("nobody.pid", "nobody");
    lab.write("rmem.toml", &[elephant("one", "two"), elephant("two", "one"), elephant("alone", "nobody")].concat());
    let run = |planners: [&str; 2]| {
        let task = ["domain", "problem"].map(|name| format!("fixtures/tasks/solvable/{name}.pddl"));
        let planners = ["--planner", planners[0], "--planner", planners[1]];
        lab.rmem(
            &[&["plan", "-d", &task[0], "-p", &task[1], "--no-store", "--memory-limit", "350M"], &planners[..]]
                .concat(),
        )
    };
    // Together they have too much: one has to go, and the other may use what it leaves.
    let both = run(["one", "two"]).exits(0);
    assert_eq!(both.stderr.matches("  memory  ").count(), 1, "{both}");
    assert_eq!(both.stderr.matches("wins").count(), 1, "{both}");
    // One of them may have most of it.
    run(["fast-downward", "alone"]).exits(0);
}

#[test]
fn a_race_is_stored_with_its_plan() {
    let lab = lab();
    race(&lab, "solvable", &["quitter", "builtin"], &[]).exits(0);
    let task = ["domain", "problem"].map(|name| format!("fixtures/tasks/solvable/{name}.pddl"));
    lab.rmem(&["plan", "-d", &task[0], "-p", &task[1], "--planner", "late", "--planner", "liar"]).exits(0);
    let stored = lab.rmem(&["query", "robmem.plans", "--meta", "--fields", "{'_robmem_info.lineage.race': 1, _id: 0}"]);
    let stored: serde_json::Value = serde_json::from_str(&stored.success()).unwrap();
    let race = &stored["_robmem_info"]["lineage"]["race"];
    assert_eq!((&race[0]["planner"], &race[0]["outcome"]), (&"late".into(), &"success".into()), "{stored}");
    assert_eq!((&race[1]["planner"], &race[1]["outcome"]), (&"liar".into(), &"invalid".into()), "{stored}");
    assert!(race[1]["message"].as_str().is_some_and(|message| message.contains("is invalid")), "{stored}");
    let why = lab.rmem(&["plan", "why", "last"]).success();
    assert!(why.contains("race        liar: invalid after"), "{why}");
}

/// A shell line that waits for something, for a minute at most.
fn waiting(condition: &str) -> String {
    format!("timeout 60 sh -c 'until {condition}; do sleep 0.05; done'")
}

#[test]
fn what_was_interrupted_is_not_stored() {
    let lab = Lab::new();
    race(&lab, "solvable", &["quitter"], &[]).exits(12);
    let pid = lab.path().join("sleeper.pid").display().to_string();
    let task = "-d fixtures/tasks/solvable/domain.pddl -p fixtures/tasks/solvable/problem.pddl";
    let run = lab.shell(&format!(
        "rmem plan {task} --planner sleeper & {}; kill -TERM $!; wait $!",
        waiting(&format!("[ -s {pid} ]"))
    ));
    let run = run.exits(130);
    assert!(!run.stderr.contains("stored"), "{run}");
    lab.rmem(&["plan", "show", "last"]).exits(2);
}

#[test]
fn one_planner_makes_no_table() {
    assert_run!(race(&Lab::new(), "solvable", &["builtin"], &[]), @r"
    (walk door window)
    (push window corner)
    (climb corner)
    (switch-on corner)
    ; cost = 4 (unit cost)
    ------- stderr -------
    [exit code: 0]
    ");
}

/// A planner that writes a longer way first and ends, and one that writes a shorter way when that one is over.
const WAYS: &str = "[planner.quick]\ncommand = [\"/bin/sh\", \"-c\", \"printf '(go a)\\\\n(go b)\\\\n; cost = 2 (unit cost)\\\\n' > {plan}\"]\noutput = \"downward\"\n\
     [planner.slow]\ncommand = [\"/bin/sh\", \"-c\", \"ALONE; sleep 1; printf '(jump)\\\\n; cost = 1 (unit cost)\\\\n' > {plan}\"]\noutput = \"downward\"\n";

#[test]
fn a_race_with_anytime_goes_on_after_the_first_plan_and_the_best_wins() {
    let lab = lab();
    lab.write("rmem.toml", &WAYS.replace("ALONE", ALONE));
    lab.write(
        "d.pddl",
        "(define (domain d) (:constants a b) (:predicates (at ?x) (there))
         (:action go :parameters (?x) :precondition () :effect (and (at ?x) (when (at a) (there))))
         (:action jump :parameters () :precondition () :effect (there)))",
    );
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init) (:goal (there)))");
    let words = ["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--planner", "quick", "--planner", "slow"];
    let first = lab.rmem(&words).exits(0);
    assert!(first.stdout.starts_with("(go a)\n(go b)\n"), "{first}");
    let best = lab.rmem(&[&words[..], &["--anytime"]].concat()).exits(0);
    assert!(best.stdout.starts_with("(jump)\n") && row(&best, "slow").ends_with("wins"), "{best}");
    assert!(row(&best, "quick").contains("success"), "{best}");
}

/// A domain in which robots carry boxes, each for a time.
const DELIVERY: [&str; 2] = ["delivery/domain", "delivery/problem"];

fn delivery(lab: &Lab) {
    for (name, file) in DELIVERY.iter().zip(["d.pddl", "p.pddl"]) {
        let path = format!("{}/fixtures/tasks/{name}.pddl", env!("CARGO_MANIFEST_DIR"));
        lab.write(file, &std::fs::read_to_string(path).unwrap());
    }
}

/// The same domain with three robots and 14 boxes.
fn large_delivery(lab: &Lab) {
    delivery(lab);
    let boxes: Vec<String> = (1..=14).map(|number| format!("b{number}")).collect();
    let each = |text: &str| boxes.iter().map(|name| text.replace('?', name)).collect::<Vec<_>>().join(" ");
    lab.write(
        "p.pddl",
        &format!(
            "(define (problem many) (:domain delivery)
             (:objects anna bert carl - robot {} - box store desk shelf - waypoint)
             (:init (robot-at anna store) (robot-at bert desk) (robot-at carl shelf) (empty anna) (empty bert)
               (empty carl) {})
             (:goal (and {})))",
            boxes.join(" "),
            each("(box-at ? store)"),
            each("(box-at ? desk)")
        ),
    );
}

#[test]
fn anytime_uses_all_the_time_for_a_task_with_durations() {
    let lab = Lab::new();
    large_delivery(&lab);
    let words = ["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--timeout", "10s", "--anytime"];
    let start = std::time::Instant::now();
    let found = lab.rmem(&words).exits(0);
    assert!(start.elapsed().as_secs_f64() > 9.0 && found.stdout.contains("; makespan = "), "{found}");
    assert!(!found.stderr.contains("ended after"), "{found}");
}

#[test]
fn a_deadline_is_met_where_the_robots_share_the_work() {
    let lab = Lab::new();
    delivery(&lab);
    let problem = std::fs::read_to_string(lab.path().join("p.pddl")).unwrap();
    let domain = std::fs::read_to_string(lab.path().join("d.pddl")).unwrap();
    // Boxes are taken at the desk for as long as it is open.
    let domain =
        domain.replace("(carries ?r - robot ?b - box))", "(carries ?r - robot ?b - box) (open ?w - waypoint))");
    lab.write(
        "d.pddl",
        &domain.replace(
            "(over all (robot-at ?r ?w)) (at start (carries",
            "(over all (robot-at ?r ?w)) (over all (open ?w)) (at start (carries",
        ),
    );
    let open = |until: &str| {
        lab.write("p.pddl", &problem.replace("(:init", &format!("(:init (open desk) (at {until} (not (open desk)))")))
    };
    let words = ["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--timeout", "10s"];
    open("35");
    let plan = lab.rmem(&words).exits(0);
    assert!(plan.stdout.contains("; makespan = 34.006"), "{plan}");
    lab.write("plan.txt", &plan.stdout);
    lab.rmem(&["validate", "d.pddl", "p.pddl", "plan.txt"]).exits(0);
    open("30");
    lab.rmem(&["validate", "d.pddl", "p.pddl", "plan.txt"]).exits(1);
}

#[test]
fn the_plan_that_ends_first_wins_a_race_with_anytime() {
    let lab = Lab::new();
    delivery(&lab);
    // One robot does everything, one step after the other.
    let slow = lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--format", "text"]).success();
    let steps: Vec<&str> = slow.lines().filter(|line| line.contains('[')).collect();
    let (mut time, mut plan) = (0.0, String::new());
    for step in steps {
        let (action, duration) = (step.find('(').unwrap(), step.find('[').unwrap());
        let length: f64 = step[duration + 1..].trim_end_matches(']').parse().unwrap();
        plan.push_str(&format!("{time:.3}: {}\n", &step[action..]));
        time += length + 0.01;
    }
    lab.write("slow.plan", &plan);
    let planner = |name: &str, wait: &str| {
        format!(
            "[planner.{name}]\ncommand = [\"/bin/sh\", \"-c\", \"{wait}cp {}/slow.plan {{plan}}\"]\noutput = \"temporal\"\n",
            lab.path().display()
        )
    };
    lab.write("rmem.toml", &planner("sequential", ""));
    let race = ["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--timeout", "30s"];
    let race = [&race[..], &["--planner", "sequential", "--planner", "builtin"]].concat();
    let best = lab.rmem(&[&race[..], &["--anytime"]].concat()).exits(0);
    assert!(row(&best, "builtin").ends_with("wins") && row(&best, "sequential").contains("success"), "{best}");
    assert!(best.stdout.contains("; makespan = 34.006"), "{best}");
}

#[test]
fn anytime_is_refused_where_no_planner_improves_its_plan() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :durative-actions) (:predicates (there))
         (:durative-action go :parameters () :duration (= ?duration 2) :condition () :effect (at end (there))))",
    );
    let goal = "(and (there) (preference away (not (there))))";
    lab.write("p.pddl", &format!("(define (problem p) (:domain d) (:init) (:goal {goal}))"));
    let words = ["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"];
    assert_run!(lab.rmem(&[&words[..], &["--anytime"]].concat()), @r"
    ------- stderr -------
    error: p.pddl:1:61: builtin cannot improve a plan of a temporal task with preferences
      |
    1 | (define (problem p) (:domain d) (:init) (:goal (and (there) (preference away (not (there))))))
      |                                                             ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: leave out --anytime
    [exit code: 34]
    ");
    let found = lab.rmem(&words).success();
    assert!(found.contains("(go)"), "{found}");
}

/// A planner that writes a plan and goes on looking; the file `found` says that the plan is there.
fn searching(lab: &Lab) -> String {
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :strips) (:predicates (there))
         (:action jump :parameters () :precondition (and) :effect (there)))",
    );
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init) (:goal (there)))");
    let folder = lab.path().display();
    lab.write(
        "rmem.toml",
        &format!(
            "memory = 'file:robot.rmem'\n[planner.searcher]\noutput = 'downward'\n\
             command = ['/bin/sh', '-c', \"printf '(jump)\\\\n; cost = 1 (unit cost)\\\\n' > {{plan}}; : > {folder}/found; sleep 100\"]\n"
        ),
    );
    format!("{folder}/found")
}

#[test]
fn an_interrupted_search_for_the_best_plan_stores_and_prints_the_best_so_far() {
    for signal in ["INT", "TERM"] {
        let lab = Lab::new();
        let found = searching(&lab);
        let words = "plan -d d.pddl -p p.pddl --anytime --planner searcher --planner builtin --format json";
        let run = lab.shell(&format!(
            "rmem {words} & {}; sleep 0.2; kill -{signal} $!; wait $!",
            waiting(&format!("[ -e {found} ]"))
        ));
        let run = run.exits(130);
        let report: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
        let fields = ["outcome", "exit", "cost"].map(|key| report[key].to_string());
        assert_eq!(fields, ["\"success\"", "130", "1"], "{run}");
        assert!(run.stderr.contains("interrupted; this is the best plan that was found until then"), "{run}");
        assert!(!run.stderr.contains("no better plan is looked for"), "{run}");
        assert!(row(&run, "searcher").contains("success"), "{run}");
        assert_eq!(lab.rmem(&["plan", "show", "last"]).success(), "(jump)\n; cost = 1 (unit cost)\n");
    }
}

#[test]
fn an_interrupted_search_for_the_first_plan_takes_none() {
    let lab = Lab::new();
    let found = searching(&lab);
    let run = lab.shell(&format!(
        "rmem plan -d d.pddl -p p.pddl --planner searcher & {}; kill -INT $!; wait $!",
        waiting(&format!("[ -e {found} ]"))
    ));
    assert_eq!(run.exits(130).stdout, "");
    lab.rmem(&["plan", "show", "last"]).exits(2);
}

#[test]
fn a_plan_that_is_there_when_the_time_is_over_counts() {
    let lab = Lab::new();
    large_delivery(&lab);
    // The first plan is there long before the search for one that ends earlier is over: at one of these limits.
    let mut limit = 50;
    let found = loop {
        let timeout = format!("{limit}ms");
        let run = lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--timeout", &timeout]);
        if run.code != 23 || limit > 60_000 {
            break run.exits(0);
        }
        limit *= 2;
    };
    assert!(found.stdout.contains("; makespan = "), "{found}");
}

#[test]
fn a_goal_that_can_never_hold_is_proof_although_the_planner_gave_up() {
    let lab = Lab::new();
    let run = race(&lab, "unreachable", &["quitter"], &[]);
    assert_run!(run, @r"
    ------- stderr -------
    error: quitter: proven: no plan exists: the planner gave up, but the goal can never hold
    why: the goal asks for (lit), which can never hold
           (switch-on ?s) would make it true, but needs (on-stool)
         and (on-stool), which can never hold
           (climb ?s) would make it true, but needs (stool-at ?s)
         and (stool-at ?s), which can never hold
           (push ?from ?to) would make it true, but needs (stool-at ?from)
    never true, in the initial state or by an action: stool-at, on-stool
    change the goal, the initial state, or the actions of the domain
    [exit code: 11]
    ");
}

/// A domain with costs, on lines of its own, and a problem.
fn costly(lab: &Lab) {
    lab.write(
        "own.pddl",
        "; a domain with costs\n(define (domain d)\n  (:requirements :strips :action-costs)\n  (:predicates (p) (q))\n\n\
         \x20 (:functions (total-cost) - number)\n\
         \x20 (:action first :parameters () :effect (and (p) (increase (total-cost) 3)))\n\n\n\
         \x20 (:action second :parameters () :precondition (p) :effect (and (q) (increase (total-cost) 4))))\n",
    );
    lab.write(
        "task.pddl",
        "(define (problem n) (:domain d) (:init (= (total-cost) 0)) (:goal (q)) (:metric minimize (total-cost)))",
    );
    let folder = lab.path().display();
    lab.write(
        "rmem.toml",
        &format!("[planner.old]\noutput = 'ff'\ncommand = ['sh', '{folder}/old.sh', '{{domain}}', '{{problem}}']\n"),
    );
}

#[test]
fn a_planner_that_refuses_costs_is_asked_again_without_them() {
    let lab = Lab::new();
    costly(&lab);
    // As FF 2.3 does it: what it does not know is a syntax error at its line.
    lab.write(
        "old.sh",
        "echo run >> $(dirname $0)/runs\n\
         line=$(grep -n ':functions' \"$1\" | cut -d: -f1)\n\
         if [ -n \"$line\" ]; then printf \"\\nff: parsing domain file\\n$1: syntax error in line $line, ':FUNCTIONS':\\n\
         domain definition expected\\n\"; exit 1; fi\n\
         grep -q cost \"$1\" \"$2\" && exit 1\n\
         printf \"\\nff: parsing domain file\\n\\nff: found legal plan as follows\\n\\nstep    0: FIRST\\n        1: SECOND\\n\\n\
         time spent:    0.00 seconds total time\\n\\n\"\n",
    );
    let words = ["plan", "-d", "own.pddl", "-p", "task.pddl", "--no-store", "--planner", "old"];
    assert_run!(lab.rmem(&words), @r"
    (first)
    (second)
    ; cost = 7 (general cost)
    ------- stderr -------
    old knows no costs of actions; it was sent the task without them
    [exit code: 0]
    ");
    assert_eq!(lab.read("runs").lines().count(), 2);
    // Numbers that conditions look at are no costs.
    let numbers = lab.read("own.pddl").replace(":precondition (p)", ":precondition (and (p) (> (total-cost) 1))");
    lab.write("own.pddl", &numbers.replace(":action-costs", ":fluents"));
    assert_run!(lab.rmem(&words), @r"
    ------- stderr -------
    error: old: the planner cannot handle the task: own.pddl:6: syntax error, domain definition expected at `:FUNCTIONS`
    [exit code: 34]
    ");
}

#[test]
fn what_a_planner_says_of_its_input_is_told_with_the_users_own_lines() {
    let lab = Lab::new();
    costly(&lab);
    lab.write(
        "old.sh",
        "line=$(grep -n ':action second' \"$1\" | cut -d: -f1)\n\
         printf \"\\nff: parsing domain file\\n$1: syntax error in line $line, 'Q':\\n'define' expected\\n\"; exit 1\n",
    );
    let run = lab.rmem(&["plan", "-d", "own.pddl", "-p", "task.pddl", "--no-store", "--planner", "old"]).exits(32);
    let first = run.stderr.lines().next().unwrap_or_default().to_owned();
    assert_eq!(first, "error: old: it refused its input: own.pddl:10: syntax error, 'define' expected at `Q`", "{run}");
}

/// A task, a planner that finds a plan, and two that say at once, or once all others are over, that there is none.
fn contradiction(lab: &Lab) {
    searching(lab);
    lab.write(
        "rmem.toml",
        &format!(
            "[planner.good]\noutput = 'downward'\n\
             command = ['/bin/sh', '-c', \"printf '(jump)\\\\n; cost = 1 (unit cost)\\\\n' > {{plan}}\"]\n\
             [planner.liar]\noutput = 'downward'\ncommand = ['/bin/sh', '-c', '{ALONE}; exit 11']\n\
             [planner.claimer]\noutput = 'downward'\ncommand = ['/bin/sh', '-c', 'exit 11']\n"
        ),
    );
}

#[test]
fn a_valid_plan_refutes_the_word_that_there_is_none() {
    let lab = lab();
    contradiction(&lab);
    let words = ["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--anytime", "--timeout", "20s"];
    let run = lab.rmem(&[&words[..], &["--planner", "good", "--planner", "liar"]].concat()).exits(0);
    assert_eq!(run.stdout, "(jump)\n; cost = 1 (unit cost)\n");
    let warning = "warning: liar says that no plan exists, which is wrong: good has a valid plan";
    assert!(run.stderr.contains(warning) && row(&run, "liar").contains("wrong"), "{run}");
    assert!(row(&run, "good").ends_with("wins"), "{run}");
}

#[test]
fn only_a_proof_of_rmem_is_called_one() {
    let lab = Lab::new();
    contradiction(&lab);
    let words = ["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--planner", "claimer"];
    let run = lab.rmem(&words).exits(11);
    assert!(run.stderr.starts_with("error: claimer says that no plan exists"), "{run}");
    assert!(!run.stderr.contains("proven"), "{run}");
}

#[test]
fn that_no_better_plan_is_looked_for_is_said_only_where_no_planner_goes_on() {
    let lab = Lab::new();
    contradiction(&lab);
    let words = ["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--anytime", "--timeout", "5s"];
    let alone = lab.rmem(&[&words[..], &["--planner", "good"]].concat()).exits(0);
    assert!(alone.stderr.contains("; no better plan is looked for any more"), "{alone}");
    searching(&lab);
    let good = "[planner.good]\noutput = 'downward'\ncommand = ['/bin/sh', '-c', \"printf '(jump)\\\\n; cost = 1 (unit cost)\\\\n' > {plan}\"]\n";
    lab.write("rmem.toml", &format!("{}{good}", lab.read("rmem.toml")));
    let both = lab.rmem(&[&words[..], &["--planner", "good", "--planner", "searcher"]].concat()).exits(0);
    assert!(
        both.stderr.contains("--anytime: good ended after") && both.stderr.contains("the others went on"),
        "{both}"
    );
}

/// A road of one step and one of two, which is cheaper in each unit.
fn roads(lab: &Lab, metric: &str) -> Finished {
    let domain = "(define (domain roads) (:requirements :typing :numeric-fluents) (:types place)
      (:predicates (at ?p - place) (road ?a ?b - place))
      (:functions (length ?a ?b - place) (total-cost) (wear) (left ?a - place) (fuel))
      (:action go :parameters (?a ?b - place) :precondition (and (at ?a) (road ?a ?b)) :effect (and (not (at ?a)) (at ?b)
        (increase (total-cost) (length ?a ?b)) (increase (wear) 3) (increase (left ?a) (length ?a ?b))
        (decrease (fuel) (length ?a ?b)))))";
    lab.write("d.pddl", domain);
    let problem = format!(
        "(define (problem p) (:domain roads) (:objects a b c - place) (:init (at a) (road a b) (road b c) (road a c)
          (= (length a b) 1) (= (length b c) 1) (= (length a c) 20) (= (total-cost) 0) (= (wear) 0) (= (fuel) 50)
          (= (left a) 0) (= (left b) 0)) (:goal (at c)) (:metric {metric}))"
    );
    lab.write("p.pddl", &problem);
    lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--anytime", "--timeout", "20s"]).exits(0)
}

#[test]
fn a_metric_that_is_a_weighted_sum_is_improved() {
    let lab = Lab::new();
    for (metric, cost) in [
        ("minimize (* 2 (total-cost))", "4"),
        ("minimize (+ (total-cost) 1)", "3"),
        ("minimize (+ (total-cost) (wear))", "8"),
        ("minimize (/ (wear) 2)", "1.5"),
        ("minimize (+ (* 3 (left a)) (left b))", "4"),
        ("minimize (- (total-cost) (fuel))", "-46"),
        ("maximize (fuel)", "48"),
        ("maximize (- (fuel) (* 20 (wear)))", "-30"),
    ] {
        let run = roads(&lab, metric);
        assert!(run.stdout.contains(&format!("; cost = {cost} (general cost)")), "{metric} {run}");
    }
    // What only grows cannot be kept small by a plan that is to make it great.
    let run = roads(&lab, "maximize (wear)");
    assert!(run.stderr.contains("no better plan is looked for any more, but there may be one"), "{run}");
}

#[test]
fn a_metric_of_time_and_numbers_is_improved() {
    let lab = Lab::new();
    let domain =
        "(define (domain ways) (:requirements :durative-actions :numeric-fluents) (:predicates (g)) (:functions (k))
      (:durative-action fast :parameters () :duration (= ?duration 1) :condition ()
        :effect (and (at end (increase (k) 10)) (at end (g))))
      (:durative-action slow :parameters () :duration (= ?duration 20) :condition ()
        :effect (and (at end (increase (k) 1)) (at end (g)))))";
    lab.write("d.pddl", domain);
    for (metric, step) in [
        ("(k)", "(slow)"),
        ("(+ (total-time) (* 5 (k)))", "(slow)"),
        ("(+ (* 5 (total-time)) (k))", "(fast)"),
        ("(total-time)", "(fast)"),
    ] {
        let problem = "(define (problem p) (:domain ways) (:init (= (k) 0)) (:goal (g))";
        lab.write("p.pddl", &format!("{problem} (:metric minimize {metric}))"));
        let words = ["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--anytime", "--timeout", "20s"];
        let run = lab.rmem(&words).exits(0);
        assert!(run.stdout.contains(step), "{metric} {run}");
    }
}

#[test]
fn a_cost_by_a_metric_is_no_unit_cost() {
    let lab = Lab::new();
    costly(&lab);
    let even =
        lab.read("own.pddl").replace("(total-cost) 3", "(total-cost) 1").replace("(total-cost) 4", "(total-cost) 1");
    lab.write("own.pddl", &even);
    let found = lab.rmem(&["plan", "-d", "own.pddl", "-p", "task.pddl"]).success();
    assert_eq!(found, "(first)\n(second)\n; cost = 2 (general cost)\n");
    assert_eq!(lab.rmem(&["plan", "show", "last"]).success(), found);
}

#[test]
fn a_claim_of_another_planner_lets_the_others_go_on() {
    let lab = lab();
    contradiction(&lab);
    let late = "[planner.late]\noutput = 'downward'\n\
         command = ['/bin/sh', '-c', \"ALONE; printf '(jump)\\\\n; cost = 1 (unit cost)\\\\n' > {plan}\"]\n";
    lab.write("rmem.toml", &(lab.read("rmem.toml") + &late.replace("ALONE", ALONE)));
    let words = ["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--planner", "claimer", "--planner", "late"];
    let run = lab.rmem(&words).exits(0);
    assert!(row(&run, "claimer").contains("wrong") && row(&run, "late").ends_with("wins"), "{run}");
}

#[test]
fn a_plan_file_that_is_there_when_the_time_is_over_counts_if_it_is_valid() {
    let lab = Lab::new();
    searching(&lab);
    let mut planners = Vec::new();
    for (step, exit) in [("(jump)", 0), ("(jum", 23)] {
        for output in ["downward", "temporal", "auto"] {
            let name = format!("{output}-{exit}");
            let command = format!("['/bin/sh', '-c', \"printf '{step}\\\\n' > {{plan}}; sleep 100\"]");
            planners.push((format!("[planner.{name}]\noutput = '{output}'\ncommand = {command}\n"), name, exit));
        }
    }
    lab.write("rmem.toml", &planners.iter().map(|(settings, ..)| settings.as_str()).collect::<String>());
    // Side by side, for each takes all of its time.
    std::thread::scope(|scope| {
        for (_, name, exit) in &planners {
            let words = ["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store", "--planner", name, "--timeout", "5s"];
            let lab = &lab;
            scope.spawn(move || lab.rmem(&words).exits(*exit));
        }
    });
}

#[test]
fn what_the_engine_does_not_read_of_durative_actions_is_refused_at_its_line_or_rewritten() {
    let lab = Lab::new();
    let plan = |duration: &str, effect: &str| {
        lab.write(
            "d.pddl",
            &format!(
                "(define (domain d) (:requirements :durative-actions :duration-inequalities :conditional-effects)
 (:predicates (p) (g))
 (:durative-action a :parameters ()
  :duration {duration}
  :effect {effect}))"
            ),
        );
        lab.write("p.pddl", "(define (problem t) (:domain d) (:init (p)) (:goal (g)))");
        lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"])
    };
    let refused = plan("(at end (<= ?duration 3))", "(at end (g))").exits(34).stderr;
    assert!(
        refused.contains("d.pddl:4:13: the planner `builtin` cannot handle durations that are checked"),
        "{refused}"
    );
    let refused = plan("(= ?duration 3)", "(when (at start (p)) (at end (g)))").exits(34).stderr;
    assert!(refused.contains("d.pddl:5:11: the planner `builtin` cannot handle effects under conditions"), "{refused}");
    let refused = plan("(= ?duration 3)", "(at end (g))\n  :condition (preference x (at start (p)))").exits(34).stderr;
    let message = "d.pddl:6:14: the planner `builtin` cannot handle preferences in conditions of durative actions";
    assert!(refused.contains(message), "{refused}");
    for (duration, effect) in [
        ("(at start (= ?duration 3))", "(at end (g))"),
        ("(and (at start (>= ?duration 2)) (at start (<= ?duration 3)))", "(at end (g))"),
        ("(= ?duration 3)", "(when (at start (p)) (at start (g)))"),
        ("(= ?duration 3)", "(and (when (and (at end (p))) (and (at end (g)))))"),
    ] {
        assert!(plan(duration, effect).exits(0).stdout.contains("(a)"), "{duration} {effect}");
    }
}

#[test]
fn outcomes_of_a_planner_that_returns_no_plan_are_words_of_the_contract() {
    let lab = Lab::new();
    searching(&lab);
    lab.write("torn.sh", "printf '(jum' > \"$1\"\n");
    lab.write("data.bin", "not a program");
    lab.write(
        "rmem.toml",
        "memory = 'file:robot.rmem'\n[planner.nosub]\noutput = 'ff'\ncommand = ['true']\n\
         [planner.torn]\noutput = 'downward'\ncommand = ['sh', 'torn.sh', '{plan}']\n\
         [planner.data]\ncommand = ['./data.bin']\n",
    );
    for (planner, outcome, words) in [
        ("nosub", "invalid", "what it returned is not a plan"),
        ("torn", "invalid", ""),
        ("data", "crashed", "its program could not be run"),
    ] {
        let into = format!("plans.{planner}");
        let plan = ["plan", "-q", "-d", "d.pddl", "-p", "p.pddl", "--planner", planner, "--into", &into];
        let run = lab.rmem(&[&plan[..], &["--format", "json"]].concat()).exits(32);
        let report: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
        assert_eq!((&report["outcome"], &report["exit"]), (&outcome.into(), &32.into()), "{run}");
        assert!(run.stderr.contains(words), "{run}");
        let stored = lab.rmem(&["query", &into]).success();
        assert!(stored.contains(&format!("\"plan\":\"fail\",\"outcome\":\"{outcome}\"")), "{stored}");
    }
}
