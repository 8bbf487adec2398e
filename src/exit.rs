//! The exit codes, and nothing else.
//!
//! The numbers are a contract with scripts and executives; 11 to 34 follow
//! Fast Downward's bands.

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Exit {
    /// Done; a plan was found (also an empty one).
    Done,
    /// A well-formed no: different, invalid plan, trigger timed out.
    No,
    /// The command line is wrong.
    Usage,
    /// A document, query, template, PDDL, CLIPS or world file is wrong.
    BadInput,
    /// A store is unreachable or failed; a file cannot be written.
    Store,
    /// A unique key or a lock is taken, or a collection does not take a document.
    Conflict,
    /// It is proven that no plan exists.
    Unsolvable,
    /// The planner gave up without proof.
    GaveUp,
    /// The planner ran into its memory limit.
    OutOfMemory,
    /// The planner ran into its time limit.
    OutOfTime,
    /// The planner crashed, or returned what is not a plan, or an invalid plan.
    PlannerBroken,
    /// The planner cannot handle a feature that the task uses.
    Unsupported,
    /// The planner program is not installed.
    PlannerNotFound,
    /// The user interrupted the command.
    Interrupted,
    /// The exit code of a program that rmem ran for the user, passed on.
    Passed(u8),
}

/// Every code with its meaning, in order: the table of `rmem help exit-codes`.
pub const TABLE: [(Exit, &str); 14] = [
    (Exit::Done, "done; a plan was found (also an empty one)"),
    (Exit::No, "a well-formed no: different, invalid plan, trigger timed out"),
    (Exit::Usage, "usage"),
    (Exit::BadInput, "bad input: document, query, template, PDDL, CLIPS, world file, answer of a computable"),
    (Exit::Store, "store unreachable or failed; the program of a computable failed, or took too long"),
    (Exit::Conflict, "conflict: unique key, validator, lock"),
    (Exit::Unsolvable, "proven: no plan exists"),
    (Exit::GaveUp, "the planner gave up without proof"),
    (Exit::OutOfMemory, "out of memory limit"),
    (Exit::OutOfTime, "out of time limit"),
    (Exit::PlannerBroken, "the planner crashed, or returned what is not a plan, or an invalid plan"),
    (Exit::Unsupported, "the planner cannot handle a feature the task uses"),
    (Exit::PlannerNotFound, "planner program not found"),
    (Exit::Interrupted, "interrupted"),
];

impl Exit {
    /// The number a shell sees.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::No => 1,
            Self::Usage => 2,
            Self::BadInput => 3,
            Self::Store => 4,
            Self::Conflict => 5,
            Self::Unsolvable => 11,
            Self::GaveUp => 12,
            Self::OutOfMemory => 22,
            Self::OutOfTime => 23,
            Self::PlannerBroken => 32,
            Self::Unsupported => 34,
            Self::PlannerNotFound => 127,
            Self::Interrupted => 130,
            Self::Passed(code) => code,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_complete_and_sorted() {
        let codes: Vec<u8> = TABLE.iter().map(|(exit, _)| exit.code()).collect();
        assert_eq!(codes, [0, 1, 2, 3, 4, 5, 11, 12, 22, 23, 32, 34, 127, 130]);
    }
}
