//! The files of a planner's run, and what stands for them in a command.

/// What stands for the domain's file in a command.
pub(super) const DOMAIN: &str = "{domain}";
/// What stands for the problem's file in a command.
pub(super) const PROBLEM: &str = "{problem}";
/// What stands in a command for the file that a planner may write its plan to.
pub(super) const PLAN: &str = "{plan}";

/// The domain's file in the run's directory.
pub(super) const DOMAIN_FILE: &str = "domain.pddl";
/// The problem's file in the run's directory.
pub(super) const PROBLEM_FILE: &str = "problem.pddl";

/// Where a plan file stands among the others: by its number, the one without before them.
/// Plan files are `plan`, `plan.1`, … as asked for, and what planners write unasked:
/// `sas_plan`, `sas_plan.1`, `plan_1.SOL`.
pub(super) fn order(name: &str) -> Option<u64> {
    let rest = ["plan", "sas_plan"].into_iter().find_map(|stem| name.strip_prefix(stem))?;
    let number = rest.trim_start_matches(['.', '_']).trim_end_matches(".SOL");
    match number {
        "" => Some(0),
        number => number.parse().ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plan_files_are_in_the_order_of_their_numbers() {
        let mut names = ["plan.10", "plan.9", "plan", "problem.pddl", "plan.txt", "plan_2.SOL", "stdout"]
            .into_iter()
            .filter_map(|name| Some((order(name)?, name)))
            .collect::<Vec<_>>();
        names.sort_unstable();
        assert_eq!(
            names.iter().map(|(_, name)| *name).collect::<Vec<_>>(),
            ["plan", "plan_2.SOL", "plan.9", "plan.10"]
        );
    }
}
