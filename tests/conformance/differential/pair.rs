//! A mongod and an embedded store that are asked the same.

use std::panic::{AssertUnwindSafe, catch_unwind};

use bson::{Bson, Document, doc};
use libtest_mimic::Failed;
use rmem::formats::shell;

use super::known;
use super::wire::Connection;
use crate::command::{Answer, Failure};
use crate::compare;
use crate::server::Server;

/// After so many writes the documents are those of the beginning again.
const WORN: usize = 6;

/// Documents, and a command that is asked of them. They are in the collection
/// `c`; others are in `o` and, for results to meet them, in `w`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Case {
    pub(super) documents: Vec<Document>,
    pub(super) others: Vec<Document>,
    pub(super) command: Document,
}

/// What came of a case.
pub(super) enum Verdict {
    /// The same; whether anything was found or changed, and whether both refused it.
    Agrees { something: bool, error: bool },
    /// The embedded store does not support it, by name.
    Refused,
    /// They differ as is known and explained.
    Known(&'static str, Box<Difference>),
    /// They differ.
    Differs(Box<Difference>),
}

/// Two answers that should be the same.
#[derive(Debug, Clone)]
pub(super) struct Difference {
    pub(super) command: Document,
    pub(super) theirs: Document,
    pub(super) ours: Result<Document, String>,
    text: String,
}

impl Difference {
    /// Whether mongod answered an error, and whether the embedded store did.
    pub(super) fn kind(&self) -> (bool, bool) {
        (is_error(&self.theirs), self.ours.as_ref().map_or(true, is_error))
    }
}

impl Case {
    /// The case and both answers, in shell syntax.
    pub(super) fn show(&self, difference: &Difference) -> String {
        let mut text = String::new();
        for (name, documents) in [("c", &self.documents), ("o", &self.others)] {
            if !documents.is_empty() {
                let array = Bson::from(documents.clone());
                text += &format!("  {name}:      {}\n", shell::relaxed_value(&array));
            }
        }
        let ours = match &difference.ours {
            Ok(answer) => shell::relaxed(answer),
            Err(message) => format!("error: {message}"),
        };
        let mut theirs = difference.theirs.clone();
        for name in ["$clusterTime", "operationTime", "ok"] {
            theirs.remove(name);
        }
        let note =
            if shell::relaxed(&theirs) == ours { format!("\n  exactly: {}", difference.text) } else { String::new() };
        let command = shell::relaxed(&self.command);
        format!("{text}  command: {command}\n  mongod:  {}\n  rmem:    {ours}{note}", shell::relaxed(&theirs))
    }
}

pub(super) struct Pair {
    mongod: Connection,
    embedded: Server,
    documents: Vec<Document>,
    /// An index of `c`.
    index: Option<Document>,
    writes: usize,
}

impl Pair {
    pub(super) fn connect(port: u16, name: &str, index: Option<Document>) -> Result<Self, Failed> {
        let mongod = Connection::open(port, &format!("differential_{name}"))?;
        Ok(Self { mongod, embedded: Server::open()?, documents: Vec::new(), index, writes: 0 })
    }

    /// Both hold these documents and no others.
    pub(super) fn reset(&mut self, documents: &[Document], others: &[Document]) -> Result<(), Failed> {
        self.embedded = Server::open()?;
        self.writes = 0;
        self.documents = documents.to_vec();
        let collections = [("c", documents), ("o", others), ("w", others)];
        let mut commands: Vec<_> = collections
            .iter()
            .map(|(name, _)| doc! { "delete": *name, "deletes": [{ "q": {}, "limit": 0 }] })
            .collect();
        let filled = collections.into_iter().filter(|(_, documents)| !documents.is_empty());
        commands.extend(filled.map(|(name, documents)| doc! { "insert": name, "documents": documents }));
        commands.extend(self.index.iter().map(|index| doc! { "createIndexes": "c", "indexes": [index.clone()] }));
        let replies = self.server(&commands)?;
        for (insert, theirs) in commands.iter().zip(&replies).skip(collections.len()) {
            let ours = self.embedded(insert, theirs);
            if is_error(theirs) || ours.as_ref().map_or(true, is_error) {
                return Err(format!("documents cannot be stored: {theirs}, {ours:?}").into());
            }
        }
        Ok(())
    }

