//! A line of mongosh as a call of a template's function.

use super::line::{DATABASE, Line, Segment, is_empty, is_text, unquoted};

/// Returns the call for a line, like `query("robmem.orders", "{team: 'CYAN'}")`; none where it is no such line, or templates
/// have no such function.
#[must_use]
pub fn call(line: &str) -> Option<String> {
    let Line { namespace, method, arguments, modifiers } = Line::parse(line, DATABASE)?;
    let is_counted = modifiers.iter().any(|segment| ["count", "size", "length", "itcount"].contains(&segment.name));
    let (function, most) = match method {
        "find" | "findOne" if is_counted => ("count", 1),
        "find" => ("query", 2),
        "findOne" => ("find_one", 2),
        "countDocuments" | "count" | "estimatedDocumentCount" => ("count", 1),
        "distinct" => ("distinct", 2),
        "aggregate" => ("aggregate", 1),
        _ => return None,
    };
    if arguments.len() > most {
        return None;
    }
    let mut given = vec![literal(&namespace)];
    match method {
        "distinct" => {
            given.push(literal(&unquoted(arguments.first().filter(|field| is_text(field))?)));
            given.extend(arguments.get(1).map(|query| literal(query)));
        }
        "aggregate" => given.push(literal(arguments.first()?)),
        _ => {
            given.extend(arguments.first().filter(|query| !is_empty(query)).map(|query| literal(query)));
            given.extend(arguments.get(1).map(|fields| format!("projection={}", literal(fields))));
        }
    }
    for segment in modifiers {
        given.extend(option(&segment, function)?);
    }
    Some(format!("{function}({})", given.join(", ")))
}

/// The argument for a method of a cursor; an inner none where it needs none, an outer one where there is no such argument.
fn option(segment: &Segment<'_>, function: &str) -> Option<Option<String>> {
    let argument = segment.arguments.as_ref().and_then(|arguments| arguments.first().copied());
    match segment.name {
        "pretty" | "toArray" | "count" | "size" | "length" | "itcount" => Some(None),
        "sort" | "projection" if function == "query" => Some(Some(format!("{}={}", segment.name, literal(argument?)))),
        "limit" | "skip" if function == "query" => Some(Some(format!("{}={}", segment.name, argument?))),
        _ => None,
    }
}

/// A text in the quotes of templates.
fn literal(text: &str) -> String {
    let text = text.trim();
    match text.contains(['"', '\\']) {
        true if !text.contains(['\'', '\\']) => format!("'{text}'"),
        true => format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"")),
        false => format!("\"{text}\""),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_mongosh_is_a_call() {
        for (line, wanted) in [
            ("db.orders.find({team: 'CYAN'})", "query(\"robmem.orders\", \"{team: 'CYAN'}\")"),
            ("db.orders.find({})", "query(\"robmem.orders\")"),
            ("db.orders.find({team: \"CYAN\"}).toArray()", "query(\"robmem.orders\", '{team: \"CYAN\"}')"),
            ("lab.orders.find({a: \"b's\"})", "query(\"lab.orders\", \"{a: \\\"b's\\\"}\")"),
            (
                "db.orders.find({}, {n: 1}).sort({n: -1}).limit(3)",
                "query(\"robmem.orders\", projection=\"{n: 1}\", sort=\"{n: -1}\", limit=3)",
            ),
            ("db.orders.findOne({_id: 1})", "find_one(\"robmem.orders\", \"{_id: 1}\")"),
            ("db.orders.find({n: 1}).count()", "count(\"robmem.orders\", \"{n: 1}\")"),
            ("db.orders.countDocuments()", "count(\"robmem.orders\")"),
            ("db.orders.distinct('team', {n: 1})", "distinct(\"robmem.orders\", \"team\", \"{n: 1}\")"),
            ("db.orders.aggregate([{$match: {}}])", "aggregate(\"robmem.orders\", \"[{$match: {}}]\")"),
        ] {
            assert_eq!(call(line).as_deref(), Some(wanted), "{line}");
        }
        for other in [
            "db.orders.drop()",
            "robmem.orders",
            "db.x.find({}, {}, {})",
            "db.x.find({}).collation({})",
            "db.x.distinct(y)",
        ] {
            assert_eq!(call(other), None, "{other}");
        }
    }
}
