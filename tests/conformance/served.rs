//! Recorded commands, sent to `rmem serve` as a client sends them: those with options that only a server has a word for.

use std::collections::{BTreeSet, HashMap};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use bson::{Bson, Document, RawDocumentBuf, doc};
use tempfile::TempDir;

use crate::command::{Answer, Failure};
use crate::server::recorded_host;

/// What rmem refuses by name, commands that it does not have, and snapshots of the past.
const REFUSALS: [i32; 3] = [115, 59, 246];

/// A process that serves an empty memory, and a connection to it.
pub(crate) struct Served {
    child: Child,
    stream: TcpStream,
    /// The server's cursors by the numbers that they have in the recording.
    cursors: HashMap<i64, i64>,
    /// The server's resume tokens by those of the recording.
    tokens: HashMap<String, Bson>,
    databases: BTreeSet<String>,
    _folder: TempDir,
}

impl Served {
    pub(crate) fn start() -> std::io::Result<Self> {
        let folder = tempfile::tempdir()?;
        let mut child = Command::new(env!("CARGO_BIN_EXE_rmem"))
            .args(["--memory", "mem:", "serve", "--print-uri", "--listen", "127.0.0.1:0"])
            .current_dir(folder.path())
            .env("HOME", folder.path())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()?;
        let mut uri = String::new();
        if let Some(stdout) = child.stdout.take() {
            BufReader::new(stdout).read_line(&mut uri)?;
        }
        let address = uri.trim().trim_start_matches("mongodb://").split('/').next().unwrap_or_default().to_owned();
        let stream = TcpStream::connect(address)?;
        stream.set_read_timeout(Some(Duration::from_secs(60)))?;
        stream.set_nodelay(true)?;
        Ok(Self {
            child,
            stream,
            cursors: HashMap::new(),
            tokens: HashMap::new(),
            databases: BTreeSet::new(),
            _folder: folder,
        })
    }

    /// Forgets what the case before this one has written.
    pub(crate) fn clear(&mut self) -> std::io::Result<()> {
        self.cursors.clear();
        self.tokens.clear();
        for database in std::mem::take(&mut self.databases) {
            self.send(&doc! { "dropDatabase": 1, "$db": database })?;
        }
        Ok(())
    }

    /// The answer to a command.
    pub(crate) fn run(&mut self, command: &Document, recorded: &Document) -> Answer {
        let mut command = command.clone();
        if let Ok(cursor) = command.get_i64("getMore") {
            command.insert("getMore", self.cursors.get(&cursor).copied().unwrap_or(cursor));
        }
        if let Some(pipeline) = command.get_mut("pipeline") {
            self.translate(pipeline);
        }
        self.databases.insert(command.get_str("$db").unwrap_or_default().to_owned());
        let reply = self.send(&command).map_err(|error| Failure::Failed(format!("the connection: {error}")))?;
        let code = reply.get_i32("code").unwrap_or_default();
        if REFUSALS.contains(&code) {
            return Err(Failure::Refused(reply.get_str("errmsg").unwrap_or_default().to_owned()));
        }
        if reply.get("ok") != Some(&Bson::Double(1.0)) {
            return Err(Failure::Failed(format!("{code}: {}", reply.get_str("errmsg").unwrap_or_default())));
        }
        if refuses(&reply) {
            return Err(Failure::Refused("a statement".to_owned()));
        }
        if has_figures(recorded) {
            return Err(Failure::Refused("figures of mongod's own".to_owned()));
        }
        let cursor = |reply: &Document| reply.get_document("cursor").ok().and_then(|cursor| cursor.get_i64("id").ok());
        if let (Some(theirs), Some(ours)) = (cursor(recorded), cursor(&reply)) {
            self.cursors.insert(theirs, ours);
        }
        let mut reply = reply;
        take_host(&mut reply, recorded);
        self.learn(recorded, &reply);
        Ok(reply)
    }

    /// Puts the server's own resume tokens in place of recorded ones.
    fn translate(&self, value: &mut Bson) {
        match value {
            Bson::Document(document) => {
                if let Some(own) = document.get_str("_data").ok().and_then(|data| self.tokens.get(data)) {
                    document.insert("_data", own.clone());
                }
                document.iter_mut().for_each(|(_, value)| self.translate(value));
            }
            Bson::Array(values) => values.iter_mut().for_each(|value| self.translate(value)),
            _ => {}
        }
    }

    /// Notes which token of the server is which of the recording.
    fn learn(&mut self, recorded: &Document, reply: &Document) {
        for (name, theirs) in recorded {
            match (theirs, reply.get(name)) {
                (Bson::Document(theirs), Some(Bson::Document(ours))) => {
                    if let (Ok(data), Some(own)) = (theirs.get_str("_data"), ours.get("_data")) {
                        self.tokens.insert(data.to_owned(), own.clone());
                    }
                    self.learn(theirs, ours);
                }
                (Bson::Array(theirs), Some(Bson::Array(ours))) => {
                    for (theirs, ours) in theirs.iter().zip(ours) {
                        if let (Bson::Document(theirs), Bson::Document(ours)) = (theirs, ours) {
                            self.learn(theirs, ours);
                        }
                    }
                }
                _ => {}
            }
        }
    }

    /// Sends a command as OP_MSG, and reads its answer.
    fn send(&mut self, command: &Document) -> std::io::Result<Document> {
        let body = RawDocumentBuf::try_from(command).map_err(std::io::Error::other)?.into_bytes();
        let length = u32::try_from(21 + body.len()).map_err(std::io::Error::other)?;
        let mut message: Vec<u8> = [length, 1, 0, 2013, 0].iter().flat_map(|number| number.to_le_bytes()).collect();
        message.push(0);
        message.extend_from_slice(&body);
        self.stream.write_all(&message)?;
        let mut header = [0; 16];
        self.stream.read_exact(&mut header)?;
        let length = u32::from_le_bytes([header[0], header[1], header[2], header[3]]) as usize;
        let mut body = vec![0; length.saturating_sub(16)];
        self.stream.read_exact(&mut body)?;
        let document = RawDocumentBuf::from_bytes(body.split_off(5.min(body.len()))).map_err(std::io::Error::other)?;
        Document::try_from(&*document).map_err(std::io::Error::other)
    }
}

/// Whether one of several writes is refused.
fn refuses(reply: &Document) -> bool {
    let errors = reply.get_array("writeErrors").map(Vec::as_slice).unwrap_or_default();
    errors
        .iter()
        .filter_map(Bson::as_document)
        .any(|error| error.get_i32("code").is_ok_and(|code| REFUSALS.contains(&code)))
}

/// Gives documents that name their host that of the recording.
fn take_host(reply: &mut Document, recorded: &Document) {
    let Some(host) = recorded_host(recorded) else { return };
    let Ok(cursor) = reply.get_document_mut("cursor") else { return };
    let Ok(batch) = cursor.get_array_mut("firstBatch") else { return };
    for document in batch.iter_mut().filter_map(Bson::as_document_mut).filter(|document| document.contains_key("host"))
    {
        document.insert("host", host);
    }
}

/// Whether an answer tells of mongod's files, times and threads, which nothing else has.
fn has_figures(recorded: &Document) -> bool {
    let batch = recorded.get_document("cursor").and_then(|cursor| cursor.get_array("firstBatch"));
    let first = batch.ok().and_then(|batch| batch.first()?.as_document());
    first.is_some_and(|first| {
        ["storageStats", "latencyStats", "accesses", "currentOpTime"].iter().any(|name| first.contains_key(*name))
    })
}

impl Drop for Served {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
