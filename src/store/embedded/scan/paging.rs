//! Reading a scan page by page: the first one is small, for callers that want the first match only.

use std::collections::VecDeque;

use bson::RawDocument;

use super::found::PAGE_DOCUMENTS;
use super::limit::check_ending;
use super::sharing::Sharing;
use super::{Found, More, Rest, Scan};
use crate::store::StoreError;
use crate::store::embedded::failure;
use crate::store::embedded::page::PageError;

/// The most bytes of documents in a page.
const PAGE_BYTES: usize = 256 << 10;

impl Scan<'_> {
    /// Gives back the page that was read and not taken, so that it is read again.
    pub(in crate::store::embedded) fn unread(&mut self) {
        let positions: Vec<i64> = self.page.drain(..).map(|found| found.position).collect();
        let Some(first) = positions.first().copied() else { return };
        match &mut self.rest {
            Rest::Between(behind, _) => *behind = first - 1,
            Rest::At(rest) => positions.into_iter().rev().for_each(|position| rest.push_front(position)),
            rest @ (Rest::Nothing | Rest::Listed(_) | Rest::Ahead) => *rest = Rest::At(positions.into()),
        }
    }

    /// Reads the first page now.
    pub(in crate::store::embedded) fn begun(mut self) -> Result<Self, StoreError> {
        if !matches!(self.rest, Rest::Nothing) {
            self.turn()?;
        }
        Ok(self)
    }

    /// How many documents match.
    pub(in crate::store::embedded) fn count(mut self) -> Result<u64, StoreError> {
        self.sharing = Sharing::where_long(true);
        let mut count = 0;
        while !matches!(self.rest, Rest::Nothing) {
            count += self.counted()?;
        }
        self.check_whole()?;
        Ok(count)
    }

    /// Checks at the end whether all documents were there to be looked at, which nothing of what was read tells.
    fn check_whole(&mut self) -> Result<(), StoreError> {
        match std::mem::take(&mut self.is_whole) {
            true => self.store.check_count(self.collection),
            false => Ok(()),
        }
    }

    /// How many documents of the next page match.
    pub(super) fn counted(&mut self) -> Result<u64, StoreError> {
        if matches!(self.rest, Rest::Ahead) {
            return Ok(self.take_page()?.number);
        }
        let mut count = 0;
        self.read(&mut |_, _| {
            count += 1;
            true
        })?;
        Ok(count)
    }

    /// Reads the next page: small at first, for callers that want the first match
    /// only, then larger.
    pub(super) fn turn(&mut self) -> Result<(), StoreError> {
        if matches!(self.rest, Rest::Ahead) {
            self.page = self.take_page()?.found;
            return Ok(());
        }
        let (most, mut page, mut bytes) = (self.page_documents, VecDeque::new(), 0);
        let read = self.read(&mut |position, body| {
            bytes += body.as_bytes().len();
            page.push_back(Found { position, body: body.to_owned() });
            page.len() < most && bytes < PAGE_BYTES
        });
        self.page = page;
        self.page_documents = (most * 4).min(PAGE_DOCUMENTS);
        read
    }

    /// Shows matching documents to `take` until it has no room, or enough have been looked at.
    fn read(&mut self, take: &mut dyn FnMut(i64, &RawDocument) -> More) -> Result<(), StoreError> {
        self.store.check_time()?;
        self.share();
        let was_listed = matches!(self.rest, Rest::Listed(_));
        let read = match std::mem::replace(&mut self.rest, Rest::Nothing) {
            Rest::Between(position, last) => self.read_between(position, last, take),
            Rest::At(positions) => self.read_at(positions, take),
            Rest::Listed(listing) => self.read_listed(listing, take),
            rest @ (Rest::Ahead | Rest::Nothing) => Ok(rest),
        };
        self.rest = match read {
            Err(PageError::Store(error)) if failure::is_gone(&error) => {
                // A collection that another process dropped has no documents.
                if was_listed && self.collection.is_there(&self.store.connection).map_err(|e| self.store.explain(&e))? {
                    return Err(self.store.fail("an index was dropped while it was read; repeat the query"));
                }
                Rest::Nothing
            }
            Err(PageError::Store(error)) => return Err(self.store.explain(&error)),
            Err(PageError::Query(error)) => return Err(error.into()),
            Err(PageError::Damaged(damage, id)) => {
                return Err(self.store.damaged(self.collection, id.as_deref(), damage));
            }
            Ok(Rest::Nothing) => self.next_stretch(),
            Ok(rest) => rest,
        };
        Ok(())
    }
}

impl Iterator for Scan<'_> {
    type Item = Result<Found, StoreError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Err(error) = check_ending() {
                (self.rest, self.page) = (Rest::Nothing, VecDeque::new());
                return Some(Err(error.into()));
            }
            if let Some(found) = self.page.pop_front() {
                return Some(Ok(found));
            }
            if matches!(self.rest, Rest::Nothing) {
                let failure = self.failure.take();
                return failure.or_else(|| self.check_whole().err()).map(Err);
            }
            match self.turn() {
                Err(error) if self.is_up_to_failure && error.is_of_document() => self.failure = Some(error),
                Err(error) => {
                    self.page.clear();
                    return Some(Err(error));
                }
                Ok(()) => {}
            }
        }
    }
}
