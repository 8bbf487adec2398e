//! Where a store is: `file:PATH`, `mem:`, `mongodb://…`, `mongodb+srv://…`.

use std::fmt;
use std::path::PathBuf;

use crate::fault::{AtFault, Fault};
use crate::formats::credentials::{has_ports, hosts, masked};

use super::{Embedded, Store, StoreError};

/// The address of a store. Its `Display` (and `Debug`) shows no credentials.
#[derive(Clone, PartialEq, Eq, Hash)]
pub struct StoreUri(Location);

#[derive(Clone, PartialEq, Eq, Hash)]
enum Location {
    File(PathBuf),
    Memory,
    Server(String),
}

/// What a store is used for; decides how a server is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// Private to this robot: read from the primary.
    Local,
    /// Replicated among robots: read from the nearest member.
    Shared,
}

/// Why a text is not the address of a store. Repeats no part that may hold credentials.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum UriError {
    /// Neither `file:` nor `mem:` nor `mongodb://` in front.
    #[error("`{text}` is not the URI of a store; {hint}")]
    Scheme {
        /// The text, [`masked`].
        text: String,
        /// What to write instead.
        hint: String,
    },
    /// `file:` in front of the URI of something else.
    #[error("`file:` names a file of this machine; for a server write mongodb://HOST:PORT without `file:`")]
    NotAFile,
    /// `file://` in front of what is not an absolute path.
    #[error("`file://{text}` would be a file of another machine; write file:{text}, or file:/ and an absolute path")]
    Elsewhere {
        /// What follows, [`masked`].
        text: String,
    },
    /// A scheme that no store has.
    #[error("no store has the scheme `{scheme}:`; use file:PATH, mem:, mongodb://… or mongodb+srv://…")]
    Unknown {
        /// The scheme.
        scheme: String,
    },
    /// `file:` with nothing behind.
    #[error("`file:` needs a path, like file:robot.rmem")]
    NoPath,
    /// `mem:` with something behind.
    #[error("`mem:` takes no path; for a file write file:PATH")]
    MemoryPath,
    /// `mongodb://` with nothing behind.
    #[error(
        "the address has no host, or its port is not a number; expected {scheme}://HOST:PORT, or {scheme}://USER:PASSWORD@HOST:PORT"
    )]
    NoHost {
        /// `mongodb` or `mongodb+srv`.
        scheme: String,
    },
    /// More than one `@`, so that the end of the credentials is not known.
    #[error("the {scheme} URI has more than one `@`; write %40 for those in a user name, password or option")]
    Ambiguous {
        /// `mongodb` or `mongodb+srv`.
        scheme: String,
    },
}

impl AtFault for UriError {
    fn fault(&self) -> Fault {
        Fault::Usage
    }
}

impl StoreUri {
    /// Reads the address of a store; contacts nothing.
    ///
    /// # Errors
    /// Where it has no known scheme, or nothing behind it.
    pub fn parse(text: &str) -> Result<Self, UriError> {
        let Some((scheme, rest)) = text.split_once(':').filter(|(scheme, _)| is_scheme(scheme)) else {
            return Err(UriError::Scheme { text: masked(text), hint: hint(text) });
        };
        match scheme {
            "file" => file(rest),
            "mem" if !rest.is_empty() => Err(UriError::MemoryPath),
            "mem" => Ok(Self(Location::Memory)),
            "mongodb" | "mongodb+srv" => server(scheme, rest, text),
            _ => Err(UriError::Unknown { scheme: scheme.to_owned() }),
        }
    }

    /// The URI of an embedded store in a file.
    #[must_use]
    pub fn file(path: impl Into<PathBuf>) -> Self {
        Self(Location::File(path.into()))
    }

    /// The path of an embedded store in a file.
    #[must_use]
    pub fn path(&self) -> Option<&std::path::Path> {
        match &self.0 {
            Location::File(path) => Some(path),
            _ => None,
        }
    }

    /// Whether the store is gone when it is closed.
    #[must_use]
    pub fn is_in_memory(&self) -> bool {
        self.0 == Location::Memory
    }

    /// The same URI with a relative path taken from `folder`, for paths in configuration files.
    #[must_use]
    pub fn relative_to(self, folder: &std::path::Path) -> Self {
        match self.0 {
            Location::File(path) => Self(Location::File(folder.join(path))),
            other => Self(other),
        }
    }
}

/// Opens the store at `uri`. A file is opened now, a server is contacted by the first operation.
///
/// # Errors
/// Where a file cannot be opened, a URI is not acceptable to the driver, or
/// this rmem was built without MongoDB.
pub fn open(uri: &StoreUri, role: Role) -> Result<Box<dyn Store>, StoreError> {
    match &uri.0 {
        Location::File(path) => Ok(Box::new(Embedded::open(path)?)),
        Location::Memory => Ok(Box::new(Embedded::in_memory()?)),
        Location::Server(text) => open_server(uri, text, role),
    }
}

#[cfg(feature = "mongodb")]
fn open_server(uri: &StoreUri, text: &str, role: Role) -> Result<Box<dyn Store>, StoreError> {
    Ok(Box::new(super::mongodb::MongoDb::open(text, uri.to_string(), role)?))
}

#[cfg(not(feature = "mongodb"))]
fn open_server(uri: &StoreUri, _: &str, _: Role) -> Result<Box<dyn Store>, StoreError> {
    Err(StoreError::Failed {
        address: uri.to_string(),
        reason: "this rmem was built without MongoDB; build it with `--features mongodb`, or use file:PATH".to_owned(),
    })
}

