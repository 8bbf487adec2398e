//! How long it takes to validate a long plan in a large state.
//!
//! `cargo bench --bench validator [-- --steps 10000 --atoms 100000]`
//!
//! A robot carries parcels between places: with conditional and universal effects, costs, and the numbers of
//! the plan as asked for. Each part is measured alone, then `rmem validate` as a whole.

#![allow(clippy::print_stdout)]

use std::fmt::Write as _;
use std::fs;
use std::process::{Command, Stdio};
use std::time::Instant;

use rmem::formats::Source;
use rmem::formats::pddl::Dialect;
use rmem::formats::plan::read_plan;
use rmem::pddl::{Domain, Problem, Step, repair, validate};

const DOMAIN: &str = "(define (domain parcels) (:requirements :adl :action-costs)
  (:types place parcel mark)
  (:predicates (at ?p - place) (road ?a ?b - place) (lies ?x - parcel ?p - place) (held ?x - parcel) (seen ?m - mark) (free))
  (:functions (total-cost) - number (length ?a ?b - place) - number)
  (:action go :parameters (?a ?b - place) :precondition (and (at ?a) (road ?a ?b))
    :effect (and (not (at ?a)) (at ?b) (increase (total-cost) (length ?a ?b))))
  (:action pick :parameters (?x - parcel ?p - place) :precondition (and (at ?p) (lies ?x ?p) (free))
    :effect (and (held ?x) (not (lies ?x ?p)) (not (free)) (forall (?m - mark) (seen ?m))))
  (:action drop :parameters (?x - parcel ?p - place) :precondition (and (at ?p) (held ?x))
    :effect (and (lies ?x ?p) (free) (not (held ?x)) (forall (?m - mark) (when (seen ?m) (not (seen ?m)))))))";

/// How many places there are; each has roads to those after it.
const PLACES: usize = 400;

/// A problem of so many atoms, and a plan of so many steps: each parcel is carried to the next place.
fn task(atoms: usize, steps: usize) -> (String, String) {
    let parcels = atoms / 2;
    let (mut objects, mut init, mut goal, mut plan) = (String::new(), String::new(), String::new(), String::new());
    for place in 0..PLACES {
        let _ = write!(objects, " p{place}");
    }
    objects.push_str(" - place");
    for parcel in 0..parcels {
        let _ = write!(objects, " x{parcel}");
    }
    objects.push_str(" - parcel m0 m1 m2 m3 - mark");
    for road in 0..atoms - parcels {
        let (from, to) = (road % PLACES, (road + road / PLACES + 1) % PLACES);
        let _ = writeln!(init, "(road p{from} p{to}) (= (length p{from} p{to}) 1)");
    }
    for parcel in 0..parcels {
        let _ = writeln!(init, "(lies x{parcel} p{})", parcel % PLACES);
    }
    for parcel in 0..parcels.min(steps / 3) {
        let (here, there) = (parcel % PLACES, (parcel + 1) % PLACES);
        let _ = writeln!(plan, "(pick x{parcel} p{here})\n(go p{here} p{there})\n(drop x{parcel} p{there})");
        let _ = write!(goal, " (lies x{parcel} p{there})");
    }
    let problem = format!(
        "(define (problem many) (:domain parcels) (:objects{objects})
           (:init (at p0) (free) (= (total-cost) 0)\n{init}) (:goal (and{goal})) (:metric minimize (total-cost)))"
    );
    (problem, plan)
}

fn measured<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    println!("{what:<44}{:>9.1} ms", start.elapsed().as_secs_f64() * 1e3);
    result
}

fn main() {
    let (mut atoms, mut steps) = (100_000, 10_000);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value =
            || words.next().and_then(|word| word.parse().ok()).unwrap_or_else(|| panic!("a number after {word}"));
        match word.as_str() {
            "--atoms" => atoms = value(),
            "--steps" => steps = value(),
            _ => {}
        }
    }
    let (text, plan) = task(atoms, steps);
    let source = Source::new("domain.pddl", DOMAIN);
    let domain = Domain::read(&source, Dialect::default()).expect("a domain");
    let source = Source::new("problem.pddl", text.as_str());
    let problem = measured("the problem is read and checked", || Problem::read(&source, &domain, Dialect::default()));
    let problem = problem.expect("a problem");
    let read = measured("the plan is read", || read_plan(&Source::new("plan", plan.as_str())).expect("a plan"));
    let mut plan_steps: Vec<Step> = read.actions.into_iter().map(Step::from).collect();
    let verdict = measured("the plan is simulated", || validate(&domain, &problem, &plan_steps));
    println!("  {} steps, {verdict}", plan_steps.len());
    plan_steps.remove(plan_steps.len() / 2);
    let verdict = measured("one with a step left out is simulated", || validate(&domain, &problem, &plan_steps));
    println!("  {verdict}");
    let repairs = measured("it is looked for what would mend it", || repair(&domain, &problem, &plan_steps));
    repairs.iter().for_each(|repair| println!("  {}", repair.to_string().replace('\n', "\n  ")));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("a file");
    file("domain.pddl", DOMAIN);
    file("problem.pddl", &text);
    file("plan", &plan);
    let rmem = |what: &str, arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
        command.args(["--memory", "file:world.rmem"]).args(arguments).current_dir(folder.path());
        let output = measured(what, || command.stdin(Stdio::null()).output().expect("a run"));
        println!("  {}", output.status);
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    };
    rmem("rmem validate, from start to end", &["validate", "domain.pddl", "problem.pddl", "plan"]);
    // The same from a memory: the problem as documents, and the plan stored.
    let import = ["import-problem", "problem.pddl", "--into", "world.facts", "--template", "problem.pddl.j2"];
    rmem("rmem import-problem", &import);
    let task = ["-t", "problem.pddl.j2", "-d", "domain.pddl"];
    rmem("rmem gen-problem --domain", &["gen-problem", task[0], task[1], task[2], task[3], "-o", "again.pddl"]);
    rmem("rmem plan import", &[&["plan", "import", "plan"], &task[..]].concat());
    println!("{}", rmem("rmem plan check", &["plan", "check", "last"]));
}
