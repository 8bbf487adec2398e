//! The names of a task, as every planner understands them.

use std::collections::{BTreeSet, HashMap, HashSet};

use crate::formats::pddl::ast::{Domain, Problem};

/// The longest name that is sent; some planners have buffers of fixed size.
const LONGEST: usize = 100;

/// The type of what functions give. A type of that name, which tasks of the competition of 2004 have, is none
/// that Fast Downward reads.
const NUMBER: &str = "number";

/// Names that planners add to a task themselves: a task that has them means something else.
const ADDED: [&str; 3] = ["reach-goal", "traj-end", NUMBER];

/// What is followed by numbers. Objects may follow `=` as well.
const COUNTING: [&str; 13] =
    ["<", ">", "<=", ">=", "+", "-", "*", "/", "increase", "decrease", "assign", "scale-up", "scale-down"];

/// How long a plan takes: a function that no domain declares.
const TOTAL_TIME: &str = "total-time";

/// The names of a task: which are sent as they are, and what is sent for the others.
pub(super) struct Names<'a> {
    known: Option<&'a [&'a str]>,
    /// Names that read as numbers. They are names where a predicate or a function
    /// applies to them, and in lists of names.
    numbers: HashSet<String>,
    /// What applies to arguments.
    applied: HashSet<String>,
    /// Functions without arguments.
    constants: HashSet<String>,
    /// How long their names are.
    lengths: BTreeSet<usize>,
    /// Those of them that are objects, too.
    ambiguous: HashSet<String>,
    /// Lower-case names to what is sent for them, where that is something else.
    renamed: HashMap<String, String>,
    taken: HashSet<String>,
}

impl<'a> Names<'a> {
    /// Collects the names of a task.
    pub(super) fn new(domain: &Domain, problem: &Problem, known: Option<&'a [&'a str]>) -> Self {
        let predicates = domain.predicates.iter().chain(domain.derived.iter().map(|derived| &derived.head));
        let functions = domain.functions.iter().map(|function| &function.signature);
        let applied: HashSet<String> =
            predicates.chain(functions).map(|signature| signature.name.as_str().to_ascii_lowercase()).collect();
        let constants = domain.functions.iter().map(|function| &function.signature);
        let constants = constants.filter(|signature| signature.parameters.is_empty());
        let mut constants: HashSet<String> =
            constants.map(|signature| signature.name.as_str().to_ascii_lowercase()).collect();
        let names = domain.types.iter().chain(&domain.constants).chain(&problem.objects).map(|typed| &typed.name);
        constants.insert(TOTAL_TIME.to_owned());
        let objects =
            domain.constants.iter().chain(&problem.objects).map(|typed| typed.name.as_str().to_ascii_lowercase());
        let ambiguous = objects.filter(|name| constants.contains(name)).collect();
        let numbers =
            names.clone().map(|name| name.as_str().to_ascii_lowercase()).filter(|name| is_number(name)).collect();
        let actions = domain.actions.iter().map(|action| &action.name);
        let actions = actions.chain(domain.durative_actions.iter().map(|action| &action.name));
        let names = names.chain(actions).map(|name| name.as_str().to_ascii_lowercase()).chain(applied.iter().cloned());
        let taken =
            names.filter(|name| is_plain(name)).chain(ADDED.map(str::to_owned)).chain(["object".to_owned()]).collect();
        let lengths = constants.iter().map(String::len).collect();
        Self { known, numbers, applied, constants, lengths, ambiguous, renamed: HashMap::new(), taken }
    }

    /// What is sent for a name that has been written.
    pub(super) fn sent(&self, name: &str) -> String {
        let name = name.to_ascii_lowercase();
        self.renamed.get(&name).cloned().unwrap_or(name)
    }

    /// Whether a word in a list that starts with `head` is a function without its brackets.
    pub(super) fn is_bare(&self, word: &str, head: Head) -> bool {
        if !matches!(head, Head::Counting | Head::Equal) || self.is_no_constant(word) {
            return false;
        }
        let name = word.to_ascii_lowercase();
        self.constants.contains(&name) && !(head == Head::Equal && self.ambiguous.contains(&name))
    }

    /// Whether a word has a length that no function without arguments has, as most words do.
    fn is_no_constant(&self, word: &str) -> bool {
        word.is_ascii() && !self.lengths.contains(&word.len())
    }

    /// Whether a requirement is written.
    pub(super) fn is_known(&self, requirement: &str) -> bool {
        self.known.is_none_or(|known| known.iter().any(|known| known.eq_ignore_ascii_case(requirement)))
    }

    /// What the first word of a list makes of its other words.
    pub(super) fn head(&self, word: &str) -> Head {
        match word {
            ":requirements" => Head::Requirements,
            ":objects" | ":constants" | ":types" | "either" => Head::Names,
            ":functions" => Head::Functions,
            ":metric" => Head::Metric,
            "=" => Head::Equal,
            _ if COUNTING.iter().any(|counting| counting.eq_ignore_ascii_case(word)) => Head::Counting,
            // It matters only where a number is a name.
            _ if !self.numbers.is_empty() && self.applied.contains(&word.to_ascii_lowercase()) => Head::Applied,
            _ => Head::Other,
        }
    }

    /// What is written for a word in a list that starts with `head`.
    pub(super) fn word(&mut self, word: &str, head: Head) -> String {
        let lower = word.to_ascii_lowercase();
        if word.starts_with(':') || word == "-" || word == "#t" || is_operator(word) {
            return lower;
        }
        if let Some(variable) = lower.strip_prefix('?') {
            return match is_plain(variable) {
                true => lower,
                false => format!("?{}", self.rename(&lower)),
            };
        }
        let named = || head == Head::Names || head == Head::Applied && self.numbers.contains(&lower);
        let number = is_number(word) && !named();
        if number || is_plain(&lower) && !is_added(&lower, head) {
            return lower;
        }
        self.rename(&lower)
    }

    fn rename(&mut self, name: &str) -> String {
        if let Some(known) = self.renamed.get(name) {
            return known.clone();
        }
        let plain = name.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '_' });
        let stem: String = plain.skip_while(|c| !c.is_ascii_alphanumeric()).take(LONGEST / 2).collect();
        let stem = if stem.starts_with(|c: char| c.is_ascii_lowercase()) { stem } else { format!("n{stem}") };
        let mut candidate = stem.clone();
        let mut number = 1_usize;
        while !self.taken.insert(candidate.clone()) {
            number += 1;
            candidate = format!("{stem}-{number}");
        }
        self.renamed.insert(name.to_owned(), candidate.clone());
        candidate
    }
}

