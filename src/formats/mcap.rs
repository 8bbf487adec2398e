//! MCAP logs with messages as JSON, as Foxglove, PlotJuggler and rerun read them.
//!
//! Source: the MCAP specification and its registry of encodings (`jsonschema`, `json`), at mcap.dev.

use std::collections::BTreeMap;
use std::io::Write;

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};

use crate::fault::{AtFault, Fault};

impl AtFault for McapError {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

/// A log that is written as it comes, in chunks.
pub struct Log<W: Write> {
    writer: Writer<NoSeek<W>>,
    counts: BTreeMap<u16, u32>,
}

/// A channel of a log.
#[derive(Debug, Clone, Copy)]
pub struct Channel(u16);

impl<W: Write> Log<W> {
    /// Begins a log.
    ///
    /// # Errors
    /// Where `out` fails.
    pub fn new(out: W) -> Result<Self, McapError> {
        let options = WriteOptions::new().compression(None).library("rmem").disable_seeking(true);
        let writer = options.create(NoSeek::new(out))?;
        Ok(Self { writer, counts: BTreeMap::new() })
    }

    /// Adds a topic with messages of a JSON schema.
    ///
    /// # Errors
    /// Where `out` fails.
    pub fn channel(&mut self, topic: &str, schema: &str, definition: &str) -> Result<Channel, McapError> {
        let schema = self.writer.add_schema(schema, "jsonschema", definition.as_bytes())?;
        self.writer.add_channel(schema, topic, "json", &BTreeMap::new()).map(Channel)
    }

    /// Adds a message; `time` is in nanoseconds since 1970.
    ///
    /// # Errors
    /// Where `out` fails.
    pub fn message(&mut self, channel: Channel, time: u64, json: &str) -> Result<(), McapError> {
        let sequence = self.counts.entry(channel.0).or_default();
        let header = MessageHeader { channel_id: channel.0, sequence: *sequence, log_time: time, publish_time: time };
        *sequence = sequence.wrapping_add(1);
        self.writer.write_to_known_channel(&header, json.as_bytes())
    }

    /// Ends the log; without it, readers find it cut off.
    ///
    /// # Errors
    /// Where `out` fails.
    pub fn finish(mut self) -> Result<(), McapError> {
        self.writer.finish().map(drop)
    }
}
