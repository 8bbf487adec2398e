//! Which comparisons never hold, in words.

use super::super::interval::Interval;
use super::super::number::{Comparator, Comparison, Expression};
use super::super::task::Task;

/// The most comparisons that are named.
const MOST: usize = 3;

/// Says which comparisons never hold, each as number and truth, and between what the numbers stay; empty where there is none.
pub(super) fn text(task: &Task, missing: &[(u32, bool)], intervals: &[Interval]) -> String {
    let mut sentences = Vec::new();
    for (number, truth) in missing.iter().take(MOST) {
        let comparison = &task.numbers.comparisons[*number as usize];
        let limits = comparison.variables().into_iter().map(|variable| {
            format!("{} {}", task.numbers.names[variable as usize], limits(intervals[variable as usize]))
        });
        let limits: Vec<String> = limits.collect();
        sentences.push(format!("{} can never hold: {}", pddl(task, comparison, *truth), limits.join(", ")));
    }
    if missing.len() > MOST {
        sentences.push(format!("nor can {} other comparisons", missing.len() - MOST));
    }
    sentences.join("; ").to_lowercase()
}

/// Between what a number stays.
fn limits(interval: Interval) -> String {
    let Interval { low, high, .. } = interval;
    match (low.is_finite(), high.is_finite()) {
        _ if interval.is_empty() => "never has a value".to_owned(),
        (true, true) if low == high => format!("is always {low}"),
        (true, true) => format!("stays between {low} and {high}"),
        (true, false) => format!("is at least {low}"),
        (false, true) => format!("is at most {high}"),
        (false, false) => "may have any value".to_owned(),
    }
}

/// A comparison as PDDL, or its negation.
fn pddl(task: &Task, comparison: &Comparison, truth: bool) -> String {
    let sign = match comparison.comparator {
        Comparator::Less => "<",
        Comparator::AtMost => "<=",
        Comparator::Equal => "=",
        Comparator::AtLeast => ">=",
        Comparator::Greater => ">",
    };
    let text = format!("({sign} {} {})", expression(task, &comparison.left), expression(task, &comparison.right));
    if truth { text } else { format!("(not {text})") }
}

fn expression(task: &Task, part: &Expression) -> String {
    let both = |sign: &str, left: &Expression, right: &Expression| {
        format!("({sign} {} {})", expression(task, left), expression(task, right))
    };
    match part {
        Expression::Number(number) => number.to_string(),
        Expression::Variable(variable) => task.numbers.names[*variable as usize].clone(),
        Expression::Sum(parts) => {
            let parts: Vec<String> = parts.iter().map(|part| expression(task, part)).collect();
            format!("(+ {})", parts.join(" "))
        }
        Expression::Product(left, right) => both("*", left, right),
        Expression::Quotient(left, right) => both("/", left, right),
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::example::counter;
    use super::super::super::number::Change;
    use super::super::obstacle;

    #[test]
    fn what_never_holds_is_written_as_pddl() {
        let mut task = counter();
        task.numbers.names = vec!["(LOAD)".to_owned()];
        assert_eq!(obstacle(&task, &task.init, 1 << 20), None);
        for operator in &mut task.operators {
            operator.amounts.iter_mut().for_each(|effect| effect.change = Change::Decrease);
        }
        let text = "(>= (load) 10) can never hold: (load) is at most 0";
        assert_eq!(obstacle(&task, &task.init, 1 << 20).as_deref(), Some(text));
        task.operators.clear();
        let text = "(>= (load) 10) can never hold: (load) is always 0";
        assert_eq!(obstacle(&task, &task.init, 1 << 20).as_deref(), Some(text));
    }
}
