//! What a command is: its name, where it runs, and what it does.

use bson::{Document, RawDocumentBuf};

use crate::memory::Memory;
use crate::serve::call::Call;
use crate::serve::client::Client;
use crate::serve::failure::Answer;
use crate::serve::host::Host;
use crate::serve::request::Request;
use crate::serve::server::Server;

/// A command.
pub(super) struct Command {
    pub(super) name: &'static str,
    pub(super) run: Run,
    /// Allowed before a login, too.
    pub(super) is_open: bool,
    /// Whether it may be a part of a transaction.
    pub(super) in_transaction: bool,
}

/// Where a command runs, and what it does.
#[derive(Clone, Copy)]
pub(super) enum Run {
    /// On the connection alone; it needs no memory.
    Here(fn(&mut Client, &Server, &Request) -> Answer),
    /// Where it reads, on the connection's own memory.
    Read(for<'h, 'm> fn(&'h mut Host<'m>, &Call) -> Answer),
    /// Where it writes, by the writer.
    Write(fn(&Memory, &Call) -> Answer),
    /// One or the other, as the first function says.
    Either(fn(&Request) -> bool, for<'h, 'm> fn(&'h mut Host<'m>, &Call) -> Answer, fn(&Memory, &Call) -> Answer),
    /// The same, but where it writes, it does so in slices that let others write in between.
    Sliced(fn(&Request) -> bool, for<'h, 'm> fn(&'h mut Host<'m>, &Call) -> Answer, fn(&Memory, &Call) -> Answer),
}

impl Command {
    pub(super) const fn here(name: &'static str, run: fn(&mut Client, &Server, &Request) -> Answer) -> Self {
        Self { name, run: Run::Here(run), is_open: false, in_transaction: false }
    }

    pub(super) const fn read(name: &'static str, run: for<'h, 'm> fn(&'h mut Host<'m>, &Call) -> Answer) -> Self {
        Self { name, run: Run::Read(run), is_open: false, in_transaction: false }
    }

    pub(super) const fn write(name: &'static str, run: fn(&Memory, &Call) -> Answer) -> Self {
        Self { name, run: Run::Write(run), is_open: false, in_transaction: false }
    }

    /// Whether a request for it writes.
    pub(super) fn is_writing(&self, request: &Request) -> bool {
        match self.run {
            Run::Here(_) | Run::Read(_) => false,
            Run::Write(_) => true,
            Run::Either(writes, ..) | Run::Sliced(writes, ..) => writes(request),
        }
    }

    /// Whether it takes a `writeConcern`: where it writes, and at the ends of transactions.
    pub(super) fn takes_write_concern(&self) -> bool {
        match self.run {
            Run::Here(_) | Run::Read(_) => matches!(self.name, "commitTransaction" | "abortTransaction"),
            Run::Write(_) | Run::Either(..) | Run::Sliced(..) => true,
        }
    }

    /// Allowed for every client.
    pub(super) const fn open(self) -> Self {
        Self { is_open: true, ..self }
    }

    /// The same, in transactions, too.
    pub(super) const fn transactional(self) -> Self {
        Self { in_transaction: true, ..self }
    }
}

/// An answer in bytes.
pub(super) fn raw(document: &Document) -> Answer {
    Ok(RawDocumentBuf::try_from(document)?)
}
