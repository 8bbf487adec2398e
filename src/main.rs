//! The `rmem` program.

use std::io::Write as _;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    let code = match arguments.next().as_deref().and_then(|word| word.to_str()) {
        Some("__warden") => rmem::planner::warden::run(arguments),
        Some("ff") => {
            let files: Vec<_> = arguments.filter(|word| word != "-o" && word != "-f").collect();
            let [domain, problem] = files.as_slice() else { return ExitCode::from(2) };
            let (Ok(domain), Ok(problem)) = (std::fs::read_to_string(domain), std::fs::read_to_string(problem)) else {
                return ExitCode::from(3);
            };
            let (text, code) = rmem::planner::builtin::child(&domain, &problem, Default::default());
            let _ = std::io::stdout().write_all(text.as_bytes());
            code
        }
        _ => 2,
    };
    ExitCode::from(u8::try_from(code).unwrap_or(32))
}
