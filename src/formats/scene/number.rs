//! Numbers as text.

/// A number as text that reads back as the same number. Zero has no sign.
pub(super) fn number(value: f64) -> String {
    (value + 0.0).to_string()
}

/// Numbers with blanks between.
pub(super) fn numbers(values: &[f64]) -> String {
    values.iter().map(|value| number(*value)).collect::<Vec<_>>().join(" ")
}
