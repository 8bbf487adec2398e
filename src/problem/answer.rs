//! How a template asks the memory.
//!
//! minijinja's functions must be free of borrows and thread-safe, a memory is
//! neither. So the template is rendered in a thread of its own that sends each
//! question to the thread that has the memory, and waits for the answer.

use std::collections::HashMap;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Mutex, PoisonError};

use bson::{Bson, Document};

use super::batch::Batch;
use crate::memory::Memory;
use crate::store::{Documents, Find, Namespace, StoreError};

/// How many documents the first part of an answer holds at most: few, since it may be all that is wanted.
const FIRST: usize = 256;
/// How many the others hold at most, and how many bytes until they are complete: enough to make the way between the
/// threads cheap.
const BATCH: usize = 2048;
const BATCH_SIZE: usize = 1 << 20;

/// A question to the memory.
pub(super) enum Question {
    Find(Namespace, Box<Find>),
    Aggregate(Namespace, Vec<Document>),
    /// More of the answer with this number.
    Next(u64),
    /// No more of it.
    Close(u64),
    /// The rendering is over.
    End,
    Count(Namespace, Document),
    Distinct(Namespace, String, Document),
}

/// What the memory says.
pub(super) enum Answer {
    /// The number of an answer that is fetched by [`Question::Next`].
    Cursor(u64),
    /// Some documents, and whether they are the last.
    Documents(Batch, bool),
    Count(u64),
    Values(Vec<Bson>),
    Closed,
    Failed(StoreError),
}

/// The asking side.
#[derive(Debug)]
pub(super) struct Asker {
    channel: Mutex<(Sender<Question>, Receiver<Answer>)>,
}

impl Asker {
    /// Says that nothing more will be asked.
    pub(super) fn end(&self) {
        let channel = self.channel.lock().unwrap_or_else(PoisonError::into_inner);
        let _ = channel.0.send(Question::End);
    }

    /// Asks, and waits for the answer; `None` if the other thread has ended.
    pub(super) fn ask(&self, question: Question) -> Option<Answer> {
        let channel = self.channel.lock().unwrap_or_else(PoisonError::into_inner);
        channel.0.send(question).ok()?;
        channel.1.recv().ok()
    }
}

/// The answering side.
pub(super) struct Answerer {
    questions: Receiver<Question>,
    answers: Sender<Answer>,
}

/// Both sides.
pub(super) fn pair() -> (Asker, Answerer) {
    let (question_sender, questions) = channel();
    let (answers, answer_receiver) = channel();
    (Asker { channel: Mutex::new((question_sender, answer_receiver)) }, Answerer { questions, answers })
}

impl Answerer {
    /// Answers until there are no more queries. While a full part of an answer is used, the next one
    /// is fetched.
    pub(super) fn serve(self, memory: &Memory) {
        let mut cursors: HashMap<u64, Open<'_>> = HashMap::new();
        let mut opened = 0;
        for question in &self.questions {
            let answer = match question {
                Question::End => break,
                Question::Find(ns, find) => memory.find_to_hide(&ns, &find).map(|(documents, has_hidden)| {
                    keep(Open { documents, has_hidden, given: 0, ready: None }, &mut cursors, &mut opened)
                }),
                Question::Aggregate(ns, pipeline) => memory.aggregate_reading(&ns, &pipeline).map(|documents| {
                    keep(Open { documents, has_hidden: false, given: 0, ready: None }, &mut cursors, &mut opened)
                }),
                Question::Next(number) => {
                    let answer = cursors.get_mut(&number).map(Open::next);
                    let answer = answer.unwrap_or_else(|| Answer::Documents(Batch::default(), true));
                    if !matches!(answer, Answer::Documents(_, false)) {
                        cursors.remove(&number);
                    }
                    if self.answers.send(answer).is_err() {
                        break;
                    }
                    cursors.get_mut(&number).into_iter().for_each(Open::fetch);
                    continue;
                }
                Question::Close(number) => {
                    cursors.remove(&number);
                    Ok(Answer::Closed)
                }
                Question::Count(ns, filter) => memory.count(&ns, &filter).map(Answer::Count),
                Question::Distinct(ns, field, filter) => memory.distinct(&ns, &field, &filter).map(Answer::Values),
            };
            if self.answers.send(answer.unwrap_or_else(Answer::Failed)).is_err() {
                break;
            }
        }
    }
}

/// An answer that is under way.
struct Open<'a> {
    documents: Documents<'a>,
    /// Whether they have metadata that is not for the template: it is passed over where they are read.
    has_hidden: bool,
    /// How many parts of it were given.
    given: usize,
    /// The next part of it, if it was fetched already.
    ready: Option<Answer>,
}

impl Open<'_> {
    /// The next part.
    fn next(&mut self) -> Answer {
        self.given += 1;
        self.ready.take().unwrap_or_else(|| self.part())
    }

    /// Fetches the next part before it is asked for, unless the first may be all that is wanted.
    fn fetch(&mut self) {
        if self.given > 1 {
            self.ready = Some(self.part());
        }
    }

    fn part(&mut self) -> Answer {
        let (most, bytes) = if self.given > 1 { (BATCH, BATCH_SIZE / 4) } else { (FIRST, 0) };
        let mut documents = Batch::with_capacity(most, bytes).hiding(self.has_hidden);
        while documents.len() < most && documents.size() < BATCH_SIZE {
            match self.documents.next() {
                Some(Ok(document)) => documents.push(&document),
                Some(Err(error)) => return Answer::Failed(error),
                None => return Answer::Documents(documents, true),
            }
        }
        Answer::Documents(documents, false)
    }
}

fn keep<'a>(open: Open<'a>, cursors: &mut HashMap<u64, Open<'a>>, opened: &mut u64) -> Answer {
    *opened += 1;
    cursors.insert(*opened, open);
    Answer::Cursor(*opened)
}