/// What to write instead of a text without a scheme.
fn hint(text: &str) -> String {
    if text != text.trim() {
        return "remove the blanks around it".to_owned();
    }
    if text.starts_with(['"', '\'']) {
        return "remove the quotes around it".to_owned();
    }
    if text.contains("mongodb") || text.contains('@') {
        return "a server is written mongodb://HOST:PORT".to_owned();
    }
    format!("for a file write `file:{text}`")
}

fn file(path: &str) -> Result<StoreUri, UriError> {
    if path.is_empty() {
        return Err(UriError::NoPath);
    }
    if path.contains("://") || (path.contains("mongodb") && path.contains('@')) {
        return Err(UriError::NotAFile);
    }
    match path.strip_prefix("//") {
        Some(rest) if !rest.starts_with('/') => Err(UriError::Elsewhere { text: masked(rest) }),
        _ => Ok(StoreUri(Location::File(PathBuf::from(path)))),
    }
}

fn is_scheme(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
        && !text.contains('.')
}

fn server(scheme: &str, rest: &str, text: &str) -> Result<StoreUri, UriError> {
    let scheme = || scheme.to_owned();
    let hosts = rest.strip_prefix("//").map(hosts).unwrap_or_default();
    if rest.matches('@').count() > 1 {
        return Err(UriError::Ambiguous { scheme: scheme() });
    }
    // Behind `user:secret` without `@HOST`, the secret stands where a port would.
    if hosts.is_empty() || !has_ports(hosts) {
        return Err(UriError::NoHost { scheme: scheme() });
    }
    Ok(StoreUri(Location::Server(text.to_owned())))
}

impl fmt::Display for StoreUri {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Location::File(path) => write!(f, "file:{}", path.display()),
            Location::Memory => f.write_str("mem:"),
            Location::Server(text) => {
                let (scheme, rest) = text.split_once("://").unwrap_or(("mongodb", ""));
                write!(f, "{scheme}://{}", hosts(rest))
            }
        }
    }
}

impl fmt::Debug for StoreUri {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "StoreUri({self})")
    }
}

impl std::str::FromStr for StoreUri {
    type Err = UriError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::parse(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(text: &str) -> String {
        match StoreUri::parse(text) {
            Ok(uri) => format!("{uri} {uri:?}"),
            Err(error) => format!("{error} {error:?}"),
        }
    }

    #[test]
    fn credentials_are_never_shown() {
        for text in [
            "mongodb://robot:secret@host:27017/?replicaSet=shared",
            "mongodb+srv://robot:secret@cluster.example.net",
            "mongodb://robot:secret/x@host/db",
            "mongodb://robot:secret@x@host/db",
            "mongodb://robot:secret@",
            "mongodb:robot:secret@host",
            " mongodb://robot:secret@host",
            "\nmongodb://robot:secret@host",
            "'mongodb://robot:secret@host'",
            "\"mongodb://robot:sec//secret@x@host",
            "mongodb//robot:secret@host",
            " mongodb:robot:secret//x@host",
            " mongodb://host/?tlsCertificateKeyFilePassword=secret",
            "file:mongodb://robot:secret@host/",
            "file: mongodb://robot:secret@host/",
            "file:mongodb//robot:secret@host/",
            "file://robot:secret@host/",
            "mem:mongodb://robot:secret@host/",
            "mongodb://host/?tlsCertificateKeyFilePassword=secret",
        ] {
            assert!(!shown(text).contains("secret"), "{}", shown(text));
        }
        assert!(shown("mongodb://robot:secret@a:1,b:2/db?x=1").starts_with("mongodb://a:1,b:2 "));
    }

    #[test]
    fn a_bare_path_is_refused_with_a_hint() {
        for text in ["robot.rmem", "./robot.rmem", "/tmp/a:b", "robot.rmem:x"] {
            assert_eq!(
                StoreUri::parse(text).unwrap_err().to_string(),
                format!("`{text}` is not the URI of a store; for a file write `file:{text}`")
            );
        }
    }

    #[test]
    fn what_hides_a_uri_is_named_and_not_taken_away() {
        for (text, wanted) in [
            (" mongodb://u:p@h", "` mongodb://…@h` is not the URI of a store; remove the blanks around it"),
            ("'mongodb://u:p@h'", "`'mongodb://…@h'` is not the URI of a store; remove the quotes around it"),
            ("mongodb//u:p@h", "`mongodb//…@h` is not the URI of a store; a server is written mongodb://HOST:PORT"),
            (" file:a", "` file:a` is not the URI of a store; remove the blanks around it"),
        ] {
            assert_eq!(StoreUri::parse(text).unwrap_err().to_string(), wanted);
        }
    }

    #[test]
    fn two_slashes_do_not_turn_a_relative_path_into_an_absolute_one() {
        let refusal = StoreUri::parse("file://robot.rmem").unwrap_err().to_string();
        assert!(refusal.contains("write file:robot.rmem, or file:/ and an absolute path"), "{refusal}");
        assert!(StoreUri::parse("file:///tmp/robot.rmem").unwrap().path().unwrap().is_absolute());
    }

    #[test]
    fn files_and_memory_are_told_apart() {
        assert_eq!(StoreUri::parse("file:a b.rmem").unwrap().path(), Some(std::path::Path::new("a b.rmem")));
        assert!(StoreUri::parse("mem:").unwrap().is_in_memory());
        for text in ["file:", "mem:x", "http://x", "mongodb://", "mongodb:///db", ""] {
            assert!(StoreUri::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn relative_paths_are_taken_from_the_folder_of_the_configuration() {
        let folder = std::path::Path::new("/etc/robot");
        assert_eq!(StoreUri::parse("file:a.rmem").unwrap().relative_to(folder).to_string(), "file:/etc/robot/a.rmem");
        assert_eq!(StoreUri::parse("file:/b.rmem").unwrap().relative_to(folder).to_string(), "file:/b.rmem");
    }
}
