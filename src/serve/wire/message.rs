//! What clients send: a command, as OP_MSG or OP_QUERY.

use std::io::{BufRead as _, BufReader, Read};

use bson::{Bson, Document, RawDocument};

use super::bytes::Bytes;
use super::checksum::crc32c;
use super::{HEADER, MAX_MESSAGE, OP_COMPRESSED, OP_MSG, OP_QUERY, WireError, compression};
use crate::query::{QueryError, decode, decode_but};

/// OP_MSG: the message ends with a checksum.
const CHECKSUM_PRESENT: u32 = 1;
/// OP_MSG: no answer is wanted.
const MORE_TO_COME: u32 = 1 << 1;
/// OP_MSG: whoever does not know one of these bits has to refuse the message.
const REQUIRED: u32 = 0xFFFF;
/// Memory that is taken at once for a message as long as that; most are shorter.
const PROMPT: usize = 4 << 10;
/// What drivers pass on to every server of a cluster, of which this is the only one.
const CLUSTER_TIME: &str = "$clusterTime";

/// How a command came, and so how it is answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// OP_MSG.
    Msg,
    /// OP_QUERY, of which only handshakes are left.
    Query,
}

/// A command as it came.
#[derive(Debug)]
pub struct Message {
    /// The client's number for it.
    pub id: i32,
    /// How it came.
    pub form: Form,
    /// Whether it came compressed.
    pub is_compressed: bool,
    /// Whether an answer is wanted.
    pub wants_reply: bool,
    /// The command with its document sequences; or why it cannot be read, though the message can.
    pub command: Result<Document, QueryError>,
}

/// Reads a message; gives its length, too. There has to be at least one byte.
///
/// # Errors
/// Where the bytes are no message that a client may send, or the connection ends within it.
pub(in crate::serve) fn receive(reader: &mut BufReader<impl Read>) -> Result<(Message, usize), WireError> {
    // Nearly all have come as a whole, and are read where they are.
    let come = reader.buffer();
    let length = Bytes(come).length().ok().filter(|length| *length >= HEADER);
    if let Some(whole) = length.and_then(|length| come.get(..length)) {
        let (message, length) = (Message::parse(whole)?, whole.len());
        reader.consume(length);
        return Ok((message, length));
    }
    let bytes = read(reader)?;
    Ok((Message::parse(&bytes)?, bytes.len()))
}

/// Reads the bytes of a message, header included.
///
/// # Errors
/// Where the length is none, or the connection ends within the message.
fn read(reader: &mut impl Read) -> Result<Vec<u8>, WireError> {
    let mut header = [0; HEADER];
    reader.read_exact(&mut header)?;
    let length = Bytes(&header).length()?;
    if !(HEADER..=MAX_MESSAGE).contains(&length) {
        return Err(WireError::malformed(format!("its length is {length}, and not from {HEADER} to {MAX_MESSAGE}")));
    }
    // Memory for more than this is taken as bytes come, not as they are announced.
    let mut message = Vec::with_capacity(length.min(PROMPT));
    message.extend_from_slice(&header);
    let rest = u64::try_from(length - HEADER).unwrap_or(u64::MAX);
    reader.take(rest).read_to_end(&mut message)?;
    if message.len() < length {
        return Err(WireError::Broken(std::io::ErrorKind::UnexpectedEof.into()));
    }
    Ok(message)
}

impl Message {
    /// Reads a message, header included.
    ///
    /// # Errors
    /// Where the bytes are no message that a client may send.
    pub fn parse(message: &[u8]) -> Result<Self, WireError> {
        let mut bytes = Bytes(message);
        if bytes.length()? != message.len() {
            return Err(WireError::malformed("its length is not that of its header"));
        }
        let (id, _, operation) = (bytes.int32()?, bytes.int32()?, bytes.int32()?);
        if operation != OP_COMPRESSED {
            return Self::of(id, operation, bytes.0, message);
        }
        let (operation, body) = compression::unpack(bytes.0)?;
        if operation == OP_COMPRESSED {
            return Err(WireError::malformed("it is compressed twice"));
        }
        Ok(Self { is_compressed: true, ..Self::of(id, operation, &body, &[])? })
    }

    /// `whole` is what a checksum is of; empty where none can be.
    fn of(id: i32, operation: i32, body: &[u8], whole: &[u8]) -> Result<Self, WireError> {
        match operation {
            OP_MSG => Self::msg(id, body, whole),
            OP_QUERY => Self::query(id, body),
            other => Err(WireError::malformed(format!("operation {other} is not known; expected OP_MSG (2013)"))),
        }
    }

