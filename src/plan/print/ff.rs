//! As FF writes plans.

use std::fmt::Write as _;

use super::page::{line, words};
use crate::pddl::Plan;

pub(super) fn ff(plan: &Plan) -> String {
    let mut text = "ff: found legal plan as follows\n\n".to_owned();
    if plan.is_temporal() {
        text.extend(plan.steps.iter().map(|step| format!("{}\n", line(step))));
        return text;
    }
    text.push_str("step ");
    for (index, step) in plan.steps.iter().enumerate() {
        let _ = write!(text, "{index:4}: {}\n     ", words(step));
    }
    text.push('\n');
    if let Some(cost) = plan.cost {
        let _ = writeln!(text, "plan cost: {cost:.6}");
    }
    text
}
