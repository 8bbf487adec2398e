//! A process that holds a resource, identified so that another process can find out whether it is running.

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// How long a process that is being ended may take until the system has removed it.
const REMOVAL_TIMEOUT: Duration = Duration::from_secs(1);
/// How long a running process is looked at for signs of its end: a kill that was just sent may not show yet.
const SIGN_TIMEOUT: Duration = Duration::from_millis(50);
/// How long to wait between two looks at a process. Short, because a process that was killed is gone within milliseconds.
const POLL_INTERVAL: Duration = Duration::from_millis(5);

/// A process of this machine or of another.
///
/// Its text is `BOOT NAMESPACE PID START`: the boot of the kernel, the namespace of
/// process ids, the id in it, and when the process was started (so that an id which
/// is used again is not taken for it). Parts that the system does not provide are `-`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Holder {
    boot: String,
    space: String,
    process: u32,
    started: String,
}

/// What is known of a holder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Life {
    /// It is running.
    Running,
    /// It has ended.
    Over,
    /// It is a process of this machine that cannot be seen from here: another container's.
    Unseen,
    /// It is, or was, a process of another machine, or of this one before it was started again.
    Elsewhere,
}

impl Holder {
    /// This process.
    pub(crate) fn myself() -> Self {
        static MYSELF: OnceLock<Holder> = OnceLock::new();
        let read = || {
            let (boot, space, process) = (boot(), space(), std::process::id());
            Self { boot, space, process, started: started(process).unwrap_or_else(unknown) }
        };
        MYSELF.get_or_init(read).clone()
    }

    pub(crate) fn life(&self) -> Life {
        if self.boot != boot() {
            return Life::Elsewhere;
        }
        if self.space != space() {
            return Life::Unseen;
        }
        match started(self.process) {
            Some(started) if started == self.started => Life::Running,
            Some(_) => Life::Over,
            None if exists(self.process) => Life::Running,
            None => Life::Over,
        }
    }

    /// Returns whether the process has ended, now or shortly: one that was just killed runs until the system has removed
    /// it, and is waited for.
    pub(crate) fn ends(&self) -> bool {
        let since = Instant::now();
        loop {
            match self.life() {
                Life::Over => return true,
                Life::Unseen | Life::Elsewhere => return false,
                Life::Running => {}
            }
            let timeout = if is_dying(self.process) { REMOVAL_TIMEOUT } else { SIGN_TIMEOUT };
            if since.elapsed() >= timeout {
                return false;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    /// The process as part of a file name: `BOOT.NAMESPACE.PID.START`, without characters that a file system refuses.
    pub(crate) fn tag(&self) -> String {
        format!("{}.{}.{}.{}", plain(&self.boot), plain(&self.space), self.process, plain(&self.started))
    }

    /// What is known of the process in a [`Holder::tag`]; nothing where the text is none.
    pub(crate) fn life_of(tag: &str) -> Option<Life> {
        let [boot, space, process, started] = tag.split('.').collect::<Vec<_>>().try_into().ok()?;
        let myself = Self::myself();
        let same = |part: &str, own: &str| if part == plain(own) { own.to_owned() } else { part.to_owned() };
        let holder = Self {
            boot: same(boot, &myself.boot),
            space: same(space, &myself.space),
            process: process.parse().ok()?,
            started: started.to_owned(),
        };
        Some(holder.life())
    }

    /// The process id in its own namespace.
    pub(crate) fn process(&self) -> u32 {
        self.process
    }
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {} {}", self.boot, self.space, self.process, self.started)
    }
}

impl FromStr for Holder {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let [boot, space, process, started] = text.split(' ').collect::<Vec<_>>().try_into().map_err(drop)?;
        let process = process.parse().map_err(drop)?;
        Ok(Self { boot: boot.to_owned(), space: space.to_owned(), process, started: started.to_owned() })
    }
}

/// The letters and digits of a text.
fn plain(text: &str) -> String {
    text.chars().filter(char::is_ascii_alphanumeric).collect()
}

fn unknown() -> String {
    "-".to_owned()
}

fn boot() -> String {
    let id = std::fs::read_to_string("/proc/sys/kernel/random/boot_id");
    id.map_or_else(|_| unknown(), |id| id.trim().to_owned())
}

fn space() -> String {
    let space = std::fs::read_link("/proc/self/ns/pid");
    space.map_or_else(|_| unknown(), |space| space.display().to_string().replace(' ', ""))
}

/// When a process was started, in the kernel's ticks: the 22nd field, behind the
/// name in parentheses. A process that has ended and is not yet waited for has none.
fn started(process: u32) -> Option<String> {
    let line = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let (_, fields) = line.rsplit_once(')')?;
    let mut fields = fields.split_whitespace();
    if matches!(fields.next()?, "Z" | "X") {
        return None;
    }
    fields.nth(18).map(str::to_owned)
}

/// Whether the system is removing a process (the flag `PF_EXITING`), or a KILL is on its way to it.
fn is_dying(process: u32) -> bool {
    const PF_EXITING: u64 = 0x4;
    const KILL: u64 = 1 << 8;
    let read = |name: &str| std::fs::read_to_string(format!("/proc/{process}/{name}")).unwrap_or_default();
    let line = read("stat");
    let flags = line.rsplit_once(')').and_then(|(_, fields)| fields.split_whitespace().nth(6)?.parse::<u64>().ok());
    let status = read("status");
    let mut pending = status.lines().filter_map(|line| {
        let set = line.strip_prefix("SigPnd:").or_else(|| line.strip_prefix("ShdPnd:"))?;
        u64::from_str_radix(set.trim(), 16).ok()
    });
    flags.is_some_and(|flags| flags & PF_EXITING != 0) || pending.any(|set| set & KILL != 0)
}

/// Whether the process exists, on systems without `/proc`.
fn exists(process: u32) -> bool {
    if std::path::Path::new("/proc/self/stat").exists() {
        return false;
    }
    let process = i32::try_from(process).ok().and_then(rustix::process::Pid::from_raw);
    process.is_some_and(|process| !matches!(rustix::process::test_kill_process(process), Err(rustix::io::Errno::SRCH)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_running_until_it_has_ended() {
        let myself = Holder::myself();
        assert_eq!(myself.to_string().parse(), Ok(myself.clone()));
        assert_eq!(myself.life(), Life::Running);
        let mut child = std::process::Command::new("true").spawn().unwrap();
        let other = Holder { process: child.id(), ..myself.clone() };
        child.wait().unwrap();
        assert_eq!(other.life(), Life::Over);
    }

    #[test]
    fn a_process_that_was_just_killed_is_waited_for() {
        let myself = Holder::myself();
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        let other = Holder { process: child.id(), started: started(child.id()).unwrap(), ..myself };
        assert_eq!((other.life(), other.ends()), (Life::Running, false));
        child.kill().unwrap();
        assert!(other.ends());
        child.wait().unwrap();
    }

    #[test]
    fn an_id_that_is_used_again_is_another_process() {
        assert_eq!(Holder { started: "1".to_owned(), ..Holder::myself() }.life(), Life::Over);
    }

    #[test]
    fn a_process_of_another_container_is_not_taken_for_ended() {
        assert_eq!(Holder { space: "pid:[1]".to_owned(), ..Holder::myself() }.life(), Life::Unseen);
        assert_eq!(Holder { boot: "another".to_owned(), ..Holder::myself() }.life(), Life::Elsewhere);
    }
}
