//! Whether a program ended for want of memory.

use super::end::End;

/// A limit of memory, in bytes, under which death by a signal counts as lack of
/// memory: it is not enough for a program and its libraries.
const SMALL: u64 = 64 << 20;

/// Whether a program ended for want of memory: it ended badly, and either says so or
/// was seen close to the limit.
pub(super) fn ran_out_of_memory(end: &End, printed: [&str; 2], peak: u64, limit: u64) -> bool {
    const COMPLAINTS: [&str; 15] = [
        "out of memory",
        "memory exhausted",
        "no memory",
        "bad_alloc",
        "memoryerror",
        "memory allocation",
        "cannot allocate",
        "can't allocate",
        "out of space",
        "not enough memory",
        "insufficient memory",
        // Messages of the dynamic linker and the thread library.
        "failed to map segment",
        "cannot map zero-fill",
        "cannot create shared object descriptor",
        "resource temporarily unavailable",
    ];
    let badly = match end {
        End::Exited(code) => *code != 0,
        End::Signalled(_) => true,
        _ => end.failure().is_some(),
    };
    let tail = |text: &str| {
        let start = text.len().saturating_sub(4096);
        let start = (start..=text.len()).find(|at| text.is_char_boundary(*at)).unwrap_or(0);
        text.get(start..).unwrap_or_default().to_lowercase()
    };
    let failure = end.failure().map(str::to_lowercase).unwrap_or_default();
    let words = format!("{}\n{failure}", printed.map(tail).join("\n"));
    let complains = COMPLAINTS.iter().any(|complaint| words.contains(complaint));
    let close = matches!(end, End::Signalled(_)) && peak.saturating_mul(1024) >= limit / 10 * 8;
    let small = matches!(end, End::Signalled(_)) && limit < SMALL;
    badly && (complains || close || small)
}
