//! Writes what a loop with a [`Plan`] writes, without minijinja.

use std::fmt::Write as _;
use std::sync::Arc;

use bson::{Bson, RawBsonRef, RawDocument};
use minijinja::value::{Object, ObjectRepr, Value};
use minijinja::{Error, ErrorKind, Output};

use super::context::Context;
use super::direct::{Direct, lock};
use super::documents::Documents;
use super::limits::FUEL;
use super::pieces::may_be_marked;
use super::plan::{Condition, Path, Plan, Step};
use super::value::{CLOSE, OPEN, Page, write_double};
use crate::formats::{Respelled, is_alike};
use crate::pddl::Doubtful;
use crate::problem::stream::Stream;
use crate::query::{Row, field};
use crate::store::metadata;

/// A loop that is to be written: its plan, and what it goes through.
#[derive(Debug)]
pub(super) struct Rows {
    pub(super) plan: Arc<Plan>,
    pub(super) documents: Value,
}

impl Object for Rows {
    fn repr(self: &Arc<Self>) -> ObjectRepr {
        ObjectRepr::Plain
    }
}

impl Rows {
    /// Writes all of it.
    pub(super) fn write(&self, context: &Context, direct: &Direct, out: &mut Output<'_>) -> Result<(), Error> {
        self.write_all(context, direct, out).inspect_err(|_| *lock(&context.stopped) = Some(self.plan.documents))
    }

    fn write_all(&self, context: &Context, direct: &Direct, out: &mut Output<'_>) -> Result<(), Error> {
        // The name of the function may be one of the template's own.
        let documents = self.documents.downcast_object_ref::<Documents>().ok_or_else(|| direct.doubt())?;
        let is_straight = direct.is_straight(out)?;
        let mut writer = Writer {
            row: Row::new(&self.plan.keys),
            plan: &self.plan,
            respelled: &context.looked.respelled,
            number: String::new(),
            steps: 0,
        };
        let mut cursor = documents.cursor();
        while let Some((page, from)) = cursor.advance_page()? {
            let written = match is_straight {
                true => direct.straight(|stream| writer.page(&page, from, stream)),
                false => writer.page(&page, from, &mut Collected { direct, out }),
            };
            written.map_err(|Doubtful| direct.doubt())?;
            if direct.count(std::mem::take(&mut writer.steps)) > FUEL {
                return Err(Error::from(ErrorKind::OutOfFuel));
            }
        }
        Ok(())
    }
}

/// Where the text and the values go.
trait Target {
    fn text(&mut self, text: &str) -> Result<(), Doubtful>;
    fn value(&mut self, text: &str, number: bool) -> Result<(), Doubtful>;
}

impl Target for Stream {
    fn text(&mut self, text: &str) -> Result<(), Doubtful> {
        Stream::text(self, text)
    }

    fn value(&mut self, text: &str, number: bool) -> Result<(), Doubtful> {
        Stream::value(self, text, number)
    }
}

/// Text that minijinja collects, in which marks stand for values.
struct Collected<'a, 'o> {
    direct: &'a Direct,
    out: &'a mut Output<'o>,
}

impl Target for Collected<'_, '_> {
    fn text(&mut self, text: &str) -> Result<(), Doubtful> {
        self.out.write_str(text).map_err(|_| Doubtful)
    }

    fn value(&mut self, text: &str, number: bool) -> Result<(), Doubtful> {
        self.direct.emit(text, number, false, self.out).map_err(|_| Doubtful)
    }
}

struct Writer<'p> {
    plan: &'p Plan,
    row: Row,
    respelled: &'p Respelled,
    /// A number as text.
    number: String,
    /// How many steps minijinja would have made, at least.
    steps: u64,
}

