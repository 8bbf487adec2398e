//! The builtin bodies. One line registers each.

use super::body::Builtin;
use super::{nearest, transform};

/// All builtin bodies.
pub const BUILTINS: &[Builtin] = &[transform::BUILTIN, nearest::BUILTIN];
