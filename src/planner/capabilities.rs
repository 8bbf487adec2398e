//! What a planner can do of a task, by the features of PDDL that the task uses.

use super::interface::Planner;
use super::task::Task;
use crate::formats::Diagnostic;
use crate::pddl::Feature;

/// What the planner cannot do of the task, at its place.
pub(super) fn refuse(planner: &dyn Planner, task: &Task<'_>) -> Option<Diagnostic> {
    let lacking = |lack: &Feature| task.uses().find(|(used, _)| used.feature == *lack);
    if let Some((used, source)) = planner.lacks().iter().find_map(lacking) {
        let message = format!("the planner `{}` cannot handle {}", planner.name(), used.feature);
        return Some(Diagnostic::new(source, used.span, message).hint("name another planner with --planner"));
    }
    let hint = "name another planner with --planner, or a larger build of this one in rmem.toml";
    Some(planner.sizes()?.exceeded(planner.name(), task)?.hint(hint))
}

/// What of a task keeps planners from looking for better plans, at its place.
#[must_use]
pub fn not_improved(planners: &[Box<dyn Planner>], task: &Task<'_>) -> Option<Diagnostic> {
    let kept = |feature: &Feature| planners.iter().find(|planner| planner.never_improves(task).contains(feature));
    let (used, source, planner) = task.uses().find_map(|(used, source)| Some((used, source, kept(&used.feature)?)))?;
    let message = format!("{} cannot improve a plan of a temporal task with {}", planner.name(), used.feature);
    Some(Diagnostic::new(source, used.span, message).hint("leave out --anytime").unsupported())
}

/// What in a task keeps a planner's word that there is no plan from being a proof.
pub(super) fn doubt(planner: &dyn Planner, task: &Task<'_>) -> Option<Feature> {
    task.features().find(|feature| planner.doubts().contains(feature))
}
