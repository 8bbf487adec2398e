//! A change stream of the server, passed on to a client as the server sends it.
//!
//! The driver's own streams do not say where a batch ends, so that whoever passes batches on would wait behind each. Here the
//! commands are sent as they are: `aggregate`, `getMore`, `killCursors`.

use std::time::{Duration, Instant};

use bson::{Bson, DateTime, Document, RawArrayBuf, RawDocumentBuf, Timestamp, doc};
use mongodb::options::{ReadPreference, SelectionCriteria};
use mongodb::sync::{Client, ClientSession};

use super::action::max_time;
use super::{MongoDb, failure};
use crate::query::QueryError;
use crate::saturate::to_i64;
use crate::store::{EventRequest, Events, Scope, ServerEvents, StoreError};

/// How long failed requests may take together before the stream ends with an error.
const RESUME_TIMEOUT: Duration = Duration::from_secs(30);
/// How long opening a stream is tried. The driver itself looks for a primary for 4 s.
const OPEN_TIMEOUT: Duration = Duration::from_secs(4);
/// At most so many events are asked for at once …
const MOST: u64 = 1_000;
/// … and, by the size of those before, no more than about so many bytes: the driver decodes all of them, into about
/// ten times as much memory, before they are passed on.
const MOST_BYTES: u64 = 1 << 20;
/// How long a server that was just lost is not asked again.
const RETRY_INTERVAL: Duration = Duration::from_millis(200);
/// Where a stream begins: by one of these.
const STARTS: [&str; 3] = ["resumeAfter", "startAfter", "startAtOperationTime"];

/// An open change stream.
struct ServerStream {
    client: Client,
    address: String,
    /// The cursor belongs to it.
    session: ClientSession,
    request: EventRequest,
    cursor: Cursor,
    /// Behind what was given.
    token: Option<Document>,
    /// How many events are asked for at once.
    most: u64,
    /// How long requests have failed since the last answer.
    away: Duration,
}

/// The cursor of the stream on the server.
enum Cursor {
    Open {
        id: i64,
        collection: String,
    },
    /// The server, or its cursor, was lost: the stream is to be opened again.
    Lost,
    /// The server has ended it.
    Over,
}

impl MongoDb {
    pub(super) fn open_events(
        &self,
        mut request: EventRequest,
        most: Option<u64>,
    ) -> Result<(Box<dyn ServerEvents>, Events), StoreError> {
        let explain = |error: mongodb::error::Error| explain(&self.address, &error);
        if let Some(since) = request.since {
            let hello = self.hello().map_err(explain)?;
            if let Ok(now) = hello.get_datetime("localTime") {
                request.options.insert("startAtOperationTime", second_of(*now, since.elapsed()));
            }
        }
        let mut stream = ServerStream {
            client: self.client().clone(),
            address: self.address.clone(),
            session: session(self.client()).map_err(explain)?,
            request,
            cursor: Cursor::Lost,
            token: None,
            most: MOST,
            away: Duration::ZERO,
        };
        let since = Instant::now();
        let answer = loop {
            match stream.open(most) {
                Err(error) if failure::is_passing(&error) && since.elapsed() < OPEN_TIMEOUT => {
                    std::thread::sleep(RETRY_INTERVAL);
                }
                opened => break opened.map_err(explain)?,
            }
        };
        let first = stream.receive(&answer)?;
        Ok((Box::new(stream), first))
    }
}

/// The beginning of the second in which a time lies that was so long before another.
fn second_of(now: DateTime, ago: Duration) -> Timestamp {
    let millis = now.timestamp_millis().saturating_sub(to_i64(ago.as_millis()));
    Timestamp { time: u32::try_from(millis.div_euclid(1000)).unwrap_or_default(), increment: 1 }
}

/// A session whose reads do not wait for what it has seen.
fn session(client: &Client) -> mongodb::error::Result<ClientSession> {
    client.start_session().causal_consistency(false).run()
}

impl ServerStream {
    /// Opens the stream of the server, behind what was given, or else where it was asked to begin.
    fn open(&mut self, most: Option<u64>) -> mongodb::error::Result<Document> {
        let request = &self.request;
        let mut options = request.options.clone();
        if let Some(token) = &self.token {
            STARTS.iter().for_each(|name| drop(options.remove(name)));
            options.insert("startAfter", token.clone());
        }
        let (database, target) = match &request.scope {
            Scope::Collection(ns) => (ns.database.as_str(), Bson::from(ns.collection.as_str())),
            Scope::Database(database) => (database.as_str(), 1.into()),
            Scope::All => {
                options.insert("allChangesForCluster", true);
                ("admin", 1.into())
            }
        };
        let mut stages = vec![doc! { "$changeStream": options }];
        stages.extend(request.stages.iter().cloned());
        let cursor = most.map(|most| sized(most.min(self.most))).unwrap_or_default();
        let mut command = doc! { "aggregate": target, "pipeline": stages, "cursor": cursor };
        for (name, value) in [("collation", &request.collation), ("let", &request.variables)] {
            command.extend(value.clone().map(|value| (name.to_owned(), value.into())));
        }
        command.extend(max_time().map(|limit| ("maxTimeMS".to_owned(), limit.into())));
        let database = database.to_owned();
        self.run(&database, command)
    }

