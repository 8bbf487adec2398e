//! The differences that are known, each with its reason and exact condition.
//!
//! mongod 6.0 has two engines that differ from each other, and its optimiser
//! leaves work out or does it early; most of what is here comes of that.
//! `docs/mongodb.md` lists what these say, which a test of this file checks.

use bson::{Bson, Document};
use libtest_mimic::Failed;

use rmem::query::compare_values;

use super::pair::Difference;

/// A difference that stays.
pub(super) struct Known {
    /// What is different, as the documentation says it.
    what: &'static str,
    holds: fn(&Difference) -> bool,
}

pub(super) const KNOWN: &[Known] = &[
    Known {
        what: "A field that one stage drops and another makes again stands where it was, or last: `$unset` or `$unwind`, \
               say, and then a stage that sets the field",
        holds: |difference| {
            let remaking =
                ["$lookup", "$unset", "$unwind", "$project", "$replaceRoot", "$replaceWith", "$addFields", "$set"];
            count(&Bson::Document(difference.command.clone()), &remaking) > 1
                && (same(difference, &|a, b| equal(a, b, true, &|a, b| a == b)) || only_counts(difference))
        },
    },
    Known {
        what: "An error of work that mongod leaves out, or does early: sorting by parallel arrays around a `$sort`, `$match` \
               or `$unwind` that it moves, and what `$first` does not keep",
        holds: |difference| {
            let theirs = difference.theirs.get_str("errmsg").unwrap_or_default();
            let message = difference.ours.as_ref().err().map_or(theirs, String::as_str);
            let (their_error, our_error) = difference.kind();
            let sorting = message.contains("parallel arrays") && uses(difference, &["$sort"]);
            sorting && their_error != our_error
                || uses(difference, &["$group", "$bucket"])
                    && uses(difference, &["$first"])
                    && difference.kind() == (true, false)
        },
    },
    Known {
        what: "An arrow function as `$where` or `$function`: mongod takes the function itself for the value",
        holds: |difference| {
            let text = difference.command.to_string();
            uses(difference, &["$where", "$function"]) && text.contains("=>")
        },
    },
    Known {
        what: "`$expMovingAvg` over several partitions: behind one with a decimal, mongod 6.0.5 gives decimals in all",
        holds: |difference| {
            let alike = |a: &Bson, b: &Bson| matches!(a, Bson::Decimal128(_)) && number(a) == number(b);
            let text = difference.command.to_string();
            text.contains("$expMovingAvg")
                && text.contains("partitionBy")
                && same(difference, &|a, b| equal(a, b, false, &alike))
        },
    },
    Known {
        what: "Decimals among other numbers in `$covariancePop` and `$covarianceSamp`: they agree to 12 digits, and what is left \
               when a decimal has left the window is a decimal or a double",
        holds: |difference| {
            let is_decimal =
                |answer: &Document| any(&Bson::Document(answer.clone()), &|value| matches!(value, Bson::Decimal128(_)));
            let alike = |a: &Bson, b: &Bson| match (number(a), number(b)) {
                (Some(a), Some(b)) => (a - b).abs() <= 1e-12 * a.abs().max(1.0),
                _ => false,
            };
            difference.command.to_string().contains("$covariance")
                && [Ok(&difference.theirs), difference.ours.as_ref()].into_iter().flatten().any(is_decimal)
                && same(difference, &|a, b| equal(a, b, false, &alike))
        },
    },
    Known {
        what: "Windows that move at both ends and that infinity, NaN or a much larger number has left: mongod 6.0.5 takes it away \
               from the sum, and what is left of the other numbers is wrong; a deviation of 0 is an int or a double",
        holds: |difference| {
            let large = |value: &Bson| number(value).is_some_and(|it| !it.is_finite() || it.abs() > 1e15);
            let text = difference.command.to_string();
            let theirs = Bson::Document(difference.theirs.clone());
            let is_deviation = text.contains("$stdDev");
            let was_special = is_deviation && any(&theirs, &|value| *value == Bson::Null);
            let zero = |a: &Bson, b: &Bson| number(a) == Some(0.0) && number(b) == Some(0.0);
            ["$sum", "$avg", "$stdDev", "$covariance"].iter().any(|name| text.contains(name))
                && text.contains("window")
                && (is_deviation && same(difference, &|a, b| equal(a, b, false, &zero))
                    || (was_special || any(&theirs, &large))
                        && same(difference, &|a, b| equal(&without(a, "x"), &without(b, "x"), false, &|a, b| a == b)))
        },
    },
    Known {
        what: "A regular expression that passes through JavaScript: mongod 6.0.5 adds a `/` to its pattern",
        holds: |difference| {
            let slashed =
                |value: &Bson| matches!(value, Bson::RegularExpression(regex) if regex.pattern.as_str().ends_with('/'));
            uses(difference, &["$function"]) && any(&Bson::Document(difference.theirs.clone()), &slashed)
        },
    },
    Known {
        what: "Documents that pass through JavaScript unchanged: mongod gives them back with their ints, and as text they are \
               `[object BSON]`",
        holds: |difference| {
            uses(difference, &["$function"])
                && (same(difference, &|a, b| {
                    equal(a, b, false, &|a, b| number(a).is_some() && compare_values(a, b).is_eq())
                }) || difference.theirs.to_string().contains("[object BSON]"))
        },
    },
    Known {
        what: "Values that are no result and need more than 256 MB while an expression is evaluated: the embedded store ends \
               them with code 146, mongod holds them",
        holds: |difference| {
            difference.ours.as_ref().is_err_and(|message| message.starts_with("146:")) && !difference.kind().0
        },
    },
    Known {
        what: "Of numbers that are equal but not of one type, `$max` and `$min` may give either",
        holds: |difference| {
            uses(difference, &["$max", "$min"])
                && same(difference, &|a, b| {
                    equal(a, b, false, &|a, b| number(a).is_some() && compare_values(a, b).is_eq())
                })
        },
    },
    Known {
        what: "Sums and products beyond 64 bits in a `$group`, which mongod's other engine gives as decimals",
        holds: |difference| {
            uses(difference, &["$group", "$bucket", "$sortByCount"])
                && uses(difference, &["$add", "$subtract", "$multiply"])
                && same(difference, &|a, b| {
                    equal(a, b, false, &|a, b| {
                        matches!((a, b), (Bson::Decimal128(_), Bson::Double(_))) && number(a) == number(b)
                            || number(a).is_some() && compare_values(a, b).is_eq()
                    })
                })
        },
    },
    Known {
        what: "The last digits of a decimal that `$pow`, `$exp`, a logarithm or a trigonometric function computed: they \
               agree to 28 digits",
        holds: |difference| {
            let computing = ["$pow", "$exp", "$ln", "$log", "$log10", "$sqrt", "$sin", "$cos", "$tan"];
            let more = ["$asin", "$acos", "$atan", "$atan2", "$sinh", "$cosh", "$tanh", "$asinh", "$acosh", "$atanh"];
            (uses(difference, &computing) || uses(difference, &more))
                && same(difference, &|a, b| equal(a, b, false, &close_decimals))
        },
    },
    Known {
        what: "Decimals beside doubles, and dates beside what is not a number, in `$add`: mongod 6.0.5 takes doubles exactly and \
               gives the first of all dates, later versions take 15 digits and refuse",
        holds: |difference| {
            let near = |a: &Bson, b: &Bson| match (a, b) {
                (Bson::Decimal128(_), Bson::Decimal128(_)) => {
                    let (a, b) = (number(a), number(b));
                    a == b || a.zip(b).is_some_and(|(a, b)| (a - b).abs() <= 1e-14 * a.abs().max(b.abs()))
                }
                _ => false,
            };
            let refused = difference.ours.as_ref().err().is_some_and(|message| message.contains("date overflow"));
            let least = |value: &Bson| matches!(value, Bson::DateTime(date) if date.timestamp_millis() == i64::MIN);
            uses(difference, &["$add"])
                && (same(difference, &|a, b| equal(a, b, false, &near))
                    // A group may make something else of such a date.
                    || refused && (any(&Bson::Document(difference.theirs.clone()), &least) || uses(difference, &["$group"])))
        },
    },
    Known {
        what: "What `$mod` leaves of a decimal power, which is all of its last digit",
        holds: |difference| {
            let decimal = |value: &Bson| matches!(value, Bson::Decimal128(_));
            uses(difference, &["$mod"])
                && uses(difference, &["$pow"])
                && same(difference, &|a, b| equal(a, b, false, &|a, b| decimal(a) && decimal(b)))
        },
    },
    Known {
        what: "`$replaceAll` of nothing: mongod puts the replacement between the bytes of a character, too",
        holds: |difference| {
            let cut = |value: &Bson| value.as_str().is_some_and(|text| text.contains('\u{fffd}'));
            uses(difference, &["$replaceAll"]) && any(&Bson::Document(difference.theirs.clone()), &cut)
        },
    },
    Known {
        what: "Dates before 1970 with a fraction of a second: mongod 6.0.5 is a second off in `$dateAdd` and \
               `$dateSubtract`",
        holds: |difference| {
            uses(difference, &["$dateAdd", "$dateSubtract"])
                && same(difference, &|a, b| {
                    equal(a, b, false, &|a, b| match (a, b) {
                        (Bson::DateTime(a), Bson::DateTime(b)) => {
                            a.timestamp_millis().abs_diff(b.timestamp_millis()) == 1000
                        }
                        (a, b) => a == b,
                    })
                })
        },
    },
    Known {
        what: "`$dateToString` with a time zone but no format: mongod 6.0.5 ends it with `Z`, later versions do not",
        holds: |difference| {
            uses(difference, &["$dateToString"])
                && same(difference, &|a, b| {
                    equal(a, b, false, &|a, b| match (a, b) {
                        (Bson::String(a), Bson::String(b)) => a.trim_end_matches('Z') == b.trim_end_matches('Z'),
                        (a, b) => a == b,
                    })
                })
        },
    },
    Known {
        what: "`$graphLookup` by null, where mongod's answer depends on what it looked up before, and by a regular \
               expression, which it takes as a pattern",
        holds: |difference| {
            let found = Bson::Document(difference.theirs.clone());
            let special = |value: &Bson| matches!(value, Bson::RegularExpression(_) | Bson::Null);
            // What is found may differ, and nothing else.
            let elsewhere = |a: &Bson, b: &Bson| equal(&without(a, "r"), &without(b, "r"), false, &|_, _| false);
            uses(difference, &["$graphLookup"]) && any(&found, &special) && same(difference, &elsewhere)
        },
    },
    Known {
        what: "A decimal that does not fit in 64 bits under a bitwise operator: mongod 6.0.5 takes it as 0, later versions \
               never match it",
        holds: |difference| {
            let large = |value: &Bson| {
                matches!(value, Bson::Decimal128(_)) && number(value).is_none_or(|it| it.is_nan() || it.abs() >= 9e18)
            };
            uses(difference, &["$bitsAllSet", "$bitsAllClear", "$bitsAnySet", "$bitsAnyClear"])
                && any(&Bson::Document(difference.theirs.clone()), &large)
        },
    },
    Known {
        what: "What is wrong beside a null in the operators on dates, and in any arithmetic within a `$group`: it depends on the version and the engine of mongod which of the two counts",
        holds: |difference| {
            let (their_error, our_error) = difference.kind();
            let answer = if their_error { difference.ours.as_ref().ok() } else { Some(&difference.theirs) };
            let is_null = |answer: &Document| any(&Bson::Document(answer.clone()), &|value| *value == Bson::Null);
            let message = difference.ours.as_ref().err().map_or("", String::as_str);
            let grouping = uses(difference, &["$group", "$bucket", "$sortByCount"]);
            their_error != our_error
                && (answer.is_some_and(is_null) && uses(difference, &DATES)
                    || grouping
                        && ["only supports numeric types", "only one date"].iter().any(|it| message.contains(it)))
        },
    },
    Known {
        what: "The positional projection of a path (`\"a.b.$\"`) in documents without its first part: mongod looks for the \
               rest of it beside that",
        holds: |difference| {
            let fields = difference.command.get_document("projection").cloned().unwrap_or_default();
            let deep = fields.keys().any(|name| name.ends_with(".$") && name.matches('.').count() > 1);
            let theirs = difference.theirs.get_str("errmsg").unwrap_or_default();
            let errs = difference.kind() == (true, false) && theirs.contains("positional operator");
            let has =
                |value: &Bson, name: &str| value.as_document().is_some_and(|document| document.contains_key(name));
            // Theirs has the first part as well, at the end.
            let finds = |name: &str| {
                same(difference, &|a, b| a == b || has(a, name) && !has(b, name) && without(a, name) == *b)
            };
            let first = |name: &str| name.split_once('.').map_or_else(String::new, |(first, _)| first.to_owned());
            deep && (errs || fields.keys().any(|name| finds(&first(name))))
        },
    },
    Known {
        what: "A sort by an element (`\"a.0\"`) of an array that a later stage wants another part of: mongod 6.0.5 looks for a field \
               of that name",
        holds: |difference| {
            let stages = difference.command.get_array("pipeline").map(Vec::as_slice).unwrap_or_default();
            let by_element = |stage: &Bson| {
                let keys = stage.as_document().and_then(|stage| stage.get_document("$sort").ok());
                let is_number = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
                keys.is_some_and(|keys| keys.keys().any(|key| key.split('.').skip(1).any(is_number)))
            };
            let narrowing = ["$project", "$group", "$sortByCount", "$bucket", "$bucketAuto", "$count"];
            let narrows = |stage: &Bson| count(stage, &narrowing) > 0;
            let sorted = stages.iter().position(by_element);
            difference.kind() == (false, false) && sorted.is_some_and(|place| stages.iter().skip(place).any(narrows))
        },
    },
    Known {
        what: "What mongod 6.0.5 fails to rewrite when it optimises: some filters and group keys, and MinKey and MaxKey as the `_id` \
               of a group, which it gives as `{\"\": …}`",
        holds: |difference| {
            let message = difference.theirs.get_str("errmsg").unwrap_or_default();
            message.contains("unknown top level operator") || message.starts_with("duplicate field") || {
                let named = |value: &Bson| value.as_document().is_some_and(|document| document.contains_key(""));
                any(&Bson::Document(difference.theirs.clone()), &named)
            }
        },
    },
    Known {
        what: "A double with a fraction that is added to a date: mongod 6.0.5 cuts it, later versions round it",
        holds: |difference| {
            uses(difference, &["$add", "$subtract"])
                && same(difference, &|a, b| {
                    equal(a, b, false, &|a, b| match (a, b) {
                        (Bson::DateTime(a), Bson::DateTime(b)) => {
                            a.timestamp_millis().abs_diff(b.timestamp_millis()) == 1
                        }
                        (a, b) => a == b,
                    })
                })
        },
    },
    Known {
        what: "`$dateFromString` without a format reads ISO 8601 and dates in words; mongod guesses more",
        holds: |difference| {
            let reading = |value: &Bson| {
                let read = value.as_document().and_then(|document| document.get_document("$dateFromString").ok());
                read.is_some_and(|read| !read.contains_key("format"))
            };
            any(&Bson::Document(difference.command.clone()), &reading)
                && any(&Bson::Document(difference.theirs.clone()), &|value| matches!(value, Bson::DateTime(_)))
        },
    },
];

