//! A stored plan as an executive reads it: one object, the same for a plan and for a failure.
//!
//! ```text
//! { id, namespace, outcome, exit, planner, cost, metric, makespan, seconds,
//!   steps: [{ index, action, args: {…}, list: […], start, duration, status }], why, sections: [{ line, query, documents }] }
//! ```
//!
//! Every key is always there; what is not known is null.

use bson::{Array, Bson, Document, doc};

use super::Record;
use super::document::{name_arguments, parameters};
use super::progress::Progress;
use crate::pddl::Domain;
use crate::saturate::to_i64;

impl Record {
    /// Returns the report of the plan. `namespace` is where it is stored, none where it is not; `exit` is the exit
    /// code of its outcome.
    #[must_use]
    pub fn report(&self, namespace: Option<&str>, exit: u8) -> Document {
        let lineage = self.lineage();
        let of = |key: &str| lineage.and_then(|lineage| lineage.get(key)).cloned().unwrap_or(Bson::Null);
        let millis = lineage.and_then(|lineage| lineage.get_document("times").ok()?.get_f64("plan").ok());
        let id = namespace.and_then(|_| self.document.get("_id")).map(|_| self.id());
        let steps = self.steps();
        let makespan = steps.iter().filter_map(end).reduce(f64::max).or_else(|| self.empty_makespan());
        // Without a metric, a plan with times is measured by when it ends; older plans were stored with their number of steps.
        let has_cost = makespan.is_none() || of("metric") != Bson::Null;
        doc! {
            "id": id,
            "namespace": namespace,
            "outcome": self.outcome(),
            "exit": i32::from(exit),
            "planner": of("planner"),
            "cost": if has_cost { number(&of("cost")) } else { makespan.map_or(Bson::Null, reported) },
            "metric": of("metric"),
            "makespan": makespan.map_or(Bson::Null, reported),
            "seconds": millis.map(|millis| rounded(millis / 1000.0)),
            "steps": steps,
            "why": of("why"),
            "sections": self.sections(),
        }
    }

    /// Returns the word for the outcome: `success`, or why there is no plan.
    #[must_use]
    pub fn outcome(&self) -> String {
        let stored = self.lineage().and_then(|lineage| lineage.get_str("outcome").ok());
        let failed = || self.document.get_str("outcome").ok();
        let plan = || matches!(self.document.get("plan"), Some(Bson::String(word)) if word == "success");
        let known = stored.or_else(failed).map(current);
        known.unwrap_or(if plan() || self.document.contains_key("actions") { "success" } else { "gave-up" }).to_owned()
    }

    /// That of a plan without steps for a domain whose actions take time.
    fn empty_makespan(&self) -> Option<f64> {
        let is_empty = self.outcome() == "success" && self.progress().is_empty();
        let domain = is_empty.then(|| self.source().ok()?.read_domain().ok()).flatten()?;
        domain.is_temporal().then_some(0.0)
    }

    fn steps(&self) -> Array {
        let progress = self.progress();
        let is_listed = self.document.contains_key("actions");
        let domain = is_listed.then(|| self.source().ok()?.read_domain().ok()).flatten();
        let step = |(index, progress): (usize, &Progress)| {
            let listed = self.document.get_array("actions").ok().and_then(|actions| actions.get(index));
            let numbered = || self.document.get((index + 1).to_string());
            let entry = listed.or_else(numbered).and_then(Bson::as_document);
            entry.map(|entry| match listed {
                Some(_) => listed_step(index, entry, domain.as_ref(), progress),
                None => step(index, entry, progress),
            })
        };
        progress.iter().enumerate().filter_map(step).map(Bson::Document).collect()
    }

    /// Returns the steps that were begun and ended, as documents of intervals: `{name, from, to, status}`.
    #[must_use]
    pub fn intervals(&self) -> Vec<Document> {
        let (steps, progress) = (self.steps(), self.progress());
        let interval = |(step, progress): (&Bson, &Progress)| {
            let step = step.as_document()?;
            let words = step.get_array("list").into_iter().flatten().filter_map(Bson::as_str);
            let words: Vec<&str> = step.get_str("action").into_iter().chain(words).collect();
            let name = format!("({})", words.join(" "));
            Some(
                doc! { "name": name, "from": progress.started?, "to": progress.ended?, "status": progress.status.word() },
            )
        };
        steps.iter().zip(&progress).filter_map(interval).collect()
    }

    fn sections(&self) -> Array {
        let queries = self.lineage().and_then(|lineage| lineage.get_array("queries").ok()).into_iter().flatten();
        let section = |query: &Bson| {
            let query = query.as_document()?;
            let of = |key: &str| query.get(key).cloned().unwrap_or(Bson::Null);
            Some(Bson::Document(doc! {
                "line": of("line"), "name": of("name"), "namespace": of("namespace"), "query": of("query"),
                "documents": of("count"),
            }))
        };
        queries.filter_map(section).collect()
    }
}

/// Today's word for an outcome that an earlier version stored.
fn current(word: &str) -> &str {
    match word {
        "plan" => "success",
        "out-of-time" => "timeout",
        "out-of-memory" => "memory",
        "failed" | "not-executable" => "crashed",
        "no-plan" => "invalid",
        word => word,
    }
}

