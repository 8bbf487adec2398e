//! SCRAM-SHA-256 (RFC 5802, RFC 7677): a client proves that it knows a password without saying it.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::{Digest as _, Sha256};

use super::users::Users;
use super::verifier::{Key, Verifier, hmac, random};

/// The name of this way to log in.
pub(in crate::serve) const MECHANISM: &str = "SCRAM-SHA-256";
/// How many bytes the server's part of the nonce has.
const NONCE: usize = 24;

/// A login that has begun.
pub(in crate::serve) struct Conversation {
    /// Its number, by which the client goes on with it.
    pub(in crate::serve) id: i32,
    pub(in crate::serve) user: String,
    pub(in crate::serve) database: String,
    /// Whether the client wants the final answer with the proof.
    pub(in crate::serve) skips_empty: bool,
    verifier: Verifier,
    /// The client's flag of channel binding.
    header: String,
    nonce: String,
    /// The client's first message without its header, and the server's.
    signed: String,
    /// Whether the client has proven its identity.
    pub(in crate::serve) is_proven: bool,
}

/// A login is refused; the reason is not revealed.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::serve) struct Refused;

impl Conversation {
    /// The client's first message; gives the server's.
    pub(in crate::serve) fn begin(
        users: &Users,
        id: i32,
        database: &str,
        payload: &[u8],
    ) -> Result<(Self, String), Refused> {
        let text = std::str::from_utf8(payload).map_err(|_| Refused)?;
        let (header, bare) = header(text)?;
        let mut attributes = bare.split(',');
        let user = attributes.next().and_then(|part| part.strip_prefix("n=")).and_then(unescaped).ok_or(Refused)?;
        let theirs = attributes.next().and_then(|part| part.strip_prefix("r=")).ok_or(Refused)?;
        let ours = random(NONCE);
        if theirs.is_empty() || ours.is_empty() {
            return Err(Refused);
        }
        let verifier = users.find(&user);
        let nonce = format!("{theirs}{}", STANDARD.encode(ours));
        let first = format!("r={nonce},s={},i={}", STANDARD.encode(&verifier.salt), verifier.iterations);
        let conversation = Self {
            id,
            user,
            database: database.to_owned(),
            skips_empty: false,
            verifier,
            header: header.to_owned(),
            nonce,
            signed: format!("{bare},{first}"),
            is_proven: false,
        };
        Ok((conversation, first))
    }

    /// The client's proof; gives the server's, where it is right.
    pub(in crate::serve) fn prove(&mut self, payload: &[u8]) -> Result<String, Refused> {
        let text = std::str::from_utf8(payload).map_err(|_| Refused)?;
        let (without_proof, proof) = text.rsplit_once(",p=").ok_or(Refused)?;
        let mut attributes = without_proof.split(',');
        let binding = attributes.next().and_then(|part| part.strip_prefix("c=")).ok_or(Refused)?;
        let nonce = attributes.next().and_then(|part| part.strip_prefix("r=")).ok_or(Refused)?;
        if STANDARD.decode(binding).map_err(|_| Refused)? != self.header.as_bytes() || nonce != self.nonce {
            return Err(Refused);
        }
        let message = format!("{},{without_proof}", self.signed);
        let signature = hmac(&self.verifier.stored, message.as_bytes());
        let proof: Key = STANDARD.decode(proof).ok().and_then(|proof| proof.try_into().ok()).ok_or(Refused)?;
        let client: Vec<u8> = proof.iter().zip(signature).map(|(proof, signature)| proof ^ signature).collect();
        if !is_same(&Sha256::digest(client), &self.verifier.stored) {
            return Err(Refused);
        }
        self.is_proven = true;
        Ok(format!("v={}", STANDARD.encode(hmac(&self.verifier.server, message.as_bytes()))))
    }
}

