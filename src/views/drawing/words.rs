//! Texts in drawings: how wide they are, about, and as much of them as there is room for.

/// The width of a character, in parts of the size of the font: the mean of DejaVu Sans, rounded up.
const CHARACTER: f64 = 0.62;

/// The width of a text in pixels, about.
pub(super) fn width(text: &str, size: f64) -> f64 {
    text.chars().count() as f64 * size * CHARACTER
}

/// How many characters fit into a width in pixels.
pub(super) fn fitting(width: f64, size: f64) -> usize {
    (width / (size * CHARACTER)).max(1.0) as usize
}

/// A text of at most so many characters; of what is longer, beginning and end are kept, which tell names apart.
pub(super) fn clipped(text: &str, characters: usize) -> String {
    let count = text.chars().count();
    if count <= characters {
        return text.to_owned();
    }
    let left = characters.saturating_sub(1);
    let end = left / 3;
    text.chars().take(left - end).chain(['…']).chain(text.chars().skip(count - end)).collect()
}

#[cfg(test)]
mod tests {
    use super::clipped;

    #[test]
    fn only_what_is_too_long_is_clipped() {
        assert_eq!(clipped("blue-cup", 8), "blue-cup");
        assert_eq!(clipped("blue-cup-12", 9), "blue-c…12");
        assert_eq!(clipped("äöü", 1), "…");
    }
}