    fn run(&mut self, database: &str, command: Document) -> mongodb::error::Result<Document> {
        let primary = SelectionCriteria::ReadPreference(ReadPreference::Primary);
        let database = self.client.database(database);
        database.run_command(command).selection_criteria(primary).session(&mut self.session).run()
    }

    /// One question to the server.
    fn ask(&mut self, most: Option<u64>, wait: Duration) -> mongodb::error::Result<Option<Document>> {
        match &self.cursor {
            Cursor::Over => Ok(None),
            Cursor::Lost => {
                self.session = session(&self.client)?;
                self.open(most).map(Some)
            }
            Cursor::Open { id, collection } => {
                // Servers differ in what 0 means.
                let wait = to_i64(wait.as_millis()).max(1);
                let mut command = doc! { "getMore": id, "collection": collection, "maxTimeMS": wait };
                command.extend(sized(most.map_or(self.most, |most| most.min(self.most))));
                let database = database_of(&self.request.scope).to_owned();
                self.run(&database, command).map(Some)
            }
        }
    }

    /// Reads an answer with events.
    fn receive(&mut self, answer: &Document) -> Result<Events, StoreError> {
        let cursor = answer.get_document("cursor").map_err(|error| self.unclear(&error.to_string()))?;
        let id = cursor.get_i64("id").map_err(|error| self.unclear(&error.to_string()))?;
        let batch = cursor.get_array("nextBatch").or_else(|_| cursor.get_array("firstBatch"));
        let (mut events, mut count, mut last) = (RawArrayBuf::new(), 0, None);
        for event in batch.into_iter().flatten().filter_map(Bson::as_document) {
            events.push(RawDocumentBuf::try_from(event).map_err(QueryError::from)?.as_ref());
            (count, last) = (count + 1, event.get_document("_id").ok());
        }
        if let Some(size) = (events.as_bytes().len() as u64).checked_div(count as u64) {
            self.most = (MOST_BYTES / size.max(1)).clamp(1, MOST);
        }
        let token = cursor.get_document("postBatchResumeToken").ok().or(last).cloned();
        self.token = token.or_else(|| self.token.take());
        let name = cursor.get_str("ns").unwrap_or_default().split_once('.');
        self.cursor = match (id, name) {
            (0, _) => Cursor::Over,
            (id, name) => Cursor::Open { id, collection: name.map_or("", |(_, name)| name).to_owned() },
        };
        Ok(Events { events, count, token: self.token.clone(), is_over: id == 0 })
    }

    /// Closes the cursor on the server in the background. If that fails, the server closes the idle cursor after ten minutes.
    fn close(&self) {
        let Cursor::Open { id, collection } = &self.cursor else { return };
        let database = self.client.database(database_of(&self.request.scope));
        let command = doc! { "killCursors": collection, "cursors": [*id] };
        std::thread::spawn(move || database.run_command(command).run());
    }

    fn nothing(&self) -> Events {
        let is_over = matches!(self.cursor, Cursor::Over);
        Events { events: RawArrayBuf::new(), count: 0, token: self.token.clone(), is_over }
    }

    fn unclear(&self, reason: &str) -> StoreError {
        let reason = format!("its answer about a change stream cannot be read: {reason}");
        StoreError::Failed { address: self.address.clone(), reason }
    }
}

impl ServerEvents for ServerStream {
    fn next(&mut self, most: Option<u64>, wait: Duration) -> Result<Events, StoreError> {
        let since = Instant::now();
        match self.ask(most, wait) {
            Ok(answer) => {
                self.away = Duration::ZERO;
                match answer {
                    Some(answer) => self.receive(&answer),
                    None => Ok(self.nothing()),
                }
            }
            // A stream without a resume token cannot be resumed.
            Err(error) if failure::is_passing(&error) && self.token.is_some() => {
                self.close();
                self.cursor = Cursor::Lost;
                if self.away > RESUME_TIMEOUT {
                    return Err(explain(&self.address, &error));
                }
                std::thread::sleep(wait.min(RETRY_INTERVAL).saturating_sub(since.elapsed()));
                self.away += since.elapsed();
                Ok(self.nothing())
            }
            Err(error) => Err(explain(&self.address, &error)),
        }
    }
}

impl Drop for ServerStream {
    fn drop(&mut self) {
        self.close();
    }
}

/// The database to whose cursors that of the stream belongs.
fn database_of(scope: &Scope) -> &str {
    scope.database().unwrap_or("admin")
}

fn sized(most: u64) -> Document {
    doc! { "batchSize": to_i64(most) }
}

fn explain(address: &str, error: &mongodb::error::Error) -> StoreError {
    match failure::code(error) {
        Some(failure::NO_STREAMS) => {
            StoreError::Failed { address: address.to_owned(), reason: failure::STANDALONE.to_owned() }
        }
        _ if failure::is_passing(error) => StoreError::unreachable(address, failure::brief(error)),
        _ => failure::explain(address, error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_begins_with_the_second_of_its_time_by_the_servers_clock() {
        let now = DateTime::from_millis(1_800_000_010_250);
        let begin = |millis| second_of(now, Duration::from_millis(millis)).time;
        assert_eq!(
            [0, 250, 251, 10_250, 10_251].map(begin),
            [10, 10, 9, 0, u32::MAX].map(|n: u32| n.wrapping_add(1_800_000_000))
        );
    }
}
