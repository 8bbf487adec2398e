//! The checksum of an archive over the documents of a collection: CRC-64 with the polynomial of
//! ECMA-182, reflected, as xz has it.

use crc::{CRC_64_XZ, Crc, Digest, Table};

static CRC_64: Crc<u64, Table<16>> = Crc::<u64, Table<16>>::new(&CRC_64_XZ);

/// A checksum of bytes in several parts.
#[derive(Clone)]
pub(super) struct Checksum(Digest<'static, u64, Table<16>>);

impl Default for Checksum {
    fn default() -> Self {
        Self(CRC_64.digest())
    }
}

impl Checksum {
    /// Adds bytes.
    pub(super) fn add(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// The checksum as an archive writes it.
    pub(super) fn value(&self) -> i64 {
        self.0.clone().finalize().cast_signed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_check_value_comes_out() {
        let mut whole = Checksum::default();
        whole.add(b"123456789");
        assert_eq!(whole.value().cast_unsigned(), 0x995D_C9BB_DF19_39FA);
        let mut parts = Checksum::default();
        [b"123".as_slice(), b"", b"456789"].into_iter().for_each(|part| parts.add(part));
        assert_eq!(parts.value(), whole.value());
        assert_eq!(Checksum::default().value(), 0);
    }
}
