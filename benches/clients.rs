//! Servers side by side through the Rust driver: how many operations a second, and how long each takes.
//!
//! `cargo bench --bench clients -- URI [URI] [--connections N] [--seconds S]`
//!
//! Each kind of work is done on each server in turn, for S seconds (default: 3), by N threads (default: 1, then 64) with
//! a connection each. Writes are journaled. The column `client µs` is the processor time that the driver and this program
//! take for an operation: where both cores are busy with it, no server can be quicker. The last kind is how long a change takes until a change stream
//! of another connection has it. Where two servers are given, the last column is the rate of the first one divided by that
//! of the second; of changes, the median time of the second divided by that of the first.

#![allow(clippy::print_stdout)]

use std::sync::Barrier;
use std::sync::mpsc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow, bail, ensure};
use bson::{Document, doc};
use mongodb::options::WriteConcern;
use mongodb::sync::{Client, Collection};
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike as _;

/// How many documents there are at first.
const DOCUMENTS: i64 = 10_000;

type Work = fn(&Collection<Document>, i64) -> mongodb::error::Result<()>;

const WORK: [(&str, Work); 4] = [
    ("insert", |things, n| things.insert_one(thing(n)).run().map(drop)),
    ("find by _id", |things, n| things.find_one(doc! { "_id": n % DOCUMENTS }).run().map(drop)),
    ("indexed find", |things, n| things.find_one(doc! { "name": format!("thing {}", n % DOCUMENTS) }).run().map(drop)),
    ("update", |things, n| {
        things.update_one(doc! { "_id": n % DOCUMENTS }, doc! { "$inc": { "count": 1 } }).run().map(drop)
    }),
];

fn thing(n: i64) -> Document {
    let position = doc! { "x": 1.5, "y": 2.5, "room": "kitchen" };
    doc! { "name": format!("thing {n}"), "position": position, "tidied": false, "count": 0 }
}

/// The collection that is worked on, through a client of its own.
fn collection(uri: &str) -> Result<Collection<Document>> {
    let things = Client::with_uri_str(uri)?.database("bench_clients").collection_with_options(
        "things",
        mongodb::options::CollectionOptions::builder()
            .write_concern(WriteConcern::builder().journal(true).build())
            .build(),
    );
    Ok(things)
}

fn prepare(uri: &str) -> Result<()> {
    let things = collection(uri).with_context(|| uri.to_owned())?;
    things.drop().run()?;
    let documents = (0..DOCUMENTS).map(|n| {
        let mut document = thing(n);
        document.insert("_id", n);
        document
    });
    things.insert_many(documents).run()?;
    things.create_index(mongodb::IndexModel::builder().keys(doc! { "name": 1 }).build()).run()?;
    Ok(())
}

/// The processor time of this process until now.
fn processor_time() -> Result<Duration> {
    let usage = getrusage(UsageWho::RUSAGE_SELF)?;
    let time = usage.user_time() + usage.system_time();
    Ok(Duration::from_micros(u64::try_from(time.num_microseconds())?))
}

/// The times that operations took, in order, how many there were in a second, and the client's processor time for all.
struct Figures {
    times: Vec<Duration>,
    rate: f64,
    client: Duration,
}

impl Figures {
    fn new(mut times: Vec<Duration>, rate: f64, client: Duration) -> Self {
        times.sort_unstable();
        Self { times, rate, client }
    }

    /// The client's processor time for an operation, in microseconds.
    fn client_micros(&self) -> f64 {
        self.client.as_secs_f64() * 1e6 / self.times.len() as f64
    }

    /// The time below which a part of all are, in milliseconds.
    fn at(&self, part: f64) -> f64 {
        let place = ((self.times.len() as f64 * part) as usize).min(self.times.len().saturating_sub(1));
        self.times.get(place).map_or(f64::NAN, |time| time.as_secs_f64() * 1e3)
    }
}

