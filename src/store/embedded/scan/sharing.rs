//! What a scan shares with a second thread, which reads every other stretch of it, and where the stretches meet.

use super::found::Page;
use crate::store::StoreError;
use crate::store::embedded::ahead::{Ahead, Turn};

/// How many documents are looked at before a scan is a long one, and how many have to be left to be worth a thread: opening
/// the file again takes about as long as reading a thousand.
pub(super) const LONG: usize = 8_192;

/// The second thread of a scan, and the ends of the stretch that is read.
pub(super) struct Sharing {
    second: Second,
    /// Whether the scan is cut into stretches, or is one of them.
    is_part: bool,
    /// The first position that was found in this stretch, or behind it.
    first: Option<i64>,
    /// The first position that was found behind the stretch before.
    next: Option<i64>,
}

/// Whether a second thread reads a part of what is to be read.
enum Second {
    Never,
    /// Once the scan has turned out to be a long one.
    WhereLong {
        /// Whether the matches are only counted.
        is_counted: bool,
    },
    Reads(Ahead<Result<Page, StoreError>>),
}

impl Sharing {
    fn new(second: Second, is_part: bool) -> Self {
        Self { second, is_part, first: None, next: None }
    }

    /// Of a scan that one thread reads.
    pub(super) fn never() -> Self {
        Self::new(Second::Never, false)
    }

    /// Of a scan that a second thread may help with once it has turned out to be a long one.
    pub(super) fn where_long(is_counted: bool) -> Self {
        Self::new(Second::WhereLong { is_counted }, false)
    }

    /// Of a scan of which a second thread reads every other stretch.
    pub(super) fn with(ahead: Ahead<Result<Page, StoreError>>) -> Self {
        Self::new(Second::Reads(ahead), true)
    }

    /// Of one stretch, as the second thread reads it.
    pub(super) fn stretch() -> Self {
        Self::new(Second::Never, true)
    }

    /// Whether the matches are only counted, where a second thread is started once the scan is a long one.
    pub(super) fn is_counted_where_long(&self) -> Option<bool> {
        match self.second {
            Second::WhereLong { is_counted } => Some(is_counted),
            Second::Never | Second::Reads(_) => None,
        }
    }

    /// Whether the scan is cut into stretches, or is one of them.
    pub(super) fn is_part(&self) -> bool {
        self.is_part
    }

    /// The second thread, where there is one.
    pub(super) fn ahead(&self) -> Option<&Ahead<Result<Page, StoreError>>> {
        match &self.second {
            Second::Reads(ahead) => Some(ahead),
            Second::Never | Second::WhereLong { .. } => None,
        }
    }

    /// Goes on to the next stretch.
    pub(super) fn turn(&mut self) -> Turn {
        let Second::Reads(ahead) = &mut self.second else { return Turn::Over };
        let turn = ahead.turn();
        if let Turn::Own(..) = turn {
            self.first = None;
        }
        turn
    }

    /// Notes a position that was found in a stretch, or behind it; returns whether it is the first one.
    pub(super) fn arrive(&mut self, position: i64) -> bool {
        let is_first = self.first.is_none();
        self.first.get_or_insert(position);
        is_first
    }

    /// Notes the first position that was found behind a stretch, where there was one.
    pub(super) fn leave(&mut self, next: Option<i64>) {
        self.next = next;
    }

    /// Whether a stretch that begins at a position begins where the one before it ended.
    pub(super) fn is_joined(&mut self, first: i64) -> bool {
        self.next.take().is_none_or(|next| next <= first)
    }

    /// The first positions that were found in this stretch and behind it.
    pub(super) fn ends(&self) -> (Option<i64>, Option<i64>) {
        (self.first, self.next)
    }
}