/// The operators on dates whose arguments are looked at one after the other.
const DATES: [&str; 20] = [
    "$dateAdd",
    "$dateSubtract",
    "$dateDiff",
    "$dateTrunc",
    "$dateToString",
    "$dateToParts",
    "$dateFromParts",
    "$year",
    "$month",
    "$week",
    "$dayOfMonth",
    "$dayOfWeek",
    "$dayOfYear",
    "$hour",
    "$minute",
    "$second",
    "$millisecond",
    "$isoWeek",
    "$isoWeekYear",
    "$isoDayOfWeek",
];

/// Fails where docs/mongodb.md does not list a known difference.
pub(super) fn are_documented() -> Result<(), Failed> {
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let text = words(&std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/mongodb.md"))?);
    match KNOWN.iter().find(|known| !text.contains(&words(known.what))) {
        Some(known) => Err(format!("docs/mongodb.md does not say: {}", words(known.what)).into()),
        None => Ok(()),
    }
}

/// What a difference is, where it is known.
pub(super) fn reason(difference: &Difference) -> Option<&'static str> {
    KNOWN.iter().find(|known| (known.holds)(difference)).map(|known| known.what)
}

/// Whether the command has one of these operators anywhere.
fn uses(difference: &Difference, operators: &[&str]) -> bool {
    let command = Bson::Document(difference.command.clone());
    any(&command, &|value| {
        value.as_document().is_some_and(|document| document.keys().any(|name| operators.contains(&name.as_str())))
    })
}

