//! The real `clips`, where it is on the path.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use libtest_mimic::{Failed, Trial};

/// Documents that a fact base of CLIPS can hold, in one namespace.
const DOCUMENTS: &str = r#"
{relation: 'pose', name: 'r 1', xy: [1.0, -2.5], n: 3, ok: true, tag: 'green'}
{relation: 'pose', name: 'green', xy: [], n: -9223372036854775808, ok: false, tag: '<='}
{relation: 'pose', name: "quote \" and \\ and ) ; (\nline", xy: [0.1, 1e22, 1e-7, -0.0], n: 9223372036854775807, ok: true, tag: 'ä'}
{relation: 'pose', name: '3', xy: [123456.789], n: 0, ok: false, tag: '1e'}
{relation: 'on', values: ['a', 'b c', 'TRUE', '1.5', '', 7, 7.0, true, '[x]', 'a?', '$x', '5a']}
{relation: 'handempty', values: []}
"#;

const TEMPLATES: &str = "(deftemplate pose (slot name (type STRING)) (multislot xy (type FLOAT)) \
    (slot n (type INTEGER)) (slot ok (allowed-symbols TRUE FALSE)) (slot tag (type SYMBOL) (default nil)))\n";

/// Trials of a program that is not installed are ignored.
pub(crate) fn trials() -> Vec<Trial> {
    let ignored = !is_installed("clips");
    vec![
        Trial::test("clips::loads_and_saves_facts_that_come_back_equal", facts_come_back).with_ignored_flag(ignored),
        Trial::test("clips::loads_deffacts_that_come_back_equal", deffacts_come_back).with_ignored_flag(ignored),
        Trial::test("clips::saves_facts_that_survive_the_memory", saved_facts_survive).with_ignored_flag(ignored),
        Trial::test("clips::loads_the_facts_of_triggers", facts_of_triggers).with_ignored_flag(ignored),
    ]
}

fn is_installed(program: &str) -> bool {
    std::env::var_os("PATH")
        .is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join(program).is_file()))
}

/// Runs rmem on a memory in the folder; gives stdout.
fn rmem(folder: &Path, args: &[&str]) -> Result<String, Failed> {
    let output = Command::new(env!("CARGO_BIN_EXE_rmem"))
        .args(["--memory", "file:m.rmem", "-q"])
        .args(args)
        .current_dir(folder)
        .env("HOME", folder)
        .output()?;
    if !output.status.success() {
        return Err(format!("{args:?}: {}", String::from_utf8_lossy(&output.stderr)).into());
    }
    Ok(String::from_utf8(output.stdout)?)
}

/// Runs commands in the real CLIPS, which must not complain.
fn clips(folder: &Path, commands: &str) -> Result<(), Failed> {
    fs::write(folder.join("run.bat"), format!("{commands}\n(exit)\n"))?;
    let output = Command::new("clips").args(["-f2", "run.bat"]).current_dir(folder).stdin(Stdio::null()).output()?;
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    let wrong = ["rror", "[", "WARNING"].into_iter().any(|word| printed.contains(word));
    if wrong { Err(printed.into()) } else { Ok(()) }
}

fn equal(left: &str, right: &str) -> Result<(), Failed> {
    let sorted = |text: &str| {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        lines.sort();
        lines
    };
    if sorted(left) == sorted(right) { Ok(()) } else { Err(format!("{left}\nis not\n{right}").into()) }
}

/// The documents of a namespace without what the memory adds.
fn documents(folder: &Path, namespace: &str) -> Result<String, Failed> {
    rmem(folder, &["query", namespace, "{relation: {$ne: 'initial-fact'}}", "--fields", "{_id: 0}"])
}

fn prepare() -> Result<tempfile::TempDir, Failed> {
    let folder = tempfile::tempdir()?;
    fs::write(folder.path().join("t.clp"), TEMPLATES)?;
    fs::write(folder.path().join("documents.json"), DOCUMENTS)?;
    rmem(folder.path(), &["insert", "a.before", "--file", "documents.json"])?;
    Ok(folder)
}

