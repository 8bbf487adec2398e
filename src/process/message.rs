//! What the supervisor reports, line by line.

use std::time::Duration;

use rustix::process::Pid;

use super::end::End;

/// What a program used.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Usage {
    /// Address space at most, in KiB.
    pub(super) peak: u64,
    /// Processor time.
    pub(super) cpu: Duration,
    /// Resident memory at most, of one process or of all as far as they were looked at, in KiB.
    pub(super) resident: u64,
}

/// A message of the supervisor.
pub(super) enum Message {
    /// The program runs, in this group.
    Started(Option<Pid>),
    Ended(End, Usage),
}

impl Message {
    /// Reads one line.
    pub(super) fn parse(line: &str) -> Self {
        let (verb, rest) = line.split_once(' ').unwrap_or((line, ""));
        let mut numbers = rest.split(' ').map(|word| word.parse::<i64>().unwrap_or_default());
        let mut number = || numbers.next().unwrap_or_default();
        let usage = |peak: i64, cpu: i64, resident: i64| Usage {
            peak: u64::try_from(peak).unwrap_or_default(),
            cpu: Duration::from_micros(u64::try_from(cpu).unwrap_or_default()),
            resident: u64::try_from(resident).unwrap_or_default(),
        };
        match verb {
            "started" => Self::Started(i32::try_from(number()).ok().and_then(Pid::from_raw)),
            "exited" => Self::Ended(End::Exited(number() as i32), usage(number(), number(), number())),
            "killed" => Self::Ended(End::Signalled(number() as i32), usage(number(), number(), number())),
            "starved" => Self::Ended(End::Starved, usage(number(), number(), number())),
            "missing" => Self::Ended(End::Missing, Usage::default()),
            "interpreter" => Self::Ended(End::NoInterpreter(rest.to_owned()), Usage::default()),
            _ => Self::Ended(End::Failed(rest.to_owned()), Usage::default()),
        }
    }
}
