//! The progress that a running planner has printed.

/// Words for the progress in the last lines of what a planner printed: states, the cost of its best plan.
#[must_use]
pub fn progress(text: &str) -> Option<String> {
    let states = text.lines().rev().find_map(states);
    let cost = text.lines().rev().find_map(cost).map(|cost| format!("best cost {cost}"));
    match (states, cost) {
        (None, None) => None,
        (Some(one), None) | (None, Some(one)) => Some(one),
        (Some(states), Some(cost)) => Some(format!("{states}, {cost}")),
    }
}

/// `ff: so far: 120000 states` of the built-in planner; `Evaluated 120000 state(s).` of Fast Downward.
fn states(line: &str) -> Option<String> {
    if let Some((_, words)) = line.split_once("so far: ") {
        return Some(words.trim().to_owned());
    }
    let (_, rest) = line.split_once("Evaluated ")?;
    let (count, _) = rest.split_once(" state")?;
    count.chars().all(|c| c.is_ascii_digit()).then(|| format!("{count} states"))
}

/// `plan cost: 12.000000` of the built-in planner, `Plan cost: 12` of Fast Downward, `; cost = 12` and `cost: 12` of others.
fn cost(line: &str) -> Option<f64> {
    let lower = line.to_ascii_lowercase();
    let at = ["cost: ", "cost = "].iter().find_map(|mark| lower.find(mark).map(|at| at + mark.len()))?;
    let rest = line.get(at..)?;
    let end = rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len());
    rest.get(..end)?.trim_end_matches('.').parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_words_of_planners_are_understood() {
        let builtin = "ff: so far: 100 states\nff: so far: 2500 states\n";
        assert_eq!(progress(builtin).as_deref(), Some("2500 states"));
        let downward = "[t=1s] Plan cost: 14\n[t=2s] Evaluated 731 state(s).\n[t=3s] Plan cost: 12\n";
        assert_eq!(progress(downward).as_deref(), Some("731 states, best cost 12"));
        assert_eq!(progress("; cost = 3.5 (general cost)").as_deref(), Some("best cost 3.5"));
        for text in ["", "nothing", "Evaluated many states", "cost: none"] {
            assert_eq!(progress(text), None, "{text}");
        }
    }
}
