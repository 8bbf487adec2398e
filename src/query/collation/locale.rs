//! The locales of collations, as MongoDB's manual lists them.

use crate::query::error::{QueryError, Result};

/// The locales, with the variants that each has beside its own rules.
const LOCALES: &str = "\
    af am ar/compat as az/search be bg bn/traditional bo bs/search bs_Cyrl ca/search chr cs/search cy da/search \
    de/phonebook,search,eor de_AT/phonebook dsb dz ee el en en_US en_US_POSIX eo es/search,traditional et fa fa_AF \
    fi/search,traditional fil fo/search fr fr_CA ga gl/search gu ha haw he/search hi hr/search hsb hu hy id ig \
    is/search it ja/unihan ka kk kl/search km kn/traditional ko/search,searchjl,unihan kok ky lb lkt ln/phonetic lo lt \
    lv mk ml mn mr ms mt my nb/search ne nl nn/search om or pa pl ps pt ro ru se/search si/dictionary sk/search sl \
    smn/search sq sr sr_Latn/search sv/search,standard sw ta te th to tr/search ug uk ur vi/traditional wae yi/search \
    yo zh/big5han,gb2312han,stroke,unihan,zhuyin zh_Hant zu simple";

/// Locales whose strings compare by the rules that are common to all languages.
#[cfg(feature = "collation")]
const UNTAILORED: [&str; 14] =
    ["de", "en", "en_US", "fr", "fr_CA", "ga", "id", "it", "lb", "ms", "nl", "pt", "sw", "zu"];

/// Refuses what is no locale.
pub(super) fn check(locale: &str) -> Result<()> {
    let (name, variant) = split(locale);
    let listed = LOCALES.split_whitespace().any(|entry| {
        let (known, variants) = entry.split_once('/').unwrap_or((entry, ""));
        known == name && variant.is_none_or(|variant| variants.split(',').any(|known| known == variant))
    });
    match listed {
        true => Ok(()),
        false => Err(QueryError::bad_value(format!(
            "the `locale` {locale:?} of a collation is none of MongoDB's; one is 'en', and 'simple' compares bytes"
        ))),
    }
}

fn split(locale: &str) -> (&str, Option<&str>) {
    match locale.split_once("@collation=") {
        Some((name, variant)) => (name, Some(variant)),
        None => (locale, None),
    }
}

/// Returns the language tag (BCP 47) of a locale.
///
/// # Errors
/// If accents are to compare backwards in a language with rules of its own.
#[cfg(feature = "collation")]
pub(super) fn tag(locale: &str, backwards: bool) -> Result<String> {
    let (name, variant) = split(locale);
    if backwards {
        // The rules of Canadian French are the common ones, with accents from the end on.
        return match variant.is_none() && UNTAILORED.contains(&name) {
            true => Ok("fr-CA".to_owned()),
            false => {
                let mut refusal = QueryError::unsupported("backwards");
                refusal.message = format!("`backwards` is not supported by the embedded store for the locale {name}");
                Err(refusal)
            }
        };
    }
    let tag = match name {
        "en_US_POSIX" => "en-US-u-va-posix".to_owned(),
        "fr_CA" => "fr".to_owned(),
        name => name.replace('_', "-"),
    };
    Ok(match variant {
        None => tag,
        Some(variant) => format!("{tag}-u-co-{}", key(variant)),
    })
}

/// Returns the variant as language tags spell it.
#[cfg(feature = "collation")]
fn key(variant: &str) -> &str {
    match variant {
        "phonebook" => "phonebk",
        "traditional" => "trad",
        "dictionary" => "dict",
        "gb2312han" => "gb2312",
        "phonetic" => "phonetic",
        other => other,
    }
}
