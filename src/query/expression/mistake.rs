//! The codes of arguments of the wrong shape: MongoDB has others for nearly every operator.

use super::date::is_part;
use crate::query::error::{FAILED_TO_PARSE, QueryError};

/// What an operator with named arguments answers.
struct Mistakes {
    operators: &'static [&'static str],
    /// To what is not an object.
    shape: i32,
    /// To an argument that it does not know.
    unknown: i32,
    /// To an argument that is not there, in the order in which it is looked for.
    missing: &'static [(&'static str, i32)],
}

/// Stands for each operator that takes a part out of a date.
const PART: &str = "a part of a date";

/// Conversions to one type.
const CONVERSIONS: [&str; 8] =
    ["$toBool", "$toDate", "$toDecimal", "$toDouble", "$toInt", "$toLong", "$toObjectId", "$toString"];

macro_rules! mistakes {
    ($($operators:expr => $shape:literal, $unknown:literal, $missing:expr;)*) => {
        [$(Mistakes { operators: &$operators, shape: $shape, unknown: $unknown, missing: &$missing }),*]
    };
}

const MISTAKES: [Mistakes; 24] = mistakes! {
    [PART] => 40_536, 40_535, [("date", 40_539)];
    ["$dateAdd", "$dateSubtract"] => 5_166_400, 5_166_401,
        [("startDate", 5_166_402), ("unit", 5_166_402), ("amount", 5_166_402)];
    ["$dateDiff"] => 5_166_301, 5_166_302, [("startDate", 5_166_303), ("endDate", 5_166_304), ("unit", 5_166_305)];
    ["$dateFromParts"] => 40_519, 40_518, [];
    ["$dateFromString"] => 40_540, 40_541, [("dateString", 40_542)];
    ["$dateToParts"] => 40_524, 40_520, [("date", 40_522)];
    ["$dateToString"] => 18_629, 18_534, [("date", 18_628)];
    ["$dateTrunc"] => 5_439_007, 5_439_008, [("date", 5_439_009), ("unit", 5_439_010)];
    ["$cond"] => 16_020, 17_083, [("if", 17_080), ("then", 17_081), ("else", 17_082)];
    ["$switch"] => 40_060, 40_067, [];
    ["$let"] => 16_874, 16_875, [("vars", 16_876), ("in", 16_877)];
    ["$map"] => 16_878, 16_879, [("input", 16_880), ("in", 16_882)];
    ["$filter"] => 28_646, 28_647, [("input", 28_648), ("cond", 28_650)];
    ["$reduce"] => 40_075, 40_076, [("input", 40_077), ("initialValue", 40_078), ("in", 40_079)];
    ["$zip"] => 34_460, 34_464, [("inputs", 34_465)];
    ["$trim", "$ltrim", "$rtrim"] => 50_696, 50_694, [("input", 50_695)];
    ["$regexFind", "$regexFindAll", "$regexMatch"] => 51_103, 31_024, [("input", 31_022), ("regex", 31_023)];
    ["$replaceOne", "$replaceAll"] => 51_751, 51_750, [("input", 51_749), ("find", 51_748), ("replacement", 51_747)];
    ["$getField"] => 5_654_602, 3_041_701, [("field", 3_041_702), ("input", 3_041_703)];
    ["$setField", "$unsetField"] => 4_161_100, 4_161_101,
        [("field", 4_161_102), ("input", 4_161_109), ("value", 4_161_103)];
    ["$sortArray"] => 2_942_500, 2_942_501, [("input", 2_942_502), ("sortBy", 2_942_503)];
    ["$firstN", "$lastN"] => 5_787_801, 5_787_901, [("n", 5_787_906), ("input", 5_787_907)];
    ["$maxN", "$minN"] => 5_787_900, 5_787_901, [("n", 5_787_906), ("input", 5_787_907)];
    ["a branch of $switch"] => 40_062, 40_063, [("case", 40_064), ("then", 40_065)];
};

fn of(operator: &str) -> Option<&'static Mistakes> {
    let operator = if is_part(operator) { PART } else { operator };
    MISTAKES.iter().find(|mistakes| mistakes.operators.contains(&operator))
}

/// The error for what is not an object.
pub(super) fn shape(operator: &str) -> QueryError {
    let code = of(operator).map_or(FAILED_TO_PARSE, |mistakes| mistakes.shape);
    QueryError::invalid(code, format!("{operator} only supports an object as its argument"))
}

/// The error for an argument that is not known.
pub(super) fn unknown(operator: &str, name: &str) -> QueryError {
    let code = of(operator).map_or(FAILED_TO_PARSE, |mistakes| mistakes.unknown);
    QueryError::invalid(code, format!("unrecognized argument to {operator}: {name}"))
}

