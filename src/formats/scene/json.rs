//! Scenes as JSON, with objects as they are in documents: `{"frame": F, "objects": [{"name": …}]}`; and
//! operations, one JSON object a line, or all in one array.

use bson::Document;
use serde::Deserialize;
use serde_json::value::RawValue;

use super::{Color, Content, Kind, Limits, Mass, Model, Object, Operation, Scene, Spelling, document};
use crate::formats::{Diagnostic, Source, Span, plain};

/// rmem's own.
pub const SPELLING: Spelling = Spelling {
    name: "json",
    limits: Limits {
        kinds: &[Kind::Box, Kind::Sphere, Kind::Cylinder, Kind::Cone, Kind::Plane, Kind::MeshFile, Kind::Triangles],
        name: true,
        frame: true,
        framed: false,
        color: Color::Shape,
        mass: Mass::All,
        fixed: true,
        attachment: true,
        subframes: true,
        model: Model::Beside,
        empty: true,
        grouped: false,
    },
    fits: |_| Ok(()),
    write,
    read,
    recognizes: |text| is_nothing(text) || text.trim_start_matches('\u{feff}').trim_start().starts_with(['{', '[']),
};

/// Whether a text is what `scene diff` prints of equal scenes: no operations, as lines or as one array.
fn is_nothing(text: &str) -> bool {
    let text = text.trim_start_matches('\u{feff}').trim();
    text.is_empty()
        || text.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).is_some_and(|rest| rest.trim().is_empty())
}

fn write(scene: &Scene) -> String {
    let mut text = String::from("{");
    for (key, value) in [("scene", &scene.name), ("frame", &scene.frame)] {
        if let Some(value) = value {
            text.push_str(&format!("\n  \"{key}\": {},", serde_json::Value::from(value.as_str())));
        }
    }
    text.push_str("\n  \"objects\": [");
    for (index, object) in scene.objects.iter().enumerate() {
        text.push_str(if index == 0 { "\n    " } else { ",\n    " });
        text.push_str(&line(&entry(object, scene.frame.as_deref())));
    }
    text.push_str(if scene.objects.is_empty() { "]\n}\n" } else { "\n  ]\n}\n" });
    text
}

/// A document of an object with its name and frame.
#[must_use]
pub fn entry(object: &Object, frame: Option<&str>) -> Document {
    let mut entry = bson::doc! { "name": &object.name };
    entry.extend(frame.map(|frame| ("frame".to_owned(), frame.into())));
    entry.extend(document::write(object));
    entry
}

/// A document as a line of JSON.
#[must_use]
pub fn line(document: &Document) -> String {
    // Documents of numbers, texts and lists of these have a text.
    serde_json::to_string(&document).unwrap_or_default()
}

/// Lines of JSON as one array.
#[must_use]
pub fn array(lines: &[String]) -> String {
    if lines.is_empty() { "[]".to_owned() } else { format!("[\n  {}\n]", lines.join(",\n  ")) }
}

/// A scene as it is written; objects are read one by one, each with its place.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written<'a> {
    scene: Option<String>,
    frame: Option<String>,
    #[serde(borrow)]
    objects: Vec<&'a RawValue>,
}

fn read(source: &Source) -> Result<Content, Diagnostic> {
    let text = source.text().trim_start_matches('\u{feff}');
    if is_nothing(text) {
        return Ok(Content::Operations(Vec::new(), None));
    }
    let mark = source.text().len() - text.len();
    if text.trim_start().starts_with('[') {
        let all: Vec<&RawValue> = serde_json::from_str(text).map_err(|error| place(source, mark, text, &error))?;
        return operations(source, all.into_iter().map(|raw| Ok(raw.get())));
    }
    let first = serde_json::Deserializer::from_str(text).into_iter::<Document>().next();
    if let Some(Ok(first)) = &first
        && first.contains_key("operation")
    {
        return operations(source, objects(source, text));
    }
    let written: Written<'_> = serde_json::from_str(text).map_err(|error| place(source, mark, text, &error))?;
    let mut scene = Scene { name: written.scene, frame: written.frame, ..Scene::default() };
    for raw in written.objects {
        scene.objects.push(object(source, raw, &mut scene.frame)?);
    }
    Ok(Content::Scene(scene))
}

fn object(source: &Source, raw: &RawValue, frame: &mut Option<String>) -> Result<Object, Diagnostic> {
    let start = raw.get().as_ptr() as usize - source.text().as_ptr() as usize;
    let read: Document = serde_json::from_str(raw.get()).map_err(|error| place(source, start, raw.get(), &error))?;
    let wrong = |message: String| Diagnostic::new(source, Span::new(start, start + raw.get().len()), message);
    let name = read.get_str("name").map_err(|_| wrong("an object without a `name`".to_owned()))?.to_owned();
    let known = |key: &&String| document::KEYS.contains(&key.as_str()) || ["name", "frame"].contains(&key.as_str());
    if let Some(unknown) = read.keys().find(|key| !known(key)) {
        return Err(wrong(format!(
            "`{name}` has the unknown key `{unknown}`; expected name, frame, {}",
            document::KEYS.join(", ")
        )));
    }
    stay(frame, &read).map_err(wrong)?;
    let object = document::read(&read).map_err(|words| wrong(format!("`{name}` cannot be read: {words}")))?;
    Ok(Object { name, ..object })
}

/// Notes the frame of an object or operation; all have to be in one.
fn stay(frame: &mut Option<String>, read: &Document) -> Result<(), String> {
    match (read.get_str("frame").ok(), &*frame) {
        (Some(own), Some(known)) if own != known => {
            return Err(format!("the frame `{own}` here, and `{known}` before; expected one frame"));
        }
        (Some(own), None) => *frame = Some(own.to_owned()),
        _ => {}
    }
    Ok(())
}

/// The objects of a text, one after another.
fn objects<'a>(source: &'a Source, text: &'a str) -> impl Iterator<Item = Result<&'a str, Diagnostic>> + 'a {
    let mark = source.text().len() - text.len();
    let read = serde_json::Deserializer::from_str(text).into_iter::<&RawValue>();
    read.map(move |raw| raw.map(RawValue::get).map_err(|error| place(source, mark, text, &error)))
}

/// The operations in some parts of a text, in their order.
fn operations<'a>(
    source: &Source,
    parts: impl Iterator<Item = Result<&'a str, Diagnostic>>,
) -> Result<Content, Diagnostic> {
    let (mut operations, mut frame) = (Vec::new(), None);
    for part in parts {
        let part = part?;
        let start = part.as_ptr() as usize - source.text().as_ptr() as usize;
        let read: Document = serde_json::from_str(part).map_err(|error| place(source, start, part, &error))?;
        let wrong = |message| Diagnostic::new(source, Span::new(start, start + part.len()), message);
        operations.push(Operation::read(&read).map_err(wrong)?);
        stay(&mut frame, &read).map_err(wrong)?;
    }
    Ok(Content::Operations(operations, frame))
}

/// A complaint of the JSON reader about a part of the text.
pub(super) fn place(source: &Source, start: usize, part: &str, error: &serde_json::Error) -> Diagnostic {
    let before: usize = part.split_inclusive('\n').take(error.line().saturating_sub(1)).map(str::len).sum();
    let at = (before + error.column().saturating_sub(1)).min(part.len());
    let message = error.to_string();
    let message = message.rsplit_once(" at line ").map_or(message.as_str(), |(message, _)| message);
    Diagnostic::new(source, Span::at(start + at), plain::kinds(message, "object"))
}
