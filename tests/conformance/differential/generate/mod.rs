//! What is asked, and of which documents.

pub(super) mod bomb;
pub(super) mod expression;
pub(super) mod filter;
pub(super) mod pipeline;
pub(super) mod projection;
pub(super) mod text;
pub(super) mod update;
pub(super) mod value;
pub(super) mod window;