impl Writer<'_> {
    /// The documents of a page from one of them on.
    fn page(&mut self, page: &Page, from: usize, target: &mut impl Target) -> Result<(), Doubtful> {
        for nth in from..page.batch.len() {
            let document = page.batch.get(nth);
            self.row.read(document);
            self.steps += 2;
            self.steps(&self.plan.steps, document, target)?;
        }
        Ok(())
    }

    fn steps(&mut self, steps: &[Step], document: &RawDocument, target: &mut impl Target) -> Result<(), Doubtful> {
        for step in steps {
            match step {
                Step::Text(text) => {
                    self.steps += 1;
                    target.text(text)?;
                }
                Step::Value(path) => {
                    self.steps += 3;
                    let value = self.value(path, document)?;
                    self.emit(value, target)?;
                }
                Step::Choice(ways, others) => {
                    let mut chosen = others;
                    for (condition, steps) in ways {
                        if self.holds(condition, document)? {
                            chosen = steps;
                            break;
                        }
                    }
                    self.steps(chosen, document, target)?;
                }
            }
        }
        Ok(())
    }

    fn value<'d>(&self, path: &Path, document: &'d RawDocument) -> Result<RawBsonRef<'d>, Doubtful> {
        let found = self.row.get(path.key, document);
        let mut value = found.or_else(|| self.alike(document, self.plan.keys.get(path.key)?, true)).ok_or(Doubtful)?;
        for name in &path.inner {
            let RawBsonRef::Document(inner) = value else { return Err(Doubtful) };
            value = field(inner, name).or_else(|| self.alike(inner, name, false)).ok_or(Doubtful)?;
        }
        match value {
            // What a text may not hold is an error wherever it is looked at.
            RawBsonRef::String(text) | RawBsonRef::Symbol(text)
                if may_be_marked(text) && text.contains([OPEN, CLOSE]) =>
            {
                Err(Doubtful)
            }
            value => Ok(value),
        }
    }

    /// The value of a key that differs from this one only in hyphens and underscores.
    fn alike<'d>(&self, document: &'d RawDocument, key: &str, is_whole: bool) -> Option<RawBsonRef<'d>> {
        let mut entries = document.iter().filter_map(Result::ok);
        let is_it = |name: &str| is_alike(name, key) && !(is_whole && name == metadata::INFO);
        let (found, value) = entries.find(|(name, _)| is_it(name.as_str()))?;
        self.respelled.add(key, found.as_str());
        Some(value)
    }

    fn holds(&mut self, condition: &Condition, document: &RawDocument) -> Result<bool, Doubtful> {
        self.steps += 1;
        match condition {
            Condition::Holds(path) => is_true(self.value(path, document)?),
            Condition::Equals(path, text) => Ok(match self.value(path, document)? {
                RawBsonRef::String(value) | RawBsonRef::Symbol(value) => value == text,
                other => is_known(other).then_some(false).ok_or(Doubtful)?,
            }),
            Condition::Not(inner) => self.holds(inner, document).map(|holds| !holds),
            Condition::All(parts) => {
                for part in parts {
                    if !self.holds(part, document)? {
                        return Ok(false);
                    }
                }
                Ok(true)
            }
            Condition::Any(parts) => {
                for part in parts {
                    if self.holds(part, document)? {
                        return Ok(true);
                    }
                }
                Ok(false)
            }
        }
    }

    /// Writes a value, as [`Context::emit`] does. What has no name in PDDL is an error, which minijinja explains.
    fn emit(&mut self, value: RawBsonRef<'_>, target: &mut impl Target) -> Result<(), Doubtful> {
        self.number.clear();
        let number = &mut self.number;
        let written = match value {
            RawBsonRef::String(text) | RawBsonRef::Symbol(text) => return target.value(text, false),
            RawBsonRef::Boolean(flag) => return target.value(if flag { "true" } else { "false" }, false),
            RawBsonRef::ObjectId(id) => return target.value(&id.to_hex(), false),
            RawBsonRef::Int32(value) => write!(number, "{value}"),
            RawBsonRef::Int64(value) => write!(number, "{value}"),
            RawBsonRef::Double(value) if value.is_finite() => write_double(number, value),
            _ => return Err(Doubtful),
        };
        written.map_err(|_| Doubtful)?;
        target.value(&self.number, true)
    }
}

/// Whether minijinja takes a value for true.
fn is_true(value: RawBsonRef<'_>) -> Result<bool, Doubtful> {
    Ok(match value {
        RawBsonRef::Boolean(flag) => flag,
        RawBsonRef::Int32(number) => number != 0,
        RawBsonRef::Int64(number) => number != 0,
        RawBsonRef::Double(number) => number != 0.0,
        RawBsonRef::String(text) | RawBsonRef::Symbol(text) => !text.is_empty(),
        RawBsonRef::Null => false,
        RawBsonRef::Document(inner) => inner.iter().any(|entry| entry.is_ok()),
        RawBsonRef::Array(inner) => inner.into_iter().any(|element| element.is_ok()),
        other => return is_known(other).then_some(true).ok_or(Doubtful),
    })
}

/// Whether the value is one that templates can look at.
fn is_known(value: RawBsonRef<'_>) -> bool {
    match value {
        RawBsonRef::Document(_) | RawBsonRef::Array(_) => true,
        other => Bson::try_from(other).is_ok(),
    }
}