/// A step of the layout of rmem.
fn step(index: usize, entry: &Document, progress: &Progress) -> Document {
    let arguments = entry.iter().filter(|(key, _)| *key != "action" && !key.starts_with('_'));
    let args: Document = arguments.map(|(key, value)| (key.clone(), value.clone())).collect();
    let list: Array = args.values().cloned().collect();
    described(index, entry, ["action", "_start", "_duration"], (args, list), progress)
}

/// A step of the layout of Fawkes, which leaves the names of parameters to the domain.
fn listed_step(index: usize, entry: &Document, domain: Option<&Domain>, progress: &Progress) -> Document {
    let list = entry.get_array("args").cloned().unwrap_or_default();
    let parameters = domain.zip(entry.get_str("name").ok()).map(|(domain, action)| parameters(domain.tree(), action));
    let mut args = doc! { "action": Bson::Null };
    name_arguments(&mut args, &parameters.unwrap_or_default(), list.iter().cloned());
    args.remove("action");
    described(index, entry, ["name", "start", "duration"], (args, list), progress)
}

/// A step whose action, start and duration are under these keys.
fn described(
    index: usize,
    entry: &Document,
    [name, start, duration]: [&str; 3],
    (args, list): (Document, Array),
    progress: &Progress,
) -> Document {
    let of = |key: &str| entry.get(key).cloned().unwrap_or(Bson::Null);
    doc! {
        "index": to_i64(index + 1), "action": of(name), "args": args, "list": list,
        "start": number(&of(start)), "duration": number(&of(duration)), "status": progress.status.word(),
    }
}

/// When a step ends.
fn end(step: &Bson) -> Option<f64> {
    let step = step.as_document()?;
    let number = |key: &str| match step.get(key)? {
        Bson::Double(number) => Some(*number),
        Bson::Int32(number) => Some(f64::from(*number)),
        Bson::Int64(number) => Some(*number as f64),
        _ => None,
    };
    Some(number("start")? + number("duration").unwrap_or_default())
}

/// A stored number as it is reported.
fn number(value: &Bson) -> Bson {
    match value {
        Bson::Double(value) => reported(*value),
        other => other.clone(),
    }
}

/// Returns a number as reports have it: with at most six decimals, an integer where it is one.
#[must_use]
pub fn reported(number: f64) -> Bson {
    let rounded = rounded(number);
    if rounded.fract() == 0.0 && rounded.abs() < 1e15 { Bson::Int64(rounded as i64) } else { Bson::Double(rounded) }
}

/// Returns a number with at most six decimals, of a small one those that are significant: sums of costs have errors beyond them.
#[must_use]
pub fn rounded(number: f64) -> f64 {
    match number.abs() {
        1e9.. => number,
        1e-9..0.1 => format!("{number:.5e}").parse().unwrap_or(number),
        _ => (number * 1e6).round() / 1e6,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cost_has_at_most_six_decimals() {
        assert_eq!(rounded(11.899999999999999).to_string(), "11.9");
        assert_eq!(rounded(0.1234567).to_string(), "0.123457");
        assert_eq!(rounded(1.234567891e-7).to_string(), "0.000000123457");
        assert_eq!(rounded(0.1 + 0.2 - 0.3), 0.0);
        assert_eq!(number(&Bson::Double(12.0)), Bson::Int64(12));
        assert_eq!(number(&Bson::Null), Bson::Null);
    }

    #[test]
    fn a_plan_of_either_layout_has_the_same_steps_but_for_their_names() {
        let numbered =
            doc! { "_id": "p", "plan": "success", "1": { "action": "go", "to": "box #18", "_status": "done" } };
        let report = Record { document: numbered }.report(Some("a.b"), 0);
        let wanted = doc! {
            "index": 1_i64, "action": "go", "args": { "to": "box #18" }, "list": ["box #18"], "start": null, "duration": null,
            "status": "done",
        };
        assert_eq!(report.get_array("steps").unwrap()[0], Bson::Document(wanted));
        let listed =
            doc! { "plan": 1, "actions": [{ "name": "go", "args": ["box #18"], "start": 1.5, "duration": 2.0 }] };
        let report = Record { document: listed }.report(None, 0);
        let step = report.get_array("steps").unwrap()[0].as_document().unwrap();
        assert_eq!(step.get_array("list").unwrap(), &vec![Bson::from("box #18")]);
        assert_eq!((report.get("id"), report.get("makespan")), (Some(&Bson::Null), Some(&Bson::Double(3.5))));
        assert_eq!(report.get("cost"), Some(&Bson::Double(3.5)));
    }

    #[test]
    fn the_cost_of_a_plan_with_times_is_when_it_ends_unless_a_metric_says_otherwise() {
        let lineage = |metric: Option<&str>| {
            let lineage = doc! { "lineage": { "cost": 2.0, "metric": metric } };
            let action = doc! { "name": "go", "args": [], "start": 0.0, "duration": 8.0 };
            let document = doc! { "plan": 1, "actions": [action], crate::store::metadata::INFO: lineage };
            Record { document }.report(None, 0).get("cost").cloned()
        };
        assert_eq!(lineage(None), Some(Bson::Int64(8)));
        assert_eq!(lineage(Some("minimize (fuel)")), Some(Bson::Int64(2)));
    }
}