/// Whether a value or one inside it passes.
fn any(value: &Bson, test: &dyn Fn(&Bson) -> bool) -> bool {
    test(value)
        || match value {
            Bson::Document(document) => document.values().any(|value| any(value, test)),
            Bson::Array(items) => items.iter().any(|item| any(item, test)),
            _ => false,
        }
}

/// How often a value has one of these names, on all levels.
fn count(value: &Bson, names: &[&str]) -> usize {
    match value {
        Bson::Document(document) => {
            document.iter().map(|(name, value)| usize::from(names.contains(&name.as_str())) + count(value, names)).sum()
        }
        Bson::Array(items) => items.iter().map(|item| count(item, names)).sum(),
        _ => 0,
    }
}

/// A document without a field.
fn without(value: &Bson, name: &str) -> Bson {
    let mut rest = value.clone();
    if let Bson::Document(document) = &mut rest {
        document.remove(name);
    }
    rest
}

/// Whether both answered, and what was found is the same by this measure.
fn same(difference: &Difference, equal: &dyn Fn(&Bson, &Bson) -> bool) -> bool {
    let found = |answer: &Document| {
        let cursor = answer.get_document("cursor").ok();
        cursor.and_then(|cursor| cursor.get("firstBatch")).or_else(|| answer.get("values")).cloned()
    };
    let Ok(ours) = &difference.ours else { return false };
    match (found(&difference.theirs), found(ours)) {
        (Some(Bson::Array(theirs)), Some(Bson::Array(ours))) if theirs.len() == ours.len() => {
            let sets = uses(difference, &["$addToSet"]);
            let in_order = |values: Vec<Bson>| values.into_iter().map(|value| if sets { sorted(value) } else { value });
            let (theirs, mut ours): (Vec<_>, Vec<_>) = (in_order(theirs).collect(), in_order(ours).collect());
            // The order of groups is not defined.
            let any_order = uses(difference, &["$group", "$bucket"]);
            theirs.iter().all(|document| {
                let place =
                    ours.iter().take(if any_order { ours.len() } else { 1 }).position(|other| equal(document, other));
                place.map(|place| ours.remove(place)).is_some()
            })
        }
        _ => false,
    }
}