fn measure(uri: &str, work: Work, connections: usize, during: Duration) -> Result<Figures> {
    let barrier = Barrier::new(connections);
    let worker = |seed: usize| -> Result<Vec<Duration>> {
        let things = collection(uri)?;
        things.find_one(doc! { "_id": 0 }).run()?;
        let (mut times, mut n) = (Vec::new(), seed as i64 * 7_919);
        barrier.wait();
        let since = Instant::now();
        while since.elapsed() < during {
            // Neither in order nor the same in all threads (Knuth's multiplier for linear congruences).
            n = n.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let begun = Instant::now();
            work(&things, (n >> 1) & 0x3fff_ffff)?;
            times.push(begun.elapsed());
        }
        Ok(times)
    };
    let before = processor_time()?;
    let times: Vec<Vec<Duration>> = std::thread::scope(|scope| {
        let worker = &worker;
        let workers: Vec<_> = (0..connections).map(|seed| scope.spawn(move || worker(seed))).collect();
        let joined = workers.into_iter().map(|one| one.join().map_err(|_| anyhow!("a worker panicked"))?);
        joined.collect::<Result<_>>()
    })?;
    let times = times.concat();
    let rate = times.len() as f64 / during.as_secs_f64();
    Ok(Figures::new(times, rate, processor_time()?.saturating_sub(before)))
}

/// How long changes take until another connection's change stream has them.
fn changes(uri: &str, during: Duration) -> Result<Figures> {
    let things = collection(uri)?;
    let (sender, received) = mpsc::channel();
    let stream = collection(uri)?.watch().run()?;
    std::thread::spawn(move || {
        for change in stream {
            if change.is_err() || sender.send(Instant::now()).is_err() {
                break;
            }
        }
    });
    let (mut times, since, before) = (Vec::new(), Instant::now(), processor_time()?);
    while since.elapsed() < during {
        let begun = Instant::now();
        things.insert_one(thing(0)).run()?;
        times.push(received.recv_timeout(Duration::from_secs(30))?.saturating_duration_since(begun));
        // A change that comes alone, as those of a robot do.
        std::thread::sleep(Duration::from_millis(10));
    }
    let rate = times.len() as f64 / since.elapsed().as_secs_f64();
    Ok(Figures::new(times, rate, processor_time()?.saturating_sub(before)))
}

fn main() -> Result<()> {
    let (mut uris, mut connections, mut seconds) = (Vec::new(), vec![1, 64], 3.0);
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().with_context(|| format!("{argument} needs a value"));
        match argument.as_str() {
            "--connections" => connections = vec![value()?.parse()?],
            "--seconds" => seconds = value()?.parse()?,
            option if option.starts_with('-') => bail!("unknown option {option}"),
            _ => uris.push(argument),
        }
    }
    ensure!(!uris.is_empty(), "give the URIs of one or two servers");
    let during = Duration::from_secs_f64(seconds);
    uris.iter().try_for_each(|uri| prepare(uri))?;
    println!(
        "{:>11}  {:13}  {:>9}  {:>8}  {:>8}  {:>9}  {:>6}  server",
        "connections", "work", "1/s", "p50 ms", "p99 ms", "client µs", "ratio"
    );
    let row = |connections: usize, name: &str, all: &[Figures], ratio: f64| {
        for (place, (uri, figures)) in uris.iter().zip(all).enumerate() {
            let ratio = if place == 0 && all.len() > 1 { format!("{ratio:.2}") } else { String::new() };
            let (rate, median, tail, own) = (figures.rate, figures.at(0.5), figures.at(0.99), figures.client_micros());
            println!("{connections:11}  {name:13}  {rate:9.0}  {median:8.3}  {tail:8.3}  {own:9.0}  {ratio:>6}  {uri}");
        }
    };
    for connections in connections {
        for (name, work) in WORK {
            let all: Vec<Figures> =
                uris.iter().map(|uri| measure(uri, work, connections, during)).collect::<Result<_>>()?;
            row(connections, name, &all, all[0].rate / all.last().map_or(f64::NAN, |last| last.rate));
        }
    }
    let all: Vec<Figures> = uris.iter().map(|uri| changes(uri, during)).collect::<Result<_>>()?;
    row(1, "change stream", &all, all.last().map_or(f64::NAN, |last| last.at(0.5)) / all[0].at(0.5));
    Ok(())
}
