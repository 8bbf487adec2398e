//! What is behind an atom of a generated problem, for `gen-problem --explain`.

use bson::{Bson, Document, doc};

use super::{Context, WrongInput};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::pddl::{Dialect, read_problem};
use crate::formats::shell;
use crate::memory::Memory;
use crate::problem::{Explanation, Generated, Part, SectionReport, names};
use crate::store::{Find, Namespace};

/// Prints where an atom comes from: the template's line, the query, and the document.
pub(super) fn print(
    atom: &str,
    generated: &Generated,
    dialect: Dialect,
    memory: &Memory,
    context: &mut Context<'_>,
) -> Result<Exit> {
    let tree = read_problem(&generated.source(), dialect)
        .map_err(|error| generated.explain(vec![error.clone()]).into_iter().next().unwrap_or(error))?;
    let found = generated.explain_atom(&tree, atom);
    if found.is_empty() {
        return missing(atom, generated, context);
    }
    for explanation in &found {
        for line in lines(explanation, generated, memory)? {
            context.output.line(&line)?;
        }
    }
    Ok(Exit::Done)
}

fn missing(atom: &str, generated: &Generated, context: &mut Context<'_>) -> Result<Exit> {
    let name = atom.split(|c: char| c.is_whitespace() || "()".contains(c)).find(|word| !word.is_empty());
    let name = name.ok_or_else(|| WrongInput::new("expected an atom like `(on A B)`, or an object"))?;
    context.output.error(&format!("`{atom}` is not in the problem"));
    if name.parse::<f64>().is_ok() {
        return Ok(Exit::No);
    }
    let writers = generated.writers(name);
    if writers.is_empty() {
        context.output.note(&format!("no line of {} writes `({name} …)`", generated.template().name()));
    }
    for writer in writers {
        let place = format!("{}:{}", writer.name, writer.line);
        context.output.note(&format!("{place}: would be written by {}", writer.text));
        writer.reasons().iter().for_each(|reason| context.output.note(&format!("  {reason}")));
    }
    Ok(Exit::No)
}

fn lines(explanation: &Explanation, generated: &Generated, memory: &Memory) -> Result<Vec<String>> {
    let Explanation { part, text, line, origin, documents } = explanation;
    let part = match part {
        Part::Objects => "an object",
        Part::Init => "in the initial state",
        Part::Goal => "in the goal",
    };
    let place = format!("{}:{}:{}", origin.name, origin.line, origin.column);
    let mut lines = vec![
        format!("{}: {part}, line {line} of the problem", names::readable(text)),
        format!("  {place}: {}", origin.written),
    ];
    let mut sentences: Vec<String> = Vec::new();
    let mut note = |section: Option<&SectionReport>, lines: &mut Vec<String>| {
        let sentence = section.map(|section| format!("  {}", section.sentence()));
        if let Some(sentence) = sentence.filter(|sentence| !sentences.contains(sentence)) {
            lines.push(sentence.clone());
            sentences.push(sentence);
        }
    };
    if documents.is_empty() {
        note(asked(explanation, None, generated, memory)?.map(|(section, _)| section), &mut lines);
    }
    for (index, (namespace, id)) in documents.iter().enumerate() {
        let section = asked(explanation, Some((namespace, id)), generated, memory)?;
        // A call in the text, like `find_one`, is not among the queries of sections.
        note(section.filter(|(_, is_sure)| *is_sure || index == 0).map(|(section, _)| section), &mut lines);
        let document = document(namespace, id, memory)?;
        lines.push(match document {
            Some(document) => format!("  {} in {namespace}", shell::relaxed(&document)),
            None => format!("  _id {} in {namespace}", shell::relaxed_value(id)),
        });
    }
    Ok(lines)
}

/// The query whose answer was written there, and whether that is sure: that of the section, else the last one before that
/// has the document in its answer.
fn asked<'g>(
    explanation: &Explanation,
    document: Option<(&Namespace, &Bson)>,
    generated: &'g Generated,
    memory: &Memory,
) -> Result<Option<(&'g SectionReport, bool)>> {
    let is_value = ["{{", "<<"].iter().any(|mark| explanation.origin.written.contains(mark));
    let part = Some(&explanation.origin.name).filter(|name| *name != generated.template().name());
    // What a template is included by asks before it.
    let is_before = |section: &SectionReport| match section.part.as_ref() == part {
        true => section.line <= explanation.origin.line,
        false => section.part.is_none(),
    };
    let mut before: Vec<&SectionReport> =
        generated.sections.iter().filter(|section| is_value && is_before(section)).collect();
    before.sort_by_key(|section| std::cmp::Reverse(section.line));
    let Some((namespace, id)) = document else {
        // What no document is behind comes from distinct values, or from no query at all.
        return Ok(before
            .into_iter()
            .find(|section| section.query.contains_key("distinct"))
            .map(|section| (section, true)));
    };
    if let Some(section) = generated.section_of(&explanation.origin) {
        return Ok(Some((section, true)));
    }
    before.retain(|section| section.namespace == *namespace);
    for section in &before {
        let is_filter = !section.query.contains_key("pipeline") && !section.query.contains_key("distinct");
        let filter = doc! { "$and": [section.query.clone(), { "_id": id.clone() }] };
        if is_filter && memory.count(namespace, &filter).unwrap_or_default() > 0 {
            return Ok(Some((section, true)));
        }
    }
    Ok(before.into_iter().next().map(|section| (section, false)))
}

fn document(namespace: &Namespace, id: &Bson, memory: &Memory) -> Result<Option<Document>> {
    let find = Find { filter: doc! { "_id": id.clone() }, limit: 1, ..Find::default() };
    let found = memory.find(namespace, &find)?.next().transpose()?;
    Ok(found.map(|document| Document::try_from(&*document)).transpose()?)
}
