//! Plans that were changed at random, validated by rmem and by another simulator: the one of the engine, which
//! grounds the task and knows nothing of how rmem looks at it.
//!
//! Where conditional effects add and delete a fact at once, the engine's deletes win; here adds do, as in VAL. Such
//! tasks are left out.
//!
//! By hand, on any tasks: `RMEM_TEST_BENCHMARKS=FOLDER RMEM_TEST_MUTATIONS=1000 cargo test --release --test unit mutations`.

use std::fs;
use std::path::{Path, PathBuf};

use ferroplan::parser;
use ferroplan::verify::VerifyCtx;
use rmem::formats::Source;
use rmem::formats::pddl::Dialect;
use rmem::formats::plan::ff;
use rmem::pddl::{Domain, Problem, Step, Validation, repair, validate};
use rmem::planner::builtin;

/// Numbers that are the same in every run.
struct Dice(u64);

impl Dice {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(self.0 >> 33).expect("31 bits") % bound.max(1)
    }
}

/// A step is left out, doubled, moved, or gets another object or another action.
fn mutate(plan: &mut Vec<Step>, domain: &Domain, objects: &[String], dice: &mut Dice) {
    let place = dice.below(plan.len());
    match dice.below(5) {
        0 if !plan.is_empty() => drop(plan.remove(place)),
        1 if !plan.is_empty() => plan.insert(dice.below(plan.len()), plan[place].clone()),
        2 if !plan.is_empty() => {
            let step = plan.remove(place);
            plan.insert(dice.below(plan.len() + 1), step);
        }
        3 if plan.get(place).is_some_and(|step| !step.arguments.is_empty()) => {
            let argument = dice.below(plan[place].arguments.len());
            plan[place].arguments[argument] = objects[dice.below(objects.len())].clone();
        }
        _ => {
            let action = &domain.actions()[dice.below(domain.actions().len())];
            let arguments = action.parameters().iter().map(|_| objects[dice.below(objects.len())].clone()).collect();
            let step = Step { action: action.name().to_owned(), arguments, start: None, duration: None };
            plan.insert(place, step);
        }
    }
}

/// Validates a plan and so many changed ones twice; gives how many of them are valid.
fn compare(name: &str, domain_text: &str, problem_text: &str, count: usize) -> Option<usize> {
    let domain = Domain::read(&Source::new("d.pddl", domain_text), Dialect::default()).ok()?;
    let problem = Problem::read(&Source::new("p.pddl", problem_text), &domain, Dialect::default()).ok()?;
    let other =
        VerifyCtx::prepare(&parser::parse_domain(domain_text).ok()?, &parser::parse_problem(problem_text).ok()?);
    let other = other.ok()?;
    let mut printed = String::new();
    if builtin::child(domain_text, problem_text, builtin::Options::default(), &mut |text| printed.push_str(text)) != 0 {
        return None;
    }
    let found: Vec<Step> = ff::read(&printed, "").actions.into_iter().map(Step::from).collect();
    let mut objects: Vec<String> = domain.constants().map(|(name, _)| name.to_owned()).collect();
    objects.extend(problem.objects().map(|object| object.name.to_owned()));
    let mut dice = Dice(7);
    let mut valid = 0;
    for round in 0..=count {
        let mut plan = found.clone();
        for _ in 0..round.min(1 + round % 3) {
            mutate(&mut plan, &domain, &objects, &mut dice);
        }
        let verdict = validate(&domain, &problem, &plan);
        let upper = |text: &String| text.to_uppercase();
        let reported: Vec<_> = plan
            .iter()
            .map(|step| (upper(&step.action), step.arguments.iter().map(upper).collect::<Vec<_>>()))
            .collect();
        let replayed = other.replay(&reported);
        let agreed = replayed.as_ref().is_ok_and(|verified| verified.hard_goal_met);
        assert!(!matches!(verdict, Validation::Unchecked(_)), "{name}: {verdict}");
        if round == 0 && verdict.is_valid() && !agreed {
            // A goal that is no conjunction is reached by an action that the engine adds.
            return None;
        }
        assert_eq!(verdict.is_valid(), agreed, "{name}: {verdict}; the other says {replayed:?} of {reported:?}");
        let repairs = repair(&domain, &problem, &plan);
        assert!(repairs.is_empty() || !verdict.is_valid(), "{name}: a valid plan needs no repair");
        for remedy in repairs.iter().flat_map(|repair| &repair.remedies).filter(|remedy| remedy.is_possible) {
            taken(name, &domain, &problem, &plan, &verdict, &remedy.action);
        }
        valid += usize::from(agreed);
    }
    Some(valid)
}

/// An action that is printed to be possible where the plan breaks can be taken there.
fn taken(name: &str, domain: &Domain, problem: &Problem, plan: &[Step], verdict: &Validation, action: &str) {
    let Validation::Invalid(failure) = verdict else { panic!("{name}: a remedy for a valid plan") };
    let broken = failure.step().unwrap_or(plan.len());
    let mut words = action.trim_matches(['(', ')']).split(' ').map(str::to_owned);
    let step =
        Step { action: words.next().expect("an action"), arguments: words.collect(), start: None, duration: None };
    let mut mended = plan[..broken].to_vec();
    mended.push(step);
    if let Validation::Invalid(failure) = validate(domain, problem, &mended) {
        assert_ne!(failure.step(), Some(broken), "{name}: {action} was printed to be possible, but {failure}");
    }
}

fn tasks() -> Vec<(String, PathBuf, PathBuf)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let pair = |domain: &str, problem: &str| {
        let file = |name: &str| root.join("pddl/tasks").join(format!("{name}.pddl"));
        (problem.to_owned(), file(domain), file(problem))
    };
    let task = |name: &str| {
        let file = |file: &str| root.join("tasks").join(name).join(file);
        (name.to_owned(), file("domain.pddl"), file("problem.pddl"))
    };
    let mut tasks = vec![
        pair("dom", "p_plan"),
        pair("dom", "p_neg"),
        pair("acdom", "acp"),
        pair("ndom", "np"),
        task("solvable"),
        task("numeric"),
    ];
    let Some(folder) = std::env::var_os("RMEM_TEST_BENCHMARKS").map(PathBuf::from) else { return tasks };
    let mut folders: Vec<PathBuf> =
        fs::read_dir(folder).expect("a folder").flatten().map(|entry| entry.path()).collect();
    folders.sort();
    tasks.extend(folders.into_iter().map(|task| {
        let name = task.file_name().unwrap_or_default().to_string_lossy().into_owned();
        (name, task.join("domain.pddl"), task.join("problem.pddl"))
    }));
    tasks
}

#[test]
fn mutations_get_the_verdict_of_another_simulator() {
    let count = std::env::var("RMEM_TEST_MUTATIONS").ok().and_then(|count| count.parse().ok()).unwrap_or(150);
    let (mut validated, mut valid) = (0, 0);
    for (name, domain, problem) in tasks() {
        let texts = (fs::read_to_string(domain), fs::read_to_string(problem));
        if let (Ok(domain), Ok(problem)) = texts
            && let Some(agreed) = compare(&name, &domain, &problem, count)
        {
            validated += 1;
            valid += agreed;
        }
    }
    assert!(validated >= 6 && valid >= validated, "only {validated} tasks were validated, with {valid} valid plans");
}
