//! What is kept of a password (RFC 5802, section 3; RFC 7677): enough to recognise it, too little to know it.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::{Digest as _, Sha256};

/// How often the hash is taken: what MongoDB takes.
pub(super) const ITERATIONS: u32 = 15_000;
/// Fewer are refused by clients.
const FEWEST: u32 = 4_096;
/// How a verifier begins, as PostgreSQL writes it.
const PREFIX: &str = "SCRAM-SHA-256$";

/// The bytes of SHA-256.
pub(super) type Key = [u8; 32];

/// What is kept of a password.
#[derive(Clone, PartialEq, Eq)]
pub(super) struct Verifier {
    pub(super) salt: Vec<u8>,
    pub(super) iterations: u32,
    pub(super) stored: Key,
    pub(super) server: Key,
}

impl Verifier {
    /// Of a password, with a salt. None where the password has characters that it cannot have.
    pub(super) fn new(password: &str, salt: Vec<u8>, iterations: u32) -> Option<Self> {
        let password = stringprep::saslprep(password).ok()?;
        let mut salted = Key::default();
        pbkdf2::pbkdf2_hmac::<Sha256>(password.as_bytes(), &salt, iterations, &mut salted);
        let client = hmac(&salted, b"Client Key");
        Some(Self { salt, iterations, stored: Sha256::digest(client).into(), server: hmac(&salted, b"Server Key") })
    }

    /// Reads `SCRAM-SHA-256$ITERATIONS:SALT$STOREDKEY:SERVERKEY`, in base64.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let (parameters, keys) = text.strip_prefix(PREFIX)?.split_once('$')?;
        let (iterations, salt) = parameters.split_once(':')?;
        let (stored, server) = keys.split_once(':')?;
        let key = |text: &str| STANDARD.decode(text).ok()?.try_into().ok();
        let iterations = iterations.parse().ok().filter(|iterations| *iterations >= FEWEST)?;
        Some(Self { salt: STANDARD.decode(salt).ok()?, iterations, stored: key(stored)?, server: key(server)? })
    }

    /// Whether a text is meant to be one.
    pub(super) fn is_meant(text: &str) -> bool {
        text.starts_with(PREFIX)
    }

    /// The text that [`Verifier::parse`] reads.
    pub(super) fn text(&self) -> String {
        let [salt, stored, server] = [self.salt.as_slice(), &self.stored, &self.server].map(|key| STANDARD.encode(key));
        format!("{PREFIX}{}:{salt}${stored}:{server}", self.iterations)
    }
}

/// HMAC-SHA-256.
pub(super) fn hmac(key: &[u8], message: &[u8]) -> Key {
    let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(key) else {
        // Keys of every length are accepted.
        return Key::default();
    };
    mac.update(message);
    mac.finalize().into_bytes().into()
}

/// Random bytes.
pub(super) fn random(count: usize) -> Vec<u8> {
    let mut bytes = vec![0; count];
    // A system without randomness gives no logins: an empty text is no proof of anything.
    match getrandom::fill(&mut bytes) {
        Ok(()) => bytes,
        Err(_) => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_keys_are_those_of_the_specification() {
        // RFC 7677, section 3.
        let salt = STANDARD.decode("W22ZaJ0SNY7soEsUEjb6gQ==").unwrap();
        let verifier = Verifier::new("pencil", salt, 4096).unwrap();
        let text = "SCRAM-SHA-256$4096:W22ZaJ0SNY7soEsUEjb6gQ==$WG5d8oPm3OtcPnkdi4Uo7BkeZkBFzpcXkuLmtbsT4qY=:\
                    wfPLwcE6nTWhTAmQ7tl2KeoiWGPlZqQxSrmfPwDl2dU=";
        assert_eq!(verifier.text(), text);
        assert!(Verifier::parse(text) == Some(verifier));
        assert!(Verifier::parse(&text.replace("4096", "1")).is_none());
    }
}
