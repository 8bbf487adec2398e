//! Whose fault an error is: each error type says so beside its definition.

/// What is at fault where something fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Fault {
    /// The command line.
    Usage,
    /// An input: a document, query, template, PDDL, CLIPS, settings or world file.
    Input,
    /// A part of a language that is not supported.
    Unsupported,
    /// A store that is unreachable or fails, a file that cannot be written, the system.
    Store,
    /// A unique key or a lock that is taken.
    Conflict,
    /// A program that is not installed.
    Program,
    /// An interruption by the user.
    Interrupt,
}

/// An error that says whose fault it is. A command fails with such errors only, so that each has an exit code.
pub trait AtFault: std::error::Error + Send + Sync + 'static {
    /// Returns whose fault it is. An error around another one usually returns that of the inner one.
    fn fault(&self) -> Fault;
}

impl AtFault for std::io::Error {
    fn fault(&self) -> Fault {
        Fault::Store
    }
}

/// A document that is not the BSON it has to be.
impl AtFault for bson::error::Error {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}