/// The value with its arrays in one order: that of the elements of a set is not defined.
fn sorted(value: Bson) -> Bson {
    match value {
        Bson::Document(document) => {
            Bson::Document(document.into_iter().map(|(name, value)| (name, sorted(value))).collect())
        }
        Bson::Array(items) => {
            let mut items: Vec<Bson> = items.into_iter().map(sorted).collect();
            items.sort_by_key(Bson::to_string);
            Bson::Array(items)
        }
        value => value,
    }
}

/// Whether the answers differ in nothing but whether an update changed something.
fn only_counts(difference: &Difference) -> bool {
    let Ok(ours) = &difference.ours else { return false };
    difference.kind() == (false, false) && ours.contains_key("nModified") && ours.get("n") == difference.theirs.get("n")
}

/// Whether two values are the same, their leaves by `leaf`; fields in any order where `any_order`.
fn equal(a: &Bson, b: &Bson, any_order: bool, leaf: &dyn Fn(&Bson, &Bson) -> bool) -> bool {
    match (a, b) {
        (Bson::Document(a), Bson::Document(b)) => {
            a.len() == b.len()
                && a.iter().zip(b).all(|((name, value), (other, at_place))| {
                    let found = if any_order { b.get(name) } else { Some(at_place).filter(|_| name == other) };
                    found.is_some_and(|found| equal(value, found, any_order, leaf))
                })
        }
        (Bson::Array(a), Bson::Array(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| equal(a, b, any_order, leaf))
        }
        (Bson::Double(a), Bson::Double(b)) if a.is_nan() && b.is_nan() => true,
        (a, b) => a == b || leaf(a, b),
    }
}

