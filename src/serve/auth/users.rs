//! The file of users: `NAME:PASSWORD` or `NAME:VERIFIER`, one a line.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::fault::{AtFault, Fault};

use super::verifier::{ITERATIONS, Verifier, hmac, random};

/// How many bytes of salt a password gets.
const SALT: usize = 28;

/// Users by their names.
pub struct Users {
    users: HashMap<String, Verifier>,
    /// Salts of unknown users are derived from it, so that a client cannot find out which users exist.
    secret: Vec<u8>,
}

/// Why there are no users.
#[derive(Debug, thiserror::Error)]
pub enum UsersError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// Others may read it.
    #[error("{}: others may read this file, which holds passwords; run chmod 600 on it", path.display())]
    Open {
        /// Which.
        path: PathBuf,
    },
    /// A line is wrong.
    #[error("{}:{line}: {reason}; expected NAME:PASSWORD, or NAME: and what `rmem serve --hash-password` prints", path.display())]
    Line {
        /// In which file.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// What is wrong.
        reason: &'static str,
    },
    /// It has no users.
    #[error("{}: there is no user in it; expected lines of NAME:PASSWORD", path.display())]
    Empty {
        /// Which.
        path: PathBuf,
    },
}

impl AtFault for UsersError {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

impl Users {
    /// Reads a file that only its owner may read. Empty lines and those that begin with `#` count for nothing.
    ///
    /// # Errors
    /// Where it cannot be read, others may read it, or a line is wrong.
    pub fn read(path: &Path) -> Result<Self, UsersError> {
        use std::os::unix::fs::PermissionsExt as _;
        let failed = |source| UsersError::File { path: path.to_owned(), source };
        let mode = std::fs::metadata(path).map_err(failed)?.permissions().mode();
        if mode & 0o077 != 0 {
            return Err(UsersError::Open { path: path.to_owned() });
        }
        let text = std::fs::read_to_string(path).map_err(failed)?;
        let users = text
            .lines()
            .enumerate()
            .filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'))
            .map(|(index, line)| {
                user(line).map_err(|reason| UsersError::Line { path: path.to_owned(), line: index + 1, reason })
            })
            .collect::<Result<HashMap<_, _>, _>>()?;
        if users.is_empty() {
            return Err(UsersError::Empty { path: path.to_owned() });
        }
        Ok(Self { users, secret: random(32) })
    }

    /// What is to stand in the file for a password, so that it does not stand there itself.
    /// None where the password has characters that it cannot have.
    #[must_use]
    pub fn verifier(password: &str) -> Option<String> {
        Verifier::new(password, random(SALT), ITERATIONS).map(|verifier| verifier.text())
    }

    /// What is kept of a user's password; for a user that there is not, something that no password fits.
    pub(super) fn find(&self, name: &str) -> Verifier {
        self.users.get(name).cloned().unwrap_or_else(|| {
            let of = |part: &str| hmac(&self.secret, format!("{part} {name}").as_bytes());
            let salt = of("salt").iter().take(SALT).copied().collect();
            Verifier { salt, iterations: ITERATIONS, stored: of("stored"), server: of("server") }
        })
    }
}

fn user(line: &str) -> Result<(String, Verifier), &'static str> {
    let (name, secret) = line.split_once(':').ok_or("there is no colon")?;
    if name.is_empty() || secret.is_empty() {
        return Err("the name or the password is empty");
    }
    let verifier = match Verifier::is_meant(secret) {
        true => Verifier::parse(secret).ok_or("the verifier is not readable")?,
        false => {
            Verifier::new(secret, random(SALT), ITERATIONS).ok_or("the password has a character that is not allowed")?
        }
    };
    Ok((name.to_owned(), verifier))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    fn read(text: &str, mode: u32) -> Result<Users, UsersError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        std::fs::set_permissions(file.path(), std::fs::Permissions::from_mode(mode)).unwrap();
        Users::read(file.path())
    }

    #[test]
    fn passwords_stand_in_the_file_or_what_is_kept_of_them() {
        let hashed = Users::verifier("pencil").unwrap();
        let users = read(&format!("# robots\n\nr2:pen:cil\nc3:{hashed}\n"), 0o600).unwrap();
        assert_eq!(users.find("c3").text(), hashed);
        assert_eq!(users.find("r2").iterations, ITERATIONS);
        assert!(users.find("nobody") == users.find("nobody"));
    }

    #[test]
    fn a_file_that_others_may_read_is_refused() {
        assert!(matches!(read("a:b\n", 0o644), Err(UsersError::Open { .. })));
        assert!(matches!(read("a\n", 0o600), Err(UsersError::Line { line: 1, .. })));
        assert!(matches!(read("# a:b\n", 0o600), Err(UsersError::Empty { .. })));
    }
}
