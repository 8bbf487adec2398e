//! The memory of processes, from `/proc`, and what the kernel says of those that have ended.

use std::fs;
use std::time::Duration;

use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::{TimeVal, TimeValLike as _};
use rustix::process::Pid;

/// How many bytes everything that comes from `keeper` has resident, as far as that matters to `limit`: what
/// processes share is counted for each of them, unless that is what puts them over it. On a kernel that does
/// not list children, that is what `program` has.
pub(super) fn resident(keeper: Pid, program: Option<Pid>, limit: u64) -> u64 {
    let mut all = descendants(keeper);
    if all.is_empty() {
        all.extend(program);
    }
    let sum = |file: &str, name: &str| all.iter().map(|pid| figure(*pid, file, name)).sum::<u64>() * 1024;
    match sum("status", "VmRSS:") {
        rough if rough <= limit => rough,
        // The exact figure costs more to get.
        _ => sum("smaps_rollup", "Pss:"),
    }
}

/// What the processes used that this one started and waited for, and theirs: processor time, and the most memory that one
/// of them had resident, in KiB.
pub(super) fn ended() -> (Duration, u64) {
    let Ok(usage) = getrusage(UsageWho::RUSAGE_CHILDREN) else { return Default::default() };
    let micros = |time: TimeVal| Duration::from_micros(u64::try_from(time.num_microseconds()).unwrap_or_default());
    let resident = u64::try_from(usage.max_rss()).unwrap_or_default();
    (micros(usage.user_time()) + micros(usage.system_time()), resident)
}

/// The most memory that a living process has had resident, in KiB.
pub(super) fn most(process: Pid) -> u64 {
    figure(process, "status", "VmHWM:")
}

/// Whether a process is stopped, by a signal and not by a debugger: the state behind the name in `stat`.
pub(super) fn is_stopped(process: Pid) -> bool {
    let stat = fs::read_to_string(format!("/proc/{}/stat", process.as_raw_nonzero())).unwrap_or_default();
    stat.rsplit_once(") ").is_some_and(|(_, fields)| fields.starts_with('T'))
}

/// How many KiB of address space a process has.
pub(super) fn size(process: Pid) -> u64 {
    figure(process, "status", "VmSize:")
}

/// How many KiB of address space a process has had at most.
pub(super) fn peak(process: Pid) -> u64 {
    figure(process, "status", "VmPeak:")
}

/// A figure in KiB from a file of a process; 0 where it has none.
fn figure(pid: Pid, file: &str, name: &str) -> u64 {
    let text = fs::read_to_string(format!("/proc/{}/{file}", pid.as_raw_nonzero())).unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix(name));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or_default()
}

/// Everything alive that comes from a process.
fn descendants(root: Pid) -> Vec<Pid> {
    let mut found = offspring(root);
    let mut next = 0;
    while let Some(pid) = found.get(next).copied() {
        next += 1;
        for child in offspring(pid) {
            // Processes come and go while they are counted.
            if !found.contains(&child) {
                found.push(child);
            }
        }
    }
    found
}

/// The children of a process, as its threads know them.
fn offspring(pid: Pid) -> Vec<Pid> {
    let Ok(threads) = fs::read_dir(format!("/proc/{}/task", pid.as_raw_nonzero())) else { return Vec::new() };
    let texts = threads.flatten().filter_map(|thread| fs::read_to_string(thread.path().join("children")).ok());
    texts
        .flat_map(|text| text.split_whitespace().filter_map(|pid| pid.parse().ok()).collect::<Vec<i32>>())
        .filter_map(Pid::from_raw)
        .collect()
}
