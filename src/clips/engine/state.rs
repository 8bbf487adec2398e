//! What the functions of one run share.

use std::cell::{Cell, RefCell};

use super::generated::Planning;
use super::job::Job;
use super::message::Sender;
use super::model::WorldModel;
use super::native::{Host, Stream};
use super::search_path::SearchPath;
use super::stop::Stop;
use super::subscriptions::Subscriptions;
use super::table::Table;
use super::trace::Trace;
use super::wm_facts::WmFacts;
use crate::memory::Memory;
use crate::store::Namespace;

/// What CLIPS says of a text that is being loaded.
pub(super) struct LoadMessage {
    /// The line of the text.
    pub(super) line: usize,
    /// Whether it is a warning, and no error.
    pub(super) is_warning: bool,
    pub(super) text: String,
}

/// Where Fawkes has its mutexes.
const MUTEXES: &str = "robmem_coordination.mutex";

/// What the functions of one run share.
pub(super) struct State<'m> {
    pub(super) memory: &'m Memory,
    pub(super) job: &'m Job,
    pub(super) table: RefCell<Table>,
    pub(super) subscriptions: Subscriptions<'m>,
    pub(super) world: WorldModel,
    pub(super) wm_facts: WmFacts,
    pub(super) planning: Planning,
    pub(super) search: SearchPath,
    sender: &'m Sender,
    stop: Stop,
    exited: Cell<Option<i32>>,
    loading: Cell<bool>,
    load_messages: RefCell<Vec<LoadMessage>>,
    /// What a command complains about, while one is run.
    complaints: RefCell<Option<Vec<u8>>>,
    /// Where mutexes are.
    mutexes: RefCell<Namespace>,
    trace: Trace,
}

impl<'m> State<'m> {
    pub(super) fn new(memory: &'m Memory, sender: &'m Sender, job: &'m Job, stop: Stop) -> Self {
        Self {
            memory,
            job,
            table: RefCell::default(),
            subscriptions: Subscriptions::default(),
            world: WorldModel::new(job.world.clone()),
            wm_facts: WmFacts::default(),
            planning: Planning::default(),
            search: SearchPath::new(&job.folders),
            sender,
            stop,
            exited: Cell::new(None),
            loading: Cell::new(false),
            load_messages: RefCell::default(),
            complaints: RefCell::default(),
            mutexes: RefCell::new(job.mutexes.clone()),
            trace: Trace::default(),
        }
    }

    /// Where mutexes are: a program that follows those of Fawkes has them there.
    pub(super) fn mutexes(&self) -> Namespace {
        self.mutexes.borrow().clone()
    }

    /// Notes which collection a program follows.
    pub(super) fn follows(&self, namespace: &Namespace) {
        if namespace.to_string() == MUTEXES {
            self.mutexes.replace(namespace.clone());
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
        let before = self.loading.replace(true);
        let done = work();
        self.loading.set(before);
        done
    }

    /// Whether constructs are being loaded.
    pub(super) fn is_loading(&self) -> bool {
        self.loading.get()
    }

    /// Runs a command; returns also what CLIPS printed on stderr meanwhile, which is not printed.
    pub(super) fn while_commanding<T>(&self, work: impl FnOnce() -> T) -> (T, String) {
        // A command may load a file, which has commands of its own.
        let before = self.complaints.replace(Some(Vec::new()));
        let done = work();
        let complaints = self.complaints.replace(before).unwrap_or_default();
        (done, String::from_utf8_lossy(&complaints).into_owned())
    }

    /// Prints what is left of a trace.
    pub(super) fn finish(&self) {
        let rest = self.trace.finish();
        if !rest.is_empty() {
            self.sender.write(Stream::Err, &rest);
        }
    }

    /// What CLIPS has said of the loaded text since the last call.
    pub(super) fn take_load_messages(&self) -> Vec<LoadMessage> {
        std::mem::take(&mut self.load_messages.borrow_mut())
    }
}

impl Host for State<'_> {
    fn write(&self, stream: Stream, bytes: &[u8]) {
        // Mistakes in a loaded text are reported with their place instead; and after (exit) CLIPS
        // prints an error that is none.
        let is_kept = self.loading.get() && stream == Stream::Err;
        if is_kept || self.exited.get().is_some() {
            return;
        }
        if stream != Stream::Err {
            return self.sender.write(stream, bytes);
        }
        if let Some(complaints) = self.complaints.borrow_mut().as_mut() {
            complaints.extend_from_slice(bytes);
            return;
        }
        let passed = self.trace.pass(bytes);
        if !passed.is_empty() {
            self.sender.write(stream, &passed);
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

    fn parsed(&self, line: usize, is_warning: bool, text: &str) {
        if self.loading.get() {
            self.load_messages.borrow_mut().push(LoadMessage { line, is_warning, text: text.to_owned() });
        }
    }
}
