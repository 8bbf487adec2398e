//! What the functions of one run share.

use std::cell::{Cell, RefCell};

use super::generated::Planning;
use super::job::Job;
use super::message::Sender;
use super::model::WorldModel;
use super::native::{Host, Stream};
use super::stop::Stop;
use super::subscriptions::Subscriptions;
use super::table::Table;
use crate::memory::Memory;

/// A mistake in a text that is being loaded: its line, whether it is only doubtful, the message of CLIPS.
pub(super) type Mistake = (usize, bool, String);

/// What the functions of one run share.
pub(super) struct State<'m> {
    pub(super) memory: &'m Memory,
    pub(super) job: &'m Job,
    pub(super) table: RefCell<Table>,
    pub(super) subscriptions: Subscriptions<'m>,
    pub(super) world: WorldModel,
    pub(super) planning: Planning,
    sender: &'m Sender,
    stop: Stop,
    exited: Cell<Option<i32>>,
    loading: Cell<bool>,
    mistakes: RefCell<Vec<Mistake>>,
}

impl<'m> State<'m> {
    pub(super) fn new(memory: &'m Memory, sender: &'m Sender, job: &'m Job, stop: Stop) -> Self {
        Self {
            memory,
            job,
            table: RefCell::default(),
            subscriptions: Subscriptions::default(),
            world: WorldModel::new(job.world.clone()),
            planning: Planning::default(),
            sender,
            stop,
            exited: Cell::new(None),
            loading: Cell::new(false),
            mistakes: RefCell::default(),
        }
    }

    pub(super) fn sender(&self) -> &Sender {
        self.sender
    }

    pub(super) fn stop(&self) -> &Stop {
        &self.stop
    }

    /// The code that the program called `(exit)` with.
    pub(super) fn exited(&self) -> Option<i32> {
        self.exited.get()
    }

    /// Loads something; messages of CLIPS are kept and not printed.
    pub(super) fn while_loading<T>(&self, work: impl FnOnce() -> T) -> T {
        self.loading.set(true);
        let done = work();
        self.loading.set(false);
        done
    }

    /// The mistakes found since the last call.
    pub(super) fn take_mistakes(&self) -> Vec<Mistake> {
        std::mem::take(&mut self.mistakes.borrow_mut())
    }
}

impl Host for State<'_> {
    fn write(&self, stream: Stream, bytes: &[u8]) {
        // Mistakes in a loaded text are reported with their place instead; and after (exit) CLIPS
        // prints an error that is none.
        let is_kept = self.loading.get() && stream == Stream::Err;
        if !is_kept && self.exited.get().is_none() {
            self.sender.write(stream, bytes);
        }
    }

    fn read(&self) -> Option<u8> {
        self.sender.read()
    }

    fn exit(&self, code: i32) {
        self.exited.set(Some(code));
        self.stop.exit();
    }

    fn discard(&self, handle: u64) {
        // While the table is in use nothing is collected: CLIPS is not called meanwhile.
        if let Ok(mut table) = self.table.try_borrow_mut() {
            table.remove(handle);
        }
    }

    fn parsed(&self, line: usize, doubtful: bool, text: &str) {
        if self.loading.get() {
            self.mistakes.borrow_mut().push((line, doubtful, text.to_owned()));
        }
    }
}
