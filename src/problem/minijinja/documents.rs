//! The documents of a query, as a value of the template environment.

use std::fmt;
use std::sync::Arc;

use bson::Document;
use minijinja::Error;
use minijinja::value::{Enumerator, Object, ObjectRepr, Value};

use super::context::{Context, Tally};
use super::value::{Doc, Page};
use crate::problem::answer::{Answer, Question};
use crate::store::{Find, Namespace};

/// The documents of a query, fetched as a loop asks for them.
pub(super) struct Documents {
    context: Arc<Context>,
    namespace: Arc<Namespace>,
    asked: Selection,
    tally: Tally,
}

#[derive(Debug, Clone)]
pub(super) enum Selection {
    Find(Box<Find>),
    Pipeline(Vec<Document>),
}

impl fmt::Debug for Documents {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "documents of {}", self.namespace)
    }
}

impl Documents {
    pub(super) fn new(context: &Arc<Context>, namespace: Arc<Namespace>, asked: Selection, tally: Tally) -> Self {
        Self { context: Arc::clone(context), namespace, asked, tally }
    }

    /// The first of them.
    pub(super) fn first(&self) -> Result<Option<Value>, Error> {
        let first = self.cursor().advance()?;
        Ok(first.map(|(page, nth)| Doc::value(&page, nth, &self.context.looked)))
    }

    /// How many there are; nothing where the memory fails, which the context keeps.
    fn count(&self) -> Option<u64> {
        let count = match &self.asked {
            Selection::Find(find) if find.skip == 0 && find.limit == 0 => {
                let question = Question::Count(self.namespace.as_ref().clone(), find.filter.clone());
                match self.context.ask(question).ok()? {
                    Answer::Count(count) => count,
                    _ => return None,
                }
            }
            _ => {
                let mut cursor = self.cursor();
                while cursor.advance().ok()?.is_some() {}
                cursor.taken
            }
        };
        self.tally.reach(count);
        Some(count)
    }

    /// Goes through them from the first one.
    pub(super) fn cursor(&self) -> Cursor {
        Cursor {
            context: Arc::clone(&self.context),
            namespace: Arc::clone(&self.namespace),
            open: Some(self.asked.clone()),
            number: None,
            ready: Arc::default(),
            next: 0,
            taken: 0,
            tally: self.tally.clone(),
        }
    }
}

impl Object for Documents {
    fn repr(self: &Arc<Self>) -> ObjectRepr {
        ObjectRepr::Iterable
    }

    fn enumerate(self: &Arc<Self>) -> Enumerator {
        Enumerator::Iter(Box::new(self.cursor()))
    }

    fn enumerator_len(self: &Arc<Self>) -> Option<usize> {
        self.count().and_then(|count| usize::try_from(count).ok())
    }

    fn render(self: &Arc<Self>, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self:?}")
    }

    fn is_true(self: &Arc<Self>) -> bool {
        self.cursor().next().is_some()
    }
}

/// A way through the documents of a query.
pub(super) struct Cursor {
    context: Arc<Context>,
    namespace: Arc<Namespace>,
    /// What is to be asked at the first step.
    open: Option<Selection>,
    /// The answer that has more.
    number: Option<u64>,
    /// Documents that were fetched, and which of them comes next.
    ready: Arc<Page>,
    next: usize,
    /// How many documents were taken.
    taken: u64,
    tally: Tally,
}

impl Cursor {
    /// The next document: its page, and its place there.
    fn advance(&mut self) -> Result<Option<(Arc<Page>, usize)>, Error> {
        Ok(self.turn()?.then(|| {
            self.take(1);
            (Arc::clone(&self.ready), self.next - 1)
        }))
    }

    /// The next documents: their page, and the place of the first one there. All are taken.
    pub(super) fn advance_page(&mut self) -> Result<Option<(Arc<Page>, usize)>, Error> {
        Ok(self.turn()?.then(|| {
            let first = self.next;
            self.take(self.ready.batch.len() - first);
            (Arc::clone(&self.ready), first)
        }))
    }

    fn take(&mut self, documents: usize) {
        self.next += documents;
        self.taken += documents as u64;
        self.tally.reach(self.taken);
    }

    /// Fetches documents if there is none ready; returns whether there is one.
    fn turn(&mut self) -> Result<bool, Error> {
        if let Some(selection) = self.open.take() {
            let ns = self.namespace.as_ref().clone();
            let question = match selection {
                Selection::Find(find) => Question::Find(ns, find),
                Selection::Pipeline(pipeline) => Question::Aggregate(ns, pipeline),
            };
            if let Answer::Cursor(number) = self.context.ask(question)? {
                self.number = Some(number);
            }
        }
        if let (true, Some(number)) = (self.next == self.ready.batch.len(), self.number)
            && let Answer::Documents(documents, last) = self.context.ask(Question::Next(number))?
        {
            self.number = self.number.filter(|_| !last);
            let page = Page::new(documents, &self.namespace);
            (self.ready, self.next) = (page, 0);
        }
        Ok(self.next < self.ready.batch.len())
    }
}

impl Iterator for Cursor {
    type Item = Value;

    fn next(&mut self) -> Option<Value> {
        match self.advance() {
            Ok(document) => {
                let (page, nth) = document?;
                Some(Doc::value(&page, nth, &self.context.looked))
            }
            Err(error) => {
                self.number = None;
                Some(Value::from(error))
            }
        }
    }
}

impl Drop for Cursor {
    fn drop(&mut self) {
        if let Some(number) = self.number {
            let _ = self.context.asker.ask(Question::Close(number));
        }
    }
}
