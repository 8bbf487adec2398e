//! Lines of mongosh, like `db.orders.find({team: 'CYAN'})`, in rmem's own words: a command, or a call in a template.

mod advice;
mod call;
mod command;
mod line;

pub use advice::{advice, advice_on_method};
pub use call::call;
pub use command::command;
pub use line::DATABASE;