fn facts_come_back() -> Result<(), Failed> {
    let folder = prepare()?;
    let folder = folder.path();
    rmem(folder, &["clips", "export", "a.before", "--deftemplates", "t.clp", "-o", "out.txt"])?;
    clips(folder, "(load \"t.clp\")\n(load-facts \"out.txt\")\n(save-facts \"saved.txt\")")?;
    rmem(folder, &["clips", "import", "saved.txt", "--into", "a.after", "--deftemplates", "t.clp"])?;
    equal(&documents(folder, "a.after")?, &documents(folder, "a.before")?)
}

fn deffacts_come_back() -> Result<(), Failed> {
    let folder = prepare()?;
    let folder = folder.path();
    rmem(folder, &["insert", "a.before", "{relation: 'sign', values: ['=', ':', 'x']}"])?;
    let form = ["clips", "export", "a.before", "--deftemplates", "t.clp", "--as", "deffacts", "world", "-o", "out.clp"];
    rmem(folder, &form)?;
    clips(folder, "(load \"t.clp\")\n(load \"out.clp\")\n(reset)\n(save-facts \"saved.txt\")")?;
    rmem(folder, &["clips", "import", "saved.txt", "--into", "a.after", "--deftemplates", "t.clp"])?;
    equal(&documents(folder, "a.after")?, &documents(folder, "a.before")?)
}

fn saved_facts_survive() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let program = "(deftemplate t (slot a) (multislot m))
        (deffacts d (t (a \"x\") (m [i] \"y z\" y -1 1.5)) (t (a [j]) (m)) (o \"x\" x 3 3.0 \"3\" nil \"nil\" \"TRUE\" TRUE <Fact-1> =a :))\n";
    fs::write(folder.join("p.clp"), program)?;
    clips(folder, "(load \"p.clp\")\n(reset)\n(save-facts \"saved.txt\")")?;
    rmem(folder, &["clips", "import", "saved.txt", "--into", "a.b"])?;
    let exported = rmem(folder, &["clips", "export", "a.b"])?;
    equal(&exported, &fs::read_to_string(folder.join("saved.txt"))?)
}

fn facts_of_triggers() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let watch = |more: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_rmem"))
            .args(["--memory", "file:m.rmem", "watch", "a.b", "--resume", "orders"])
            .args(more)
            .current_dir(folder)
            .env("HOME", folder)
            .output();
        output.map(|output| output.stdout)
    };
    watch(&["--timeout", "1ms"])?;
    let documents = "{_id: 1, s: 'a \"b\" \\\\ (c)', n: {x: [1, 2.5]}}";
    rmem(folder, &["insert", "a.b", documents])?;
    rmem(folder, &["update", "a.b", "{}", "{$set: {s: 'line\\nbreak ; x'}}"])?;
    rmem(folder, &["drop", "a.b"])?;
    fs::write(folder.join("events.txt"), watch(&["--count", "3", "--format", "clips"])?)?;
    let program = format!(
        "{}\n(deftemplate seen (slot operation))\n(defrule see (robmem-trigger (name \"orders\") (rcvd-at ?s ?u)
           (operation ?o) (after ?after)) (orders) => (assert (seen (operation ?o))))",
        rmem::clips::facts::TRIGGER
    );
    fs::write(folder.join("p.clp"), program)?;
    clips(folder, "(load \"p.clp\")\n(reset)\n(load-facts \"events.txt\")\n(run)\n(save-facts \"saved.txt\")")?;
    let saved = fs::read_to_string(folder.join("saved.txt"))?;
    for operation in ["insert", "update", "drop"] {
        assert!(saved.contains(&format!("(seen (operation {operation}))")), "{saved}");
    }
    let text = "(after \"{\\\"_id\\\":1,\\\"s\\\":\\\"line\\\\nbreak ; x\\\"";
    assert!(saved.contains(text), "{text} in\n{saved}");
    Ok(())
}
