//! CRC-64 with ECMA-182's polynomial, reflected (as xz has it): what an
//! archive says about the documents of a collection.

const POLYNOMIAL: u64 = 0xC96C_5795_D787_0F42;

const TABLE: [u64; 256] = table();

const fn table() -> [u64; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut rest, mut bit) = (byte as u64, 0);
        while bit < 8 {
            rest = if rest & 1 == 1 { (rest >> 1) ^ POLYNOMIAL } else { rest >> 1 };
            bit += 1;
        }
        table[byte] = rest;
        byte += 1;
    }
    table
}

/// A checksum that grows with what it is given.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Checksum(u64);

impl Checksum {
    /// Goes on with these bytes.
    pub(super) fn add(&mut self, bytes: &[u8]) {
        let step = |rest: u64, byte: &u8| {
            let [low, ..] = rest.to_le_bytes();
            TABLE.get(usize::from(low ^ byte)).copied().unwrap_or_default() ^ (rest >> 8)
        };
        self.0 = !bytes.iter().fold(!self.0, step);
    }

    /// The checksum as an archive writes it.
    pub(super) fn value(self) -> i64 {
        self.0.cast_signed()
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