    /// Whether enough was written that the documents should be made anew.
    pub(super) fn is_worn(&self) -> bool {
        self.writes >= WORN
    }

    /// The documents of `c` that both hold now.
    pub(super) fn documents(&self) -> &[Document] {
        &self.documents
    }

    /// Asks both, and compares the answers and what is there then.
    pub(super) fn ask(&mut self, command: &Document) -> Result<Verdict, Failed> {
        let name = command.keys().next().map_or("", String::as_str);
        let written = match name {
            "update" | "delete" => "c",
            _ if writes_results(command) => "w",
            _ => {
                let theirs = self.server(std::slice::from_ref(command))?;
                return Ok(self.compare(command, &theirs[0], command));
            }
        };
        let look = doc! { "find": written };
        let theirs = self.server(&[command.clone(), look.clone()])?;
        let mut verdict = self.compare(command, &theirs[0], command);
        // What a write has done that failed is compared, too.
        if matches!(verdict, Verdict::Agrees { .. }) {
            self.writes += 1;
            if written == "c" {
                self.documents = batch(&theirs[1]).unwrap_or_default();
            }
            let found = self.compare(&look, &theirs[1], command);
            if matches!(found, Verdict::Differs(_) | Verdict::Known(..)) {
                verdict = found;
            }
        }
        if !matches!(verdict, Verdict::Agrees { .. }) {
            self.writes = WORN;
        }
        Ok(verdict)
    }

    /// Compares the answers to a question that is asked because of a command, perhaps of itself.
    fn compare(&mut self, question: &Document, theirs: &Document, command: &Document) -> Verdict {
        let ours = self.embedded(question, theirs);
        if matches!(ours, Err(Failure::Refused(_))) {
            return Verdict::Refused;
        }
        let compared = compare::replies(question, theirs, &ours);
        let error = is_error(theirs);
        let Err(text) = compared else { return Verdict::Agrees { something: is_something(theirs), error } };
        let ours = ours.map_err(|failure| match failure {
            Failure::Refused(name) => name,
            Failure::Failed(message) => message,
        });
        let difference = Difference { command: command.clone(), theirs: theirs.clone(), ours, text };
        match known::reason(&difference) {
            Some(reason) => Verdict::Known(reason, Box::new(difference)),
            None => Verdict::Differs(Box::new(difference)),
        }
    }

    /// What mongod answers, to each of the commands.
    fn server(&mut self, commands: &[Document]) -> Result<Vec<Document>, Failed> {
        Ok(self.mongod.ask(commands)?)
    }

    /// What the embedded store answers.
    fn embedded(&mut self, command: &Document, theirs: &Document) -> Answer {
        let mut command = command.clone();
        command.insert("$db", "d");
        catch_unwind(AssertUnwindSafe(|| self.embedded.run(&command, theirs)))
            .unwrap_or_else(|_| Err(Failure::Failed("PANIC".to_owned())))
    }
}

fn writes_results(command: &Document) -> bool {
    let stages = command.get_array("pipeline").map_or(&[][..], Vec::as_slice);
    let last = stages.last().and_then(Bson::as_document);
    last.is_some_and(|stage| stage.contains_key("$out") || stage.contains_key("$merge"))
}

fn is_error(reply: &Document) -> bool {
    reply.get("ok").is_some_and(|ok| *ok == Bson::Double(0.0)) || reply.contains_key("writeErrors")
}

fn batch(reply: &Document) -> Option<Vec<Document>> {
    let batch = reply.get_document("cursor").ok()?.get_array("firstBatch").ok()?;
    Some(batch.iter().filter_map(|item| item.as_document().cloned()).collect())
}

/// Whether anything was found or changed.
fn is_something(reply: &Document) -> bool {
    let positive = |name| matches!(reply.get(name), Some(Bson::Int32(1..)));
    if let Some(found) = batch(reply) {
        return found.iter().any(|document| document.keys().any(|name| name != "_id"));
    }
    if reply.contains_key("nModified") {
        return positive("nModified") || reply.contains_key("upserted");
    }
    positive("n") || reply.get_array("values").is_ok_and(|values| !values.is_empty())
}
