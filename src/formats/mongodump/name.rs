//! Collection names as file names: what a file system might not take is written `%2F`.

use std::fmt::Write as _;

use sha2::{Digest as _, Sha256};

/// The most bytes of a name, so that `.metadata.json.gz` still fits behind it.
const LONGEST: usize = 238;
/// How many bytes of a name that is too long are kept.
const KEPT: usize = 200;

/// The file name, without extension, for a collection. A name that is too long
/// is cut, and distinguished by a hash; its metadata has the whole one.
#[must_use]
pub fn encode(collection: &str) -> String {
    let mut name = String::with_capacity(collection.len());
    for byte in collection.bytes() {
        if byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte) {
            name.push(byte.into());
        } else {
            // Writing to a string cannot fail.
            let _ = write!(name, "%{byte:02X}");
        }
    }
    if name.len() > LONGEST {
        let hash = Sha256::digest(collection.as_bytes());
        name.truncate(KEPT);
        name.push_str("%24");
        for byte in hash.iter().take(16) {
            let _ = write!(name, "{byte:02x}");
        }
    }
    name
}

/// The collection for a file name without extension; `None` where it is not UTF-8.
#[must_use]
pub fn decode(name: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(name.len());
    let mut rest = name;
    while let Some((before, behind)) = rest.split_once('%') {
        bytes.extend_from_slice(before.as_bytes());
        match behind.get(..2).and_then(|digits| u8::from_str_radix(digits, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = behind.get(2..).unwrap_or_default();
            }
            None => {
                bytes.push(b'%');
                rest = behind;
            }
        }
    }
    bytes.extend_from_slice(rest.as_bytes());
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_comes_back() {
        for name in ["worldmodel", "a.b", "fs/.. %41", "Größe", "a:b*c", "100%", "~"] {
            assert_eq!(decode(&encode(name)).as_deref(), Some(name));
            assert!(!encode(name).contains(['/', ' ', '*', ':']));
        }
        assert_eq!(encode("a/b"), "a%2Fb");
    }

    #[test]
    fn a_long_name_fits_and_stays_its_own() {
        let (one, other) = (encode(&"ä".repeat(120)), encode(&format!("{}b", "ä".repeat(119))));
        assert!(one.len() <= LONGEST && one != other);
    }

    #[test]
    fn what_is_no_escape_is_text() {
        assert_eq!(decode("a%zz%4").as_deref(), Some("a%zz%4"));
        assert_eq!(decode("%€").as_deref(), Some("%€"));
        assert_eq!(decode("%FF"), None);
    }
}
