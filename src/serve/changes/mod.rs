//! Change streams: the memory's triggers as MongoDB reports them.

mod behind;
mod difference;
mod event;
mod following;
mod joined;
mod scopes;
mod spec;
mod stream;
mod token;

pub(super) use behind::Behind;
pub(super) use following::Following;
pub(super) use joined::Joined;
pub(super) use scopes::Scopes;
pub(super) use spec::Spec;
pub(super) use stream::Stream;