/// The header, and what is behind it. A client that wants the channel bound is refused: it could
/// not be sure of it.
fn header(text: &str) -> Result<(&str, &str), Refused> {
    let (flag, rest) = text.split_once(',').ok_or(Refused)?;
    let (_, bare) = rest.split_once(',').ok_or(Refused)?;
    if !matches!(flag, "n" | "y") {
        return Err(Refused);
    }
    Ok((text.strip_suffix(bare).ok_or(Refused)?, bare))
}

/// A name with its commas and equals signs.
fn unescaped(name: &str) -> Option<String> {
    let mut parts = name.split('=');
    let mut text = parts.next()?.to_owned();
    for part in parts {
        let (sign, rest) =
            part.strip_prefix("2C").map(|rest| (',', rest)).or(part.strip_prefix("3D").map(|rest| ('=', rest)))?;
        text.push(sign);
        text.push_str(rest);
    }
    Some(text)
}

/// Whether two keys are the same, found out in a time that says nothing of where they differ.
fn is_same(one: &[u8], other: &[u8]) -> bool {
    // What differs once is different everywhere behind a hash with a secret key.
    let key = random(32);
    let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(&key) else { return false };
    mac.update(one);
    !key.is_empty() && mac.verify_slice(&hmac(&key, other)).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn users() -> Users {
        use std::os::unix::fs::PermissionsExt as _;
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "r2=d2:pencil\n").unwrap();
        std::fs::set_permissions(file.path(), std::fs::Permissions::from_mode(0o600)).unwrap();
        Users::read(file.path()).unwrap()
    }

    /// What a client proves with, by the RFC.
    fn proof(password: &str, message: &str, without_proof: &str, verifier: &Verifier) -> String {
        let mut salted = Key::default();
        pbkdf2::pbkdf2_hmac::<Sha256>(password.as_bytes(), &verifier.salt, verifier.iterations, &mut salted);
        let client = hmac(&salted, b"Client Key");
        let stored: Key = Sha256::digest(client).into();
        let signature = hmac(&stored, format!("{message},{without_proof}").as_bytes());
        STANDARD.encode(client.iter().zip(signature).map(|(a, b)| a ^ b).collect::<Vec<u8>>())
    }

    fn login(name: &str, password: &str) -> Result<String, Refused> {
        let bare = format!("n={name},r=nonce");
        let (mut conversation, first) = Conversation::begin(&users(), 1, "admin", format!("n,,{bare}").as_bytes())?;
        let nonce = first.split(',').next().unwrap().to_owned();
        let without_proof = format!("c=biws,{nonce}");
        let verifier = conversation.verifier.clone();
        let proof = proof(password, &format!("{bare},{first}"), &without_proof, &verifier);
        let message = format!("{without_proof},p={proof}");
        let answer = conversation.prove(message.as_bytes());
        // The same words prove nothing to another conversation.
        let (mut other, _) = Conversation::begin(&users(), 2, "admin", format!("n,,{bare}").as_bytes())?;
        assert_eq!(other.prove(message.as_bytes()), Err(Refused));
        answer
    }

    #[test]
    fn who_knows_the_password_is_let_in_and_nobody_else() {
        assert!(login("r2=3Dd2", "pencil").unwrap().starts_with("v="));
        assert_eq!(login("r2=3Dd2", "pencils"), Err(Refused));
        assert_eq!(login("c3", "pencil"), Err(Refused));
    }

    #[test]
    fn a_changed_header_or_nonce_is_refused() {
        for message in ["p=tls-unique,,n=a,r=b", "n,,n=a", "n,,n=a=2,r=b", "", "n,,n=a,r=", "n=a,r=b"] {
            assert!(Conversation::begin(&users(), 1, "admin", message.as_bytes()).is_err(), "{message}");
        }
        let (mut conversation, first) = Conversation::begin(&users(), 1, "admin", b"y,,n=a,r=b").unwrap();
        let nonce = first.split(',').next().unwrap();
        for message in [format!("c=biws,{nonce},p=AAAA"), format!("c=eSws,{nonce}x,p=AAAA"), "p=".to_owned()] {
            assert_eq!(conversation.prove(message.as_bytes()), Err(Refused), "{message}");
        }
    }
}