    fn msg(id: i32, body: &[u8], whole: &[u8]) -> Result<Self, WireError> {
        let mut bytes = Bytes(body);
        let flags = bytes.int32()?.cast_unsigned();
        if flags & REQUIRED & !(CHECKSUM_PRESENT | MORE_TO_COME) != 0 {
            return Err(WireError::malformed(format!("its flags {flags:#x} are not known")));
        }
        if flags & CHECKSUM_PRESENT != 0 {
            bytes = Bytes(checked(bytes.0, whole)?);
        }
        let sections = Sections::read(bytes)?;
        let wants_reply = flags & MORE_TO_COME == 0;
        Ok(Self { id, form: Form::Msg, is_compressed: false, wants_reply, command: sections.command() })
    }

    fn query(id: i32, body: &[u8]) -> Result<Self, WireError> {
        let mut bytes = Bytes(body);
        let _flags = bytes.int32()?;
        let collection = bytes.text()?;
        let Some(database) = collection.strip_suffix(".$cmd") else {
            return Err(WireError::malformed(format!(
                "OP_QUERY of `{collection}`; expected a handshake, of admin.$cmd"
            )));
        };
        let (_skip, _return) = (bytes.int32()?, bytes.int32()?);
        let command = decode(bytes.document()?).map(|command| unwrapped(command, database));
        Ok(Self { id, form: Form::Query, is_compressed: false, wants_reply: true, command })
    }
}

/// The command without the `$query` that old drivers wrap it in, and with its database.
fn unwrapped(command: Document, database: &str) -> Document {
    let mut inner = match command.get("$query").or_else(|| command.get("query")) {
        Some(Bson::Document(inner)) => inner.clone(),
        _ => command,
    };
    inner.insert("$db", database);
    inner
}

/// The bytes before a checksum, which is of the whole message but itself.
fn checked<'a>(bytes: &'a [u8], whole: &[u8]) -> Result<&'a [u8], WireError> {
    let split = |bytes: &'_ [u8]| bytes.len().checked_sub(4);
    let end = split(bytes).ok_or_else(|| WireError::malformed("it ends before its checksum"))?;
    let (body, sum) = bytes.split_at(end);
    let covered = split(whole).and_then(|end| whole.get(..end));
    let wanted = Bytes(sum).int32()?.cast_unsigned();
    match covered {
        Some(covered) if crc32c(covered) != wanted => Err(WireError::malformed("its checksum is wrong")),
        _ => Ok(body),
    }
}

/// The sections of an OP_MSG.
struct Sections<'a> {
    body: &'a RawDocument,
    sequences: Vec<(&'a str, Vec<&'a RawDocument>)>,
}

impl<'a> Sections<'a> {
    fn read(mut bytes: Bytes<'a>) -> Result<Self, WireError> {
        let (mut body, mut sequences) = (None, Vec::new());
        while !bytes.is_empty() {
            match bytes.byte()? {
                0 if body.is_none() => body = Some(bytes.document()?),
                0 => return Err(WireError::malformed("it has two commands")),
                1 => sequences.push(sequence(&mut bytes)?),
                kind => return Err(WireError::malformed(format!("sections of kind {kind} are not known"))),
            }
        }
        let body = body.ok_or_else(|| WireError::malformed("it has no command"))?;
        Ok(Self { body, sequences })
    }

    /// The command, with each sequence as an array.
    fn command(self) -> Result<Document, QueryError> {
        let mut command = decode_but(self.body, CLUSTER_TIME)?;
        for (name, documents) in self.sequences {
            if command.contains_key(name) {
                let message = format!("the command has `{name}` twice, in its body and as a sequence");
                return Err(QueryError::invalid(40_415, message));
            }
            let documents = documents.into_iter().map(|raw| decode(raw).map(Bson::Document));
            command.insert(name, documents.collect::<Result<Vec<_>, _>>()?);
        }
        Ok(command)
    }
}

