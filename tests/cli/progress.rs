//! Progress on stderr, where that is a terminal.

use crate::lab::Lab;

/// Runs rmem with stderr on a pseudo-terminal; returns what the terminal got.
fn on_terminal(lab: &Lab, args: &[&str]) -> String {
    use std::io::Read as _;
    let master = rustix::pty::openpt(rustix::pty::OpenptFlags::RDWR | rustix::pty::OpenptFlags::NOCTTY).unwrap();
    rustix::pty::grantpt(&master).unwrap();
    rustix::pty::unlockpt(&master).unwrap();
    let path = rustix::pty::ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    let terminal = std::fs::OpenOptions::new().read(true).write(true).open(path).unwrap();
    let mut command = std::process::Command::new(crate::lab::rmem());
    lab.isolate(command.args(args));
    let mut child = command
        .env("TERM", "xterm")
        .stdin(std::process::Stdio::null())
        .stdout(std::process::Stdio::null())
        .stderr(terminal)
        .spawn()
        .unwrap();
    // What is held here would keep the terminal open.
    drop(command);
    let reader = std::thread::spawn(move || {
        let (mut shown, mut bytes, mut master) = (Vec::new(), [0; 4096], std::fs::File::from(master));
        // Reading fails once no process has the terminal open any more.
        while let Ok(count @ 1..) = master.read(&mut bytes) {
            shown.extend_from_slice(&bytes[..count]);
        }
        String::from_utf8_lossy(&shown).into_owned()
    });
    child.wait().unwrap();
    reader.join().unwrap()
}

/// Whether a number of seconds, at least one, follows a text.
fn has_seconds(shown: &str, text: &str) -> bool {
    shown.split(text).skip(1).any(|rest| {
        let (number, _) = rest.split_once('s').unwrap_or_default();
        number.parse::<u32>().is_ok_and(|seconds| seconds > 0)
    })
}

/// A memory, a planner that takes its time, and a task for it.
fn slow() -> Lab {
    let lab = Lab::new();
    lab.write(
        "rmem.toml",
        "memory = 'file:robot.rmem'\n\
         [planner.slow]\ncommand = ['/bin/sh', '-c', 'sleep 2.5; echo \"search cap reached!\"']\noutput = 'ff'\n\
         [planner.fast]\ncommand = ['/bin/sh', '-c', 'echo \"search cap reached!\"']\noutput = 'ff'\n",
    );
    lab
}

const SOLVABLE: [&str; 4] = ["-d", "fixtures/tasks/solvable/domain.pddl", "-p", "fixtures/tasks/solvable/problem.pddl"];

#[test]
fn work_of_more_than_a_second_shows_its_progress_on_a_terminal() {
    let lab = slow();
    let plan = |planner: &'static str, more: &[&str]| {
        let args = [&["plan", "--no-store", "--timeout", "9s", "--planner", planner], &SOLVABLE[..], more].concat();
        on_terminal(&lab, &args)
    };
    let shown = plan("slow", &[]);
    assert!(has_seconds(&shown, "slow: looking for a plan, at most 9 s, "), "{shown:?}");
    assert!(shown.contains("gave up"), "{shown:?}");
    // What ends sooner, and what is to be quiet, shows none.
    let start = std::time::Instant::now();
    assert!(!plan("fast", &[]).contains("looking for") || start.elapsed().as_secs() > 0);
    assert!(!plan("slow", &["-q"]).contains("looking for"));
    let compared = on_terminal(&lab, &["compare", SOLVABLE[1], SOLVABLE[3], "--planner", "slow"]);
    assert!(compared.contains("task 1 of 1: slow on problem"), "{compared:?}");
    // A task that cannot be read is one of the tasks.
    for (name, from) in [("domain", SOLVABLE[1]), ("p2", SOLVABLE[3])] {
        lab.write(&format!("tasks/{name}.pddl"), &std::fs::read_to_string(crate::lab::root().join(from)).unwrap());
    }
    lab.write("tasks/p1.pddl", "(define");
    let compared = on_terminal(&lab, &["compare", "tasks", "--again", "--planner", "slow"]);
    assert!(compared.contains("task 2 of 2: slow on tasks/p2"), "{compared:?}");
    let piped = lab.rmem(&[&["plan", "--no-store", "--planner", "slow"], &SOLVABLE[..]].concat());
    assert!(!piped.stderr.contains("looking for"), "{piped}");
}

#[test]
fn documents_are_counted_while_they_are_stored() {
    let lab = slow();
    lab.shell("mkfifo slowly").success();
    let path = lab.path().join("slowly");
    let writer = std::thread::spawn(move || {
        use std::io::Write as _;
        let mut pipe = std::fs::OpenOptions::new().write(true).open(path).unwrap();
        for number in 0..4 {
            writeln!(pipe, "{{n: {number}}}").unwrap();
            std::thread::sleep(std::time::Duration::from_millis(700));
        }
    });
    let shown = on_terminal(&lab, &["insert", "a.b", "--file", "slowly"]);
    writer.join().unwrap();
    assert!(shown.contains("storing in a.b: ") && has_seconds(&shown, " documents, "), "{shown:?}");
    assert!(shown.contains("4 stored in a.b"), "{shown:?}");
}