fn number(value: &Bson) -> Option<f64> {
    match value {
        Bson::Int32(value) => Some(f64::from(*value)),
        Bson::Int64(value) => Some(*value as f64),
        Bson::Double(value) => Some(*value),
        Bson::Decimal128(value) => value.to_string().parse().ok(),
        _ => None,
    }
}

/// Whether two decimals agree to 28 digits.
fn close_decimals(a: &Bson, b: &Bson) -> bool {
    let (Bson::Decimal128(a), Bson::Decimal128(b)) = (a, b) else { return false };
    let digits = |text: &str| -> String {
        let mantissa = text.split('E').next().unwrap_or_default();
        let digits: String = mantissa.chars().filter(char::is_ascii_digit).collect();
        format!("{:0<34}", digits.trim_start_matches('0'))
    };
    let (a, b) = (a.to_string(), b.to_string());
    let near = |a: &str, b: &str| match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(a), Ok(b)) => a == b || (a - b).abs() <= 1e-14 * a.abs(),
        _ => false,
    };
    let (Ok(one), Ok(other)) = (digits(&a)[..34].parse::<u128>(), digits(&b)[..34].parse::<u128>()) else {
        return false;
    };
    // 999… and 1000… are as near to each other as their digits are to a power of ten.
    let gap = one.abs_diff(other);
    near(&a, &b)
        && (gap < 1_000_000
            || gap > 8 * 10u128.pow(33) && one.max(other) % 10u128.pow(33) > 10u128.pow(33) - 10u128.pow(6))
}