/// What the first word of a list says about the others.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Head {
    /// There is none yet.
    Missing,
    /// They are requirements.
    Requirements,
    /// They are names, even if they read as numbers.
    Names,
    /// They are functions and their types.
    Functions,
    /// They are arguments, where names may read as numbers.
    Applied,
    /// They are numbers, and functions whose values are.
    Counting,
    /// They are that, or objects.
    Equal,
    /// The first one is `minimize` or `maximize`.
    Metric,
    Other,
}

/// Whether planners have another meaning for the name, in a list that starts with `head`.
pub(super) fn is_added(name: &str, head: Head) -> bool {
    let is_meant = head == Head::Functions && name.eq_ignore_ascii_case(NUMBER);
    !is_meant && ADDED.iter().any(|added| added.eq_ignore_ascii_case(name))
}

/// How a name is spelled.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Spelling {
    /// As every planner reads it.
    Plain,
    /// So, once it is in lower case.
    PlainButForCase,
    Other,
}

/// Looks at the spelling of a name, once for each letter: tasks have millions of names.
pub(super) fn spelling(name: &str) -> Spelling {
    if name.len() > LONGEST || !name.starts_with(|c: char| c.is_ascii_alphabetic()) {
        return Spelling::Other;
    }
    let mut spelling = Spelling::Plain;
    for byte in name.bytes() {
        match byte {
            b'a'..=b'z' | b'0'..=b'9' | b'_' | b'-' => {}
            b'A'..=b'Z' => spelling = Spelling::PlainButForCase,
            _ => return Spelling::Other,
        }
    }
    spelling
}

/// Whether every planner reads the (lower-case) name as it is.
fn is_plain(name: &str) -> bool {
    name.len() <= LONGEST
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' || c == '-')
}

fn is_operator(word: &str) -> bool {
    ["=", "<", "<=", ">", ">=", "+", "*", "/"].contains(&word)
}

fn is_number(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) && word.parse::<f64>().is_ok()
}