/// The error for the first of the arguments that are not there.
pub(super) fn missing(operator: &str, absent: &[&str]) -> Option<QueryError> {
    let listed = of(operator).and_then(|mistakes| mistakes.missing.iter().find(|(name, _)| absent.contains(name)));
    let other = || absent.first().map(|name| (*name, FAILED_TO_PARSE));
    let (name, code) = listed.copied().or_else(other)?;
    Some(QueryError::invalid(code, format!("missing '{name}' parameter to {operator}")))
}

/// The error for so many arguments.
pub(super) fn count(operator: &str, arity: (usize, usize), found: usize) -> QueryError {
    let code = match operator {
        "$rand" => 3_040_501,
        "$ifNull" => 1_257_300,
        "$setEquals" => 17_045,
        "$getField" => 5_654_601,
        "$round" | "$trunc" | "$range" | "$slice" | "$indexOfArray" | "$indexOfBytes" | "$indexOfCP" => 28_667,
        part if is_part(part) => 40_536,
        conversion if CONVERSIONS.contains(&conversion) => 50_723,
        _ => 16_020,
    };
    let message = format!("expression {operator} takes {} to {} arguments, not {found}", arity.0, arity.1);
    QueryError::invalid(code, message)
}

#[cfg(test)]
mod tests {
    use crate::query::expression::Expression;
    use bson::{Bson, bson};

    /// The code with which an expression is refused; 0 where it is not.
    fn code(expression: Bson) -> i32 {
        Expression::parse(&expression).map_or_else(|error| error.code, |_| 0)
    }

    #[test]
    fn each_operator_has_its_codes_for_arguments_of_the_wrong_shape() {
        let table = [
            (bson!({"$abs": [1, 2]}), 16_020),
            (bson!({"$round": []}), 28_667),
            (bson!({"$slice": 1}), 28_667),
            (bson!({"$toInt": []}), 50_723),
            (bson!({"$hour": [1, 2]}), 40_536),
            (bson!({"$hour": {"date": "$d", "zone": 1}}), 40_535),
            (bson!({"$hour": {}}), 40_539),
            (bson!({"$dateAdd": 1}), 5_166_400),
            (bson!({"$firstN": {}}), 5_787_906),
            (bson!({"$replaceOne": {"input": "a", "find": "b"}}), 51_747),
            (bson!({"$cond": {"if": 1, "then": 2}}), 17_082),
            (bson!({"$switch": {"branches": [1]}}), 40_062),
            (bson!({"$let": {"vars": {}}}), 16_877),
            (bson!({"$map": {"input": [], "in": 1, "as": 1}}), 9),
            (bson!({"$ifNull": []}), 1_257_300),
            (bson!({"$getField": "$a"}), 5_654_600),
            (bson!({"$getField": ["a"]}), 5_654_601),
            (bson!({"$setField": {"field": 1, "input": "$a", "value": 1}}), 4_161_107),
            (bson!({"$zip": {"inputs": 1, "useLongestLength": 1}}), 34_461),
            (bson!({"$function": {"body": "$a", "args": [], "lang": "js"}}), 31_432),
            (bson!({"$function": {"body": "function() {}", "args": [], "lang": "c"}}), 31_419),
            (bson!({"a.b": 1}), 16_412),
        ];
        for (expression, expected) in table {
            assert_eq!(code(expression.clone()), expected, "{expression}");
        }
    }

    #[test]
    fn each_operator_has_its_codes_for_values_of_the_wrong_type() {
        let table = [
            (bson!({"$add": [1, "x"]}), 16_554),
            (bson!({"$mod": [1, "x"]}), 16_611),
            (bson!({"$range": ["x", 1]}), 34_443),
            (bson!({"$range": [1, 1.5]}), 34_446),
            (bson!({"$indexOfCP": ["x", 1]}), 40_094),
            (bson!({"$indexOfBytes": ["x", 1]}), 40_092),
            (bson!({"$slice": [1, 1, null]}), 28_724),
            (bson!({"$slice": [[], "x"]}), 28_725),
            (bson!({"$round": [1, "x"]}), 16_004),
            (bson!({"$tsSecond": 1}), 5_687_301),
            (bson!({"$tsIncrement": 1}), 5_687_302),
            (bson!({"$setIsSubset": [1, 1]}), 17_046),
            (bson!({"$setIsSubset": ["$a", 1]}), 17_311),
            (bson!({"$indexOfArray": [1, 1]}), 40_090),
            (bson!({"$indexOfArray": [1, "$a"]}), 50_809),
            (bson!({"$hour": {"date": 1, "timezone": 1}}), 16_006),
            (bson!({"$hour": {"date": bson::DateTime::from_millis(0), "timezone": 1}}), 40_533),
            (bson!({"$hour": {"date": null, "timezone": 1}}), 0),
            (bson!({"$dateAdd": {"startDate": 1, "unit": "day", "amount": "x"}}), 5_166_403),
        ];
        for (expression, expected) in table {
            assert_eq!(code(expression.clone()), expected, "{expression}");
        }
    }
}
