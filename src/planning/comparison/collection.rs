//! The tasks of a folder, laid out as the collections of the planning competitions are.
//!
//! A folder of a domain has `domain.pddl` and problems, or for each problem a domain of its own:
//! `domain_p01.pddl`, `domain-p01.pddl` or `p01-domain.pddl` beside `p01.pddl`. Problems may be in a folder `instances` or
//! `problems` beside `domain.pddl`. A collection is a folder of such folders.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Folders of problems beside their domain.
const INSTANCES: [&str; 2] = ["instances", "problems"];

/// The files of a task.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TaskFiles {
    /// The folder of its domain.
    pub group: String,
    /// Folder and problem; the folder alone where its only problem is called `problem.pddl`.
    pub name: String,
    /// The domain.
    pub domain: PathBuf,
    /// The problem.
    pub problem: PathBuf,
}

/// Returns the tasks of a collection, or of a domain, sorted by name.
///
/// # Errors
/// Where a folder cannot be read.
pub fn tasks(folder: &Path) -> io::Result<Vec<TaskFiles>> {
    let own = of_domain(folder)?;
    if !own.is_empty() {
        return Ok(own);
    }
    let folders = entries(folder)?.into_iter().filter(|path| path.is_dir());
    let all: Vec<Vec<TaskFiles>> = folders.map(|folder| of_domain(&folder)).collect::<io::Result<_>>()?;
    Ok(all.into_iter().flatten().collect())
}

/// The tasks of the folder of a domain.
fn of_domain(folder: &Path) -> io::Result<Vec<TaskFiles>> {
    let group = name(folder);
    let is_problem =
        |path: &PathBuf| path.extension().is_some_and(|end| end == "pddl") && !name(path).contains("domain");
    let mut problems: Vec<PathBuf> = entries(folder)?.into_iter().filter(is_problem).collect();
    for inner in INSTANCES.iter().map(|name| folder.join(name)).filter(|inner| inner.is_dir()) {
        problems.extend(entries(&inner)?.into_iter().filter(is_problem));
    }
    let task = |problem: PathBuf| {
        let file = name(&problem);
        let name = format!("{group}/{}", file.trim_end_matches(".pddl"));
        Some(TaskFiles { group: group.clone(), name, domain: domain_of(folder, &file)?, problem })
    };
    let mut tasks: Vec<TaskFiles> = problems.into_iter().filter_map(task).collect();
    if let [only] = tasks.as_mut_slice()
        && name(&only.problem) == "problem.pddl"
    {
        only.name.clone_from(&only.group);
    }
    Ok(tasks)
}

/// The domain of a problem: its own, or that of the folder.
fn domain_of(folder: &Path, problem: &str) -> Option<PathBuf> {
    let first = problem.split(['-', '.']).next().unwrap_or_default();
    let known = [
        format!("domain_{problem}"),
        format!("domain-{problem}"),
        format!("{first}-domain.pddl"),
        "domain.pddl".into(),
    ];
    known.iter().map(|name| folder.join(name)).find(|path| path.is_file())
}

fn entries(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path())).collect::<io::Result<_>>()?;
    paths.sort();
    Ok(paths)
}

/// The last part of a path; of `.` that of what it stands for.
fn name(path: &Path) -> String {
    let whole = path.file_name().is_none().then(|| path.canonicalize().ok()).flatten();
    let path = whole.as_deref().unwrap_or(path);
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_collection_has_the_tasks_of_its_domains() {
        let folder = tempfile::tempdir().unwrap();
        for file in [
            "blocks/domain.pddl",
            "blocks/p02.pddl",
            "blocks/p01.pddl",
            "blocks/README",
            "one/domain.pddl",
            "one/problem.pddl",
            "several/domain.pddl",
            "several/problem-2.pddl",
            "several/problem.pddl",
            "own/domain_p1.pddl",
            "own/p1.pddl",
            "own/p2-domain.pddl",
            "own/p2-large.pddl",
            "none/p1.pddl",
            "loose.pddl",
            "within/domain.pddl",
            "within/instances/instance-1.pddl",
        ] {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        let found = tasks(folder.path()).unwrap();
        let names: Vec<(String, String)> = found.iter().map(|task| (task.name.clone(), name(&task.domain))).collect();
        let wanted = [
            ("blocks/p01", "domain.pddl"),
            ("blocks/p02", "domain.pddl"),
            ("one", "domain.pddl"),
            ("own/p1", "domain_p1.pddl"),
            ("own/p2-large", "p2-domain.pddl"),
            ("several/problem-2", "domain.pddl"),
            ("several/problem", "domain.pddl"),
            ("within/instance-1", "domain.pddl"),
        ];
        assert_eq!(names, wanted.map(|(name, domain)| (name.to_owned(), domain.to_owned())));
        assert_eq!(tasks(&folder.path().join("blocks")).unwrap().len(), 2);
        assert!(tasks(&folder.path().join("nowhere")).is_err());
    }
}
