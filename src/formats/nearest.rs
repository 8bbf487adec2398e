//! The name that a misspelt one was probably meant to be.

/// Returns the candidate most like `wanted`, ignoring case: at most a third of its letters differ, and at most three.
/// Names of one letter are like no other.
#[must_use]
pub fn nearest<'a>(wanted: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let lower = wanted.to_lowercase();
    let letters = lower.chars().count();
    let limit = letters.div_ceil(3).min(3).min(letters.saturating_sub(1));
    candidates
        .into_iter()
        .filter(|candidate| *candidate != wanted && candidate.len().abs_diff(lower.len()) <= 4 * limit)
        .map(|candidate| (strsim::osa_distance(&lower, &candidate.to_lowercase()), candidate))
        .filter(|(distance, _)| *distance <= limit)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_finger_is_recognised() {
        let names = ["robmem.worldmodel", "robmem.plans", "x.y"];
        assert_eq!(nearest("robmem.worldmodl", names), Some("robmem.worldmodel"));
        assert_eq!(nearest("robmem.palns", names), Some("robmem.plans"));
        assert_eq!(nearest("robmem.Plans", names), Some("robmem.plans"));
        assert_eq!(nearest("robmem.plans", names), None);
        assert_eq!(nearest("robmem.objects", names), None);
        assert_eq!(nearest("", names), None);
    }
}
