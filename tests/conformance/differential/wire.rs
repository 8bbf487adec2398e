//! A connection to a mongod with its wire protocol and nothing else: several commands are
//! sent before the first reply is read, and what mongod says is taken where it is not UTF-8, too.

use std::io::{self, BufReader, Read as _, Write as _};
use std::net::{Ipv4Addr, TcpStream};

use bson::{Document, RawDocument, Utf8Lossy};

/// The one kind of message that is spoken (`OP_MSG`), and the length of what is in front of its document:
/// four numbers of 32 bits, as many for flags, and a byte that says that a document follows.
const MESSAGE: i32 = 2013;
const HEAD: usize = 4 * 4 + 4 + 1;
/// No message of a mongod is longer, in bytes.
const LONGEST: usize = 48_000_000;

pub(super) struct Connection {
    stream: BufReader<TcpStream>,
    database: String,
}

impl Connection {
    pub(super) fn open(port: u16, database: &str) -> io::Result<Self> {
        let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port))?;
        stream.set_nodelay(true)?;
        Ok(Self { stream: BufReader::new(stream), database: database.to_owned() })
    }

    /// The replies to commands, in their order. An error of mongod is a reply, too.
    pub(super) fn ask(&mut self, commands: &[Document]) -> io::Result<Vec<Document>> {
        let mut messages = Vec::new();
        for command in commands {
            let mut command = command.clone();
            command.insert("$db", &self.database);
            let body = command.to_vec().map_err(io::Error::other)?;
            let length = i32::try_from(HEAD + body.len()).map_err(io::Error::other)?;
            for number in [length, 0, 0, MESSAGE, 0] {
                messages.extend(number.to_le_bytes());
            }
            messages.push(0);
            messages.extend(body);
        }
        self.stream.get_mut().write_all(&messages)?;
        commands.iter().map(|_| self.reply()).collect()
    }

    fn reply(&mut self) -> io::Result<Document> {
        let mut head = [0; HEAD];
        self.stream.read_exact(&mut head)?;
        let [a, b, c, d, ..] = head;
        let length = usize::try_from(i32::from_le_bytes([a, b, c, d])).map_err(io::Error::other)?;
        if !(HEAD..=LONGEST).contains(&length) {
            return Err(io::Error::other(format!("a reply of {length} bytes")));
        }
        let mut body = vec![0; length - HEAD];
        self.stream.read_exact(&mut body)?;
        let raw = RawDocument::from_bytes(&body).map_err(io::Error::other)?;
        // Messages of mongod quote strings that it has cut within a character.
        let lossy = |_| Utf8Lossy::<Document>::try_from(raw).map(|reply| reply.0);
        Document::try_from(raw).or_else(lossy).map_err(io::Error::other)
    }
}
