//! OP_COMPRESSED: a message within a message. Of the ways to compress, zlib is understood.

use std::io::{Read as _, Write as _};

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;

use super::bytes::Bytes;
use super::{HEADER, MAX_MESSAGE, WireError};

/// The name drivers know it by.
pub(in crate::serve) const ZLIB: &str = "zlib";

const NONE_ID: u8 = 0;
const ZLIB_ID: u8 = 2;

/// The operation code and body of the message in an OP_COMPRESSED body.
pub(super) fn unpack(body: &[u8]) -> Result<(i32, Vec<u8>), WireError> {
    let mut bytes = Bytes(body);
    let operation = bytes.int32()?;
    let length = bytes.length()?;
    if length > MAX_MESSAGE - HEADER {
        return Err(WireError::malformed(format!("it unpacks to {length} bytes, more than are allowed")));
    }
    let compressor = bytes.byte()?;
    let packed = bytes.0;
    let unpacked = match compressor {
        NONE_ID => packed.to_vec(),
        ZLIB_ID => inflate(packed, length)?,
        other => return Err(WireError::malformed(format!("compressor {other} was not agreed on; expected zlib"))),
    };
    if unpacked.len() != length {
        return Err(WireError::malformed(format!("it unpacks to {} bytes, not {length}", unpacked.len())));
    }
    Ok((operation, unpacked))
}

/// What was packed, up to a byte more than there should be: then it is refused.
fn inflate(packed: &[u8], length: usize) -> Result<Vec<u8>, WireError> {
    let mut unpacked = Vec::new();
    let limit = u64::try_from(length).unwrap_or(u64::MAX).saturating_add(1);
    let read = ZlibDecoder::new(packed).take(limit).read_to_end(&mut unpacked);
    read.map_err(|error| WireError::malformed(format!("it is not zlib data: {error}")))?;
    Ok(unpacked)
}

/// The body of an OP_COMPRESSED around a message's body.
pub(super) fn pack(operation: i32, body: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut packed = Vec::with_capacity(body.len() / 2 + 9);
    packed.extend_from_slice(&operation.to_le_bytes());
    packed.extend_from_slice(&i32::try_from(body.len()).unwrap_or(i32::MAX).to_le_bytes());
    packed.push(ZLIB_ID);
    let mut encoder = ZlibEncoder::new(packed, Compression::fast());
    encoder.write_all(body)?;
    encoder.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_packed_is_unpacked() {
        let body = b"robot robot robot".repeat(100);
        let packed = pack(2013, &body).unwrap();
        assert!(packed.len() < body.len());
        assert_eq!(unpack(&packed).unwrap(), (2013, body));
    }

    #[test]
    fn a_wrong_length_is_refused_before_it_takes_memory() {
        let mut packed = pack(2013, &[0; 1 << 20]).unwrap();
        packed[4..8].copy_from_slice(&100_i32.to_le_bytes());
        assert!(unpack(&packed).is_err());
        packed[4..8].copy_from_slice(&i32::MAX.to_le_bytes());
        assert!(unpack(&packed).is_err());
        packed[8] = 1;
        assert!(unpack(&packed).is_err());
    }
}
