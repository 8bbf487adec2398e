//! The binary: hands the process to the library, and its answer to the shell.

use std::io::{IsTerminal as _, Write as _};
use std::process::ExitCode;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

fn main() -> ExitCode {
    // A supervisor, and what it becomes, has no thread beside it: it would take of the memory that is allowed.
    if std::env::args_os().nth(1).is_none_or(|word| word != rmem::process::supervisor::COMMAND) {
        let _ = ctrlc::set_handler(|| {
            if rmem::interrupt::received() {
                // Nothing is half-written at any moment: files appear by renaming, stores commit.
                std::process::exit(rmem::exit::Exit::Interrupted.code().into());
            }
        });
    }
    let exit = rmem::run(
        std::env::args_os(),
        rmem::Process {
            stdin: &mut std::io::stdin().lock(),
            stdout: &mut std::io::stdout(),
            stderr: &mut std::io::stderr(),
            tell_at_once: tell,
            stdout_is_terminal: std::io::stdout().is_terminal(),
            stdout_is_closed: is_closed,
            stderr_is_terminal: std::io::stderr().is_terminal(),
            // What is not UTF-8 keeps a mark of it, which the settings refuse.
            environment: std::env::vars_os()
                .map(|(name, value)| (name.to_string_lossy().into_owned(), value.to_string_lossy().into_owned()))
                .collect(),
            stdout_columns: columns(),
            directory: std::env::current_dir().unwrap_or_default(),
            executable: std::env::current_exe().unwrap_or_else(|_| "rmem".into()),
        },
    );
    ExitCode::from(exit.code())
}

fn tell(message: &str) {
    // A closed stderr is no error.
    let _ = writeln!(std::io::stderr(), "{message}");
}

/// Whether stdout is a pipe whose reader has closed it.
fn is_closed() -> bool {
    let stdout = std::io::stdout();
    let mut pipes = [PollFd::new(&stdout, PollFlags::empty())];
    let now = Timespec { tv_sec: 0, tv_nsec: 0 };
    poll(&mut pipes, Some(&now)).is_ok_and(|ready| ready > 0) && pipes[0].revents().contains(PollFlags::ERR)
}

/// The width of the terminal that stdout is.
fn columns() -> Option<usize> {
    let size = rustix::termios::tcgetwinsize(std::io::stdout()).ok()?;
    Some(usize::from(size.ws_col)).filter(|columns| *columns > 0)
}
