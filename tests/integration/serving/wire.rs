//! A client that sends exactly what the test wants, on a connection of its own.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use bson::{Document, RawDocumentBuf, doc};
use libtest_mimic::Failed;

/// A connection.
pub(super) struct Wire(TcpStream);

impl Wire {
    pub(super) fn connect(address: &str) -> Result<Self, Failed> {
        let stream = TcpStream::connect(address)?;
        stream.set_read_timeout(Some(Duration::from_secs(60)))?;
        stream.set_nodelay(true)?;
        Ok(Self(stream))
    }

    /// Sends a command and gives its answer.
    pub(super) fn run(&mut self, command: &Document) -> Result<Document, Failed> {
        self.send(&message(command))?;
        self.receive()
    }

    pub(super) fn send(&mut self, bytes: &[u8]) -> Result<(), Failed> {
        Ok(self.0.write_all(bytes)?)
    }

    pub(super) fn receive(&mut self) -> Result<Document, Failed> {
        self.receive_behind(5)
    }

    /// Sends a command to the database `admin` as OP_QUERY, as drivers of before 2020 begin, and gives its answer.
    pub(super) fn query(&mut self, command: &Document) -> Result<Document, Failed> {
        let body = RawDocumentBuf::try_from(command)?.into_bytes();
        let mut query = vec![0; 4];
        query.extend_from_slice(b"admin.$cmd\0");
        query.extend([0, 1].iter().flat_map(|number: &u32| number.to_le_bytes()));
        query.extend(body);
        let length = u32::try_from(16 + query.len())?;
        let header = [length, 1, 0, 2004].into_iter().flat_map(|number| number.to_le_bytes());
        self.send(&header.chain(query).collect::<Vec<u8>>())?;
        self.receive_behind(20)
    }

    /// A document behind so many bytes of the message's body.
    fn receive_behind(&mut self, start: usize) -> Result<Document, Failed> {
        let mut header = [0; 16];
        self.0.read_exact(&mut header)?;
        let length = u32::from_le_bytes([header[0], header[1], header[2], header[3]]) as usize;
        let mut body = vec![0; length - 16];
        self.0.read_exact(&mut body)?;
        Ok(Document::try_from(&*RawDocumentBuf::from_bytes(body[start..].to_vec())?)?)
    }

    /// Waits until the server closes the connection, or says something.
    pub(super) fn drain(&mut self) {
        let _ = self.0.shutdown(std::net::Shutdown::Write);
        let _ = std::io::copy(&mut self.0, &mut std::io::sink());
    }
}

/// What the server says of itself.
pub(super) fn status(wire: &mut Wire, part: &str) -> Result<Document, Failed> {
    Ok(wire.run(&doc! { "serverStatus": 1, "$db": "admin" })?.get_document(part)?.clone())
}

/// How many clients are connected.
pub(super) fn connected(wire: &mut Wire) -> Result<i64, Failed> {
    Ok(status(wire, "connections")?.get_i32("current")?.into())
}

/// A command as OP_MSG.
pub(super) fn message(command: &Document) -> Vec<u8> {
    let body = RawDocumentBuf::try_from(command).map(RawDocumentBuf::into_bytes).unwrap_or_default();
    let length = u32::try_from(21 + body.len()).unwrap_or_default();
    let mut message = Vec::new();
    for number in [length, 1, 0, 2013, 0] {
        message.extend_from_slice(&number.to_le_bytes());
    }
    message.push(0);
    message.extend_from_slice(&body);
    message
}
