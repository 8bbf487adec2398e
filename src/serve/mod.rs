//! The memory for every MongoDB client: MongoDB's wire protocol over operations of a memory.
//!
//! A connection is a thread with a memory of its own ([`host`]), which reads without waiting for
//! others. What is written goes through one thread ([`writer`]), which makes what many clients
//! write at once durable by one sync, and to which a transaction belongs while it lasts. Change
//! streams read what the store keeps of changes ([`changes`]), so that they hold nothing, and go on after
//! either side was killed. A command is a function and a line in a table ([`command`]).
//!
//! It is the memory that is served: computables run for every client, shared databases are routed, `_robmem_info`
//! is hidden ([`access`]), what decayed is not there.

mod abandoned;
mod access;
mod activity;
mod address;
mod age;
mod attempt;
mod auth;
mod behind;
mod busy_poll;
mod call;
mod changes;
mod client;
mod clock;
mod code;
mod command;
mod confirmation;
mod connection;
mod cursor;
mod effect;
mod ended;
mod failure;
mod fields;
mod files;
mod host;
mod hub;
mod job;
mod lazy;
mod listener;
pub mod lock;
mod mailbox;
mod open_files;
mod origin;
mod panic;
mod past;
mod pool;
mod reading;
mod request;
mod retry;
mod running;
mod server;
mod session;
mod snapshot;
mod statements;
mod stream;
pub mod systemd;
mod tls;
mod transaction;
mod turns;
mod usage;
mod wire;
mod write;
mod writer;
mod writer_context;

pub use address::{Address, AddressError};
pub use auth::{Users, UsersError};
pub use files::Moved;
pub use listener::{ListenError, Listener, private_folder};
pub use running::Running;
pub use server::{Opener, Options, Server};
pub use tls::{Tls, TlsError};
pub use wire::{Form, MAX_MESSAGE, Message, Reply, WireError};
