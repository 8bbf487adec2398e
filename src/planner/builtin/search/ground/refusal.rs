//! Why a task cannot be grounded.

/// Why a task cannot be grounded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refusal {
    /// More instances than there is memory for.
    Explosion {
        /// What has most of them, in words.
        of: String,
        /// How many.
        instances: usize,
    },
    /// An action or a predicate has too many parameters.
    Wide,
    /// A derived predicate depends on its own negation.
    Circular,
}