fn sequence<'a>(bytes: &mut Bytes<'a>) -> Result<(&'a str, Vec<&'a RawDocument>), WireError> {
    let length = bytes.length()?;
    let rest = length.checked_sub(4).ok_or_else(|| WireError::malformed("a sequence is shorter than its length"))?;
    let mut inner = Bytes(bytes.take(rest)?);
    let name = inner.text()?;
    let mut documents = Vec::new();
    while !inner.is_empty() {
        documents.push(inner.document()?);
    }
    Ok((name, documents))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{RawDocumentBuf, doc};

    fn raw(document: &Document) -> Vec<u8> {
        RawDocumentBuf::try_from(document).unwrap().into_bytes()
    }

    fn message(operation: i32, body: &[u8]) -> Vec<u8> {
        let length = i32::try_from(HEADER + body.len()).unwrap();
        let mut bytes: Vec<u8> = [length, 7, 0, operation].iter().flat_map(|number| number.to_le_bytes()).collect();
        bytes.extend_from_slice(body);
        bytes
    }

    fn msg(flags: u32, sections: &[u8]) -> Vec<u8> {
        message(OP_MSG, &[&flags.to_le_bytes(), sections].concat())
    }

    fn insert() -> Vec<u8> {
        let documents = [raw(&doc! { "_id": 1 }), raw(&doc! { "_id": 2 })].concat();
        let length = i32::try_from(4 + b"documents\0".len() + documents.len()).unwrap();
        let command = doc! { "insert": "c", "$db": "d" };
        [b"\0".as_slice(), &raw(&command), b"\x01", &length.to_le_bytes(), b"documents\0", &documents].concat()
    }

    #[test]
    fn a_sequence_becomes_an_array_of_the_command() {
        let message = Message::parse(&msg(0, &insert())).unwrap();
        assert_eq!(
            message.command.unwrap(),
            doc! { "insert": "c", "$db": "d", "documents": [{ "_id": 1 }, { "_id": 2 }] }
        );
        assert!(message.wants_reply && message.id == 7);
        assert!(!Message::parse(&msg(MORE_TO_COME, &insert())).unwrap().wants_reply);
    }

    #[test]
    fn messages_are_received_as_a_whole_or_in_pieces() {
        let one = msg(0, &insert());
        let three = [one.as_slice(), &one, &one].concat();
        for capacity in [1, 8, 16, one.len() + 5, three.len()] {
            let mut reader = BufReader::with_capacity(capacity, three.as_slice());
            for _ in 0..3 {
                assert!(!reader.fill_buf().unwrap().is_empty());
                let (message, length) = receive(&mut reader).unwrap();
                assert_eq!((message.id, length), (7, one.len()));
            }
            assert!(reader.fill_buf().unwrap().is_empty());
        }
        let mut short = BufReader::new(&one[..40]);
        assert!(!short.fill_buf().unwrap().is_empty() && receive(&mut short).is_err());
    }

    #[test]
    fn a_compressed_message_is_the_message_in_it() {
        let packed = compression::pack(OP_MSG, &[&0_u32.to_le_bytes(), insert().as_slice()].concat()).unwrap();
        let message = Message::parse(&message(OP_COMPRESSED, &packed)).unwrap();
        assert!(message.is_compressed && message.command.unwrap().contains_key("documents"));
    }

    #[test]
    fn a_checksum_is_checked() {
        let mut bytes = msg(CHECKSUM_PRESENT, &[insert().as_slice(), &[0; 4]].concat());
        let end = bytes.len() - 4;
        assert!(Message::parse(&bytes).is_err());
        let sum = crc32c(&bytes[..end]);
        bytes[end..].copy_from_slice(&sum.to_le_bytes());
        assert!(Message::parse(&bytes).is_ok());
    }

    #[test]
    fn a_handshake_may_come_as_a_query() {
        let body = [&[0; 4], b"admin.$cmd\0".as_slice(), &[0; 8], &raw(&doc! { "isMaster": 1 })].concat();
        let message = Message::parse(&message(OP_QUERY, &body)).unwrap();
        assert_eq!((message.form, message.command.unwrap()), (Form::Query, doc! { "isMaster": 1, "$db": "admin" }));
    }

    #[test]
    fn what_is_no_message_is_refused() {
        let twice = [b"\0".as_slice(), &raw(&doc! { "a": 1 }), b"\0", &raw(&doc! { "a": 1 })].concat();
        for wrong in [
            msg(0, b""),
            msg(0, b"\x02"),
            msg(1 << 5, &insert()),
            msg(0, &twice),
            msg(0, b"\x01\x03\0\0\0"),
            message(2010, b""),
            message(OP_QUERY, b"\0\0\0\0a.b\0"),
        ] {
            assert!(Message::parse(&wrong).is_err(), "{wrong:?}");
        }
        assert!(read(&mut [9_u8; 16].as_slice()).is_err());
        assert!(read(&mut &msg(0, &insert())[..40]).is_err());
    }

    #[test]
    fn what_is_nested_too_deeply_is_an_error_of_the_command() {
        let mut nested = doc! {};
        for _ in 0..300 {
            nested = doc! { "a": nested };
        }
        let sections = [b"\0".as_slice(), &raw(&nested)].concat();
        assert_eq!(Message::parse(&msg(0, &sections)).unwrap().command.unwrap_err().code, 15);
    }
}
