//! The result of a check as text and as a document.

use bson::{Bson, Document, doc};

use super::{Check, Fault, Origin};
use crate::formats::shell;
use crate::pddl::{Cause, Repair};
use crate::problem::names;
use crate::saturate::to_i64;

impl Check {
    /// Whether the plan still reaches its goal.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.fault.is_none() && self.unjudged.is_none()
    }

    /// The result for people, line by line.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let Self { id, left, steps, .. } = self;
        if let Some(reason) = &self.unjudged {
            return vec![format!("{id} cannot be checked: {reason}")];
        }
        let Some(fault) = &self.fault else {
            return vec![format!("{id} holds: {left} of {steps} steps are left")];
        };
        let step = fault.step.map(|step| format!("step {step}: ")).unwrap_or_default();
        let mut lines = vec![format!("{id} does not hold: {step}{}", fault.message)];
        for origin in &fault.origins {
            lines.push(format!("  {}: {}", origin.template, origin.what));
            lines.extend(origin.reasons.iter().map(|reason| format!("    {reason}")));
            if let Some((namespace, id)) = &origin.document {
                lines.push(format!("  document _id {} of {namespace}", shell::relaxed_value(id)));
            }
        }
        for repair in &fault.repairs {
            lines.extend(names::readable(&repair.to_string()).lines().map(|line| format!("  {line}")));
        }
        lines
    }

    /// The result for programs.
    #[must_use]
    pub fn to_document(&self) -> Document {
        let mut document = doc! {
            "plan": &self.id, "holds": self.holds(), "left": number(self.left), "steps": number(self.steps),
        };
        if let Some(reason) = &self.unjudged {
            document.insert("unjudged", reason);
        }
        if let Some(fault) = &self.fault {
            document.extend(fault.to_document());
        }
        document
    }
}

impl Fault {
    fn to_document(&self) -> Document {
        let mut document = Document::new();
        if let Some(step) = self.step {
            document.insert("step", number(step));
        }
        if let Some(action) = &self.action {
            document.insert("action", action);
        }
        document.insert("message", &self.message);
        document.insert("missing", self.missing.clone());
        document.insert("sources", self.origins.iter().map(origin).collect::<Vec<_>>());
        document.insert("repairs", self.repairs.iter().map(repaired).collect::<Vec<_>>());
        document
    }
}

fn origin(origin: &Origin) -> Bson {
    let mut entry = doc! { "what": &origin.what, "template": &origin.template };
    if !origin.reasons.is_empty() {
        entry.insert("reasons", origin.reasons.clone());
    }
    if let Some((namespace, id)) = &origin.document {
        entry.insert("namespace", namespace.to_string());
        entry.insert("document", id.clone());
    }
    entry.into()
}

/// A repair; the step that undid the condition counts from 1.
fn repaired(repair: &Repair) -> Bson {
    let spelled = |text: &String| names::readable(text);
    let all = |texts: &[String]| texts.iter().map(spelled).collect::<Vec<_>>();
    let mut document = doc! { "condition": spelled(&repair.condition) };
    if let Cause::Step { step, action } = &repair.cause {
        document.insert("undone_by", doc! { "step": number(step + 1), "action": spelled(action) });
    }
    if !repair.values.is_empty() {
        document.insert("values", all(&repair.values));
    }
    let remedies = repair.remedies.iter().map(|remedy| {
        let (action, missing) = (spelled(&remedy.action), all(&remedy.missing));
        Bson::Document(doc! { "action": action, "possible": remedy.is_possible, "missing": missing })
    });
    document.insert("remedies", remedies.collect::<Vec<_>>());
    document.into()
}

fn number(count: usize) -> Bson {
    Bson::Int64(to_i64(count))
}
