//! What the writer works with: its jobs and its memory.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

use super::job::{Abandoned, Job};
use super::lazy::Lazy;
use super::server::Server;
use super::session::none;

/// What the writer works with.
pub(super) struct WriterContext<'d> {
    pub(super) server: &'d Arc<Server>,
    pub(super) jobs: &'d Receiver<Job>,
    /// Jobs that came while others were done.
    pub(super) waiting: &'d mut VecDeque<Job>,
    pub(super) memory: &'d Lazy,
}

impl WriterContext<'_> {
    /// The next job, those that waited first.
    pub(super) fn next(&mut self, limit: Duration) -> Option<Job> {
        self.waiting.pop_front().or_else(|| self.arriving(limit))
    }

    /// Ends those of the transactions that have not begun yet and wait.
    pub(super) fn abandon(&mut self, abandoned: &Abandoned) {
        for job in std::mem::take(self.waiting) {
            match job {
                Job::Step(step) if abandoned.includes(&step.once) => step.reply.answer(Err(none(&step.once))),
                job => self.waiting.push_back(job),
            }
        }
    }

    /// The next job that comes.
    pub(super) fn arriving(&mut self, limit: Duration) -> Option<Job> {
        match self.jobs.recv_timeout(limit) {
            Ok(job) => Some(job),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => Some(Job::Stop),
        }
    }
}
