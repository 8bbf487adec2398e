//! The name that a misspelt one was probably meant to be.

/// Returns the candidate most like `wanted`, ignoring case: at most a third of its letters differ, and at most three; of up to
/// four letters, without a `$` in front, one. Names of one letter are like no other.
#[must_use]
pub fn nearest<'a>(wanted: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let candidates: Vec<&str> = candidates.into_iter().collect();
    // Of collections of one database, only what follows can be misspelt; of a letter or two, nothing can be said.
    if let Some((database, name)) = wanted.rsplit_once('.').filter(|(_, name)| name.chars().count() > 2) {
        let same = |candidate: &&'a str| candidate.rsplit_once('.').is_some_and(|(other, _)| other == database);
        let of = |candidate: &'a str| candidate.get(database.len() + 1..).unwrap_or_default();
        let near = likest(name, candidates.iter().copied().filter(same).map(of));
        if let Some(near) = near {
            return candidates.into_iter().find(|candidate| same(candidate) && of(candidate) == near);
        }
        let others = candidates.into_iter().filter(|candidate| !same(candidate));
        return likest(wanted, others);
    }
    likest(wanted, candidates)
}

/// The candidate that differs in the fewest letters.
fn likest<'a>(wanted: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let lower = wanted.to_lowercase();
    let letters = lower.trim_start_matches('$').chars().count();
    let limit = if letters > 4 { letters.div_ceil(3).min(3) } else { letters.saturating_sub(1).min(1) };
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
        assert_eq!(nearest("robmem.few", ["robmem.bom", "robmen.few"]), Some("robmen.few"));
        assert_eq!(nearest("$nope", ["$ne", "$not", "$near"]), None);
        assert_eq!(nearest("$nee", ["$ne", "$not", "$near"]), Some("$ne"));
        assert_eq!(nearest("pose.y", ["pose", "pose.x"]), Some("pose.x"));
    }
}
