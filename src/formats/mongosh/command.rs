//! A line of mongosh as a command of rmem.

use super::line::{Line, Segment, is_empty, is_text, of_database, unquoted};
use crate::formats::command_line::word;

/// Returns the command for a line, where `db` is `database`; none where it is no such line, or rmem has no such command.
#[must_use]
pub fn command(line: &str, database: &str) -> Option<String> {
    let line = line.trim().trim_end_matches(';');
    let shown: Vec<&str> = line.split_whitespace().collect();
    if let ["show", "collections" | "tables" | "dbs" | "databases"] = shown.as_slice() {
        return Some("rmem collections".to_owned());
    }
    if let Some("getCollectionNames" | "getCollectionInfos") = of_database(line) {
        return Some("rmem collections".to_owned());
    }
    let Line { namespace, method, arguments, modifiers } = Line::parse(line, database)?;
    Some(words(method, &namespace, &arguments, &modifiers)?.join(" "))
}

/// The words of the command for a method; none where the line has options that they would leave out.
fn words(method: &str, ns: &str, arguments: &[&str], modifiers: &[Segment<'_>]) -> Option<Vec<String>> {
    let given = |nth: usize| arguments.get(nth).copied().filter(|text| !is_empty(text));
    let word_of = |nth: usize| given(nth).map(quoted);
    let has =
        |option: &str| arguments.last().is_some_and(|text| members(text).any(|member| member == (option, "true")));
    let flag = |name: &str, is_set: bool| is_set.then(|| name.to_owned());
    let command = |name: &str| vec!["rmem".to_owned(), name.to_owned(), ns.to_owned()];
    let is_counted = modifiers.iter().any(|segment| ["count", "size", "length", "itcount"].contains(&segment.name));
    let with = |name: &str, more: Vec<Option<String>>| [command(name), more.into_iter().flatten().collect()].concat();
    let change = |name: &str, more: &[Option<String>]| {
        let rest = [vec![Some(quoted(arguments.first()?)), Some(quoted(arguments.get(1)?))], more.to_vec()].concat();
        Some(with(name, rest))
    };
    let update = |more: &[Option<String>]| change("update", more);
    let upsert = flag("--upsert", arguments.len() > 2 && has("upsert"));
    if !is_understood(method, arguments, modifiers) {
        return None;
    }
    Some(match method {
        "find" if is_counted => with("count", vec![word_of(0)]),
        "find" => {
            let projection = word_of(1).map(|fields| format!("--fields {fields}"));
            [with("query", vec![word_of(0), projection]), options(modifiers)].concat()
        }
        "findOne" => {
            let projection = word_of(1).map(|fields| format!("--fields {fields}"));
            with("query", vec![word_of(0), projection, Some("--limit 1".to_owned())])
        }
        "insertOne" | "insertMany" | "insert" | "save" => with("insert", vec![word_of(0)]),
        "updateOne" => update(&[upsert])?,
        "updateMany" => update(&[Some("--many".to_owned()), upsert])?,
        "update" => update(&[flag("--many", arguments.len() > 2 && has("multi")), upsert])?,
        "replaceOne" => update(&[Some("--replace".to_owned()), upsert])?,
        "deleteMany" | "remove" if given(0).is_none() => with("delete", vec![Some("--all".to_owned())]),
        "deleteMany" | "remove" => with("delete", vec![word_of(0), Some("--many".to_owned())]),
        "deleteOne" => with("delete", vec![word_of(0)]),
        "findOneAndUpdate" => change("find-and-modify", &[upsert])?,
        "findOneAndReplace" => change("find-and-modify", &[Some("--replace".to_owned()), upsert])?,
        "findOneAndDelete" => with("find-and-modify", vec![word_of(0), Some("--remove".to_owned())]),
        "countDocuments" | "count" | "estimatedDocumentCount" => with("count", vec![word_of(0)]),
        "aggregate" if arguments.len() > 1 && !arguments.first()?.starts_with('[') => {
            with("aggregate", vec![Some(quoted(&format!("[{}]", arguments.join(", "))))])
        }
        "aggregate" => with("aggregate", vec![Some(quoted(arguments.first().copied().unwrap_or("[]")))]),
        "distinct" => with("distinct", vec![Some(name(arguments.first()?)), word_of(1)]),
        "drop" => with("drop", Vec::new()),
        "createIndex" | "ensureIndex" => {
            with("index", vec![word_of(0), flag("--unique", arguments.len() > 1 && has("unique"))])
        }
        "getIndexes" => with("index", Vec::new()),
        "dropIndex" => with("index", vec![Some(name(arguments.first()?)), Some("--drop".to_owned())]),
        "watch" => with("watch", Vec::new()),
        _ => return None,
    })
}

/// Whether a command can say all that a line does.
fn is_understood(method: &str, arguments: &[&str], modifiers: &[Segment<'_>]) -> bool {
    // How many arguments there are, and which options the last of them may have.
    let (most, known): (usize, &[&str]) = match method {
        "find" | "findOne" | "distinct" => (2, &[]),
        "updateOne" | "updateMany" | "replaceOne" | "findOneAndUpdate" | "findOneAndReplace" => (3, &["upsert"]),
        "update" => (3, &["upsert", "multi"]),
        "createIndex" | "ensureIndex" => (2, &["unique"]),
        "aggregate" => (usize::MAX, &[]),
        "drop" | "getIndexes" | "watch" | "estimatedDocumentCount" => (0, &[]),
        _ => (1, &[]),
    };
    let options = arguments.last().filter(|_| !known.is_empty() && arguments.len() == most);
    let are_known = options.is_none_or(|text| members(text).all(|(key, _)| known.contains(&key)));
    // One document of all, and a replacement without --replace, have no command.
    let is_refused = match method {
        "deleteOne" | "findOneAndDelete" => arguments.first().is_none_or(|query| is_empty(query)),
        "update" => arguments.get(1).is_none_or(|change| !change.contains('$')),
        "distinct" => arguments.first().is_none_or(|field| field.contains('\\')),
        _ => false,
    };
    let is_plain = |segment: &Segment<'_>| match segment.name {
        "limit" | "skip" => segment.arguments.as_ref().is_some_and(|arguments| !arguments.iter().any(is_negative)),
        "sort" | "projection" | "explain" | "pretty" | "toArray" | "count" | "size" | "length" | "itcount" => true,
        _ => false,
    };
    arguments.len() <= most && are_known && !is_refused && modifiers.iter().all(is_plain)
}

fn is_negative(text: &&str) -> bool {
    text.starts_with('-')
}

/// The keys and values of a document without others in it.
fn members(text: &str) -> impl Iterator<Item = (&str, &str)> {
    let inner = text.trim().trim_start_matches('{').trim_end_matches('}');
    let members = inner.split(',').filter_map(|member| member.split_once(':'));
    members.map(|(key, value)| (key.trim().trim_matches(['"', '\'']), value.trim()))
}

/// The options that methods of a cursor stand for; others, like `toArray`, have none.
fn options(modifiers: &[Segment<'_>]) -> Vec<String> {
    let option = |segment: &Segment<'_>| {
        let argument = segment.arguments.as_ref().and_then(|arguments| arguments.first().copied());
        match segment.name {
            "sort" => Some(format!("--sort {}", quoted(argument?))),
            "limit" | "skip" => Some(format!("--{} {}", segment.name, argument?)),
            "projection" => Some(format!("--fields {}", quoted(argument?))),
            "explain" => Some("--explain".to_owned()),
            _ => None,
        }
    };
    modifiers.iter().filter_map(option).collect()
}

/// A text as one word of a command line.
fn quoted(text: &str) -> String {
    word(text.trim())
}

/// The same of a name, which has quotes of its own in the line.
fn name(text: &str) -> String {
    if is_text(text) { word(&unquoted(text)) } else { quoted(text) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_mongosh_is_a_command() {
        for (line, wanted) in [
            ("db.orders.find({team:'CYAN'})", "rmem query robmem.orders \"{team:'CYAN'}\""),
            ("db.orders.find()", "rmem query robmem.orders"),
            ("db.orders.find({}).pretty();", "rmem query robmem.orders"),
            ("robmem.orders.find({n: {$gt: 3}})", "rmem query robmem.orders '{n: {$gt: 3}}'"),
            ("orders.find({n: 1}, {n: 1, _id: 0})", "rmem query robmem.orders \"{n: 1}\" --fields \"{n: 1, _id: 0}\""),
            (
                "db.orders.find({a: 'x.y(z)'}).sort({n: -1}).skip(2).limit(5)",
                "rmem query robmem.orders \"{a: 'x.y(z)'}\" --sort \"{n: -1}\" --skip 2 --limit 5",
            ),
            ("db.orders.find({n: 1}).count()", "rmem count robmem.orders \"{n: 1}\""),
            ("db.orders.findOne({_id: 7})", "rmem query robmem.orders \"{_id: 7}\" --limit 1"),
            ("db.orders.insertOne({team: \"CYAN\"})", "rmem insert robmem.orders '{team: \"CYAN\"}'"),
            ("db.orders.insertMany([{n: 1}, {n: 2}])", "rmem insert robmem.orders \"[{n: 1}, {n: 2}]\""),
            (
                "db.orders.updateOne({team: 'CYAN'}, {$set: {n: 'x'}}, {upsert: true})",
                "rmem update robmem.orders \"{team: 'CYAN'}\" \"{\\$set: {n: 'x'}}\" --upsert",
            ),
            (
                "db.x.update({a: 1}, {$set: {b: 1}}, {upsert: true, multi: false})",
                "rmem update robmem.x \"{a: 1}\" '{$set: {b: 1}}' --upsert",
            ),
            ("db.a.b.updateMany({}, {$inc: {n: 1}})", "rmem update robmem.a.b \"{}\" '{$inc: {n: 1}}' --many"),
            ("db.orders.replaceOne({_id: 1}, {n: 2})", "rmem update robmem.orders \"{_id: 1}\" \"{n: 2}\" --replace"),
            ("db.orders.deleteOne({n: 1})", "rmem delete robmem.orders \"{n: 1}\""),
            ("db.orders.deleteMany({n: 1})", "rmem delete robmem.orders \"{n: 1}\" --many"),
            ("db.orders.deleteMany({})", "rmem delete robmem.orders --all"),
            ("db.orders.countDocuments()", "rmem count robmem.orders"),
            ("db.orders.distinct('team', {n: 1})", "rmem distinct robmem.orders team \"{n: 1}\""),
            ("db.orders.aggregate([{$match: {n: 1}}])", "rmem aggregate robmem.orders '[{$match: {n: 1}}]'"),
            ("db.orders.drop()", "rmem drop robmem.orders"),
            ("db.orders.createIndex({n: 1}, {unique: true})", "rmem index robmem.orders \"{n: 1}\" --unique"),
            (
                "db.orders.findOneAndUpdate({n: 1}, {$set: {n: 2}})",
                "rmem find-and-modify robmem.orders \"{n: 1}\" '{$set: {n: 2}}'",
            ),
            (
                "db.orders.findOneAndReplace({n: 1}, {n: 2})",
                "rmem find-and-modify robmem.orders \"{n: 1}\" \"{n: 2}\" --replace",
            ),
            ("db.orders.findOneAndDelete({n: 1})", "rmem find-and-modify robmem.orders \"{n: 1}\" --remove"),
            ("db['orders'].find({n: 1})", "rmem query robmem.orders \"{n: 1}\""),
            ("db[\"shop.orders\"].find()", "rmem query robmem.shop.orders"),
            ("db.orders.find", "rmem query robmem.orders"),
            ("db.orders.countDocuments", "rmem count robmem.orders"),
            ("show collections", "rmem collections"),
            ("db.getCollectionNames()", "rmem collections"),
            ("show dbs;", "rmem collections"),
            ("db.getSiblingDB('lab').getCollection('orders').find()", "rmem query lab.orders"),
        ] {
            assert_eq!(command(line, "robmem").as_deref(), Some(wanted), "{line}");
        }
    }

    #[test]
    fn the_database_is_that_of_the_default_collection() {
        for (line, wanted) in [
            ("db.orders.find()", "rmem query shop.orders"),
            ("orders.find()", "rmem query shop.orders"),
            ("robmem.orders.find()", "rmem query robmem.orders"),
            ("db.getSiblingDB('lab').orders.find()", "rmem query lab.orders"),
        ] {
            assert_eq!(command(line, "shop").as_deref(), Some(wanted), "{line}");
        }
    }

    #[test]
    fn other_texts_are_no_lines_of_mongosh() {
        for text in [
            "",
            "db",
            "robmem.orders",
            "a b.c",
            "db.orders.find({)",
            "db.find({'x})",
            "db.(x)",
            "db.x.dance()",
            "db.x.remove({a: 1}, true)",
            "db.x.remove({a: 1}, {justOne: true})",
            "db.x.deleteOne({})",
            "db.x.update({a: 1}, {$set: {b: 1}}, false, true)",
            "db.x.update({a: 1}, {b: 1})",
            "db.x.updateOne({a: 1}, {$set: {b: 1}}, {arrayFilters: [{x: 1}]})",
            "db.x.createIndex({a: 1}, {expireAfterSeconds: 60, unique: true})",
            "db.x.find({a: 1}, {b: 1}, {limit: 1})",
            "db.x.count({a: 1}, {limit: 1})",
            "db.x.find({a: 1}).limit(-1)",
            "db.x.find({a: 1}).collation({locale: 'de'}).forEach(printjson)",
            "é.(",
            "f()",
            "db[0].find()",
            "robmem.find",
            "show",
            "db.x.findOneAndUpdate({a: 1}, {$set: {b: 1}}, {returnDocument: 'after'})",
        ] {
            assert_eq!(command(text, "robmem"), None, "{text}");
        }
    }
}
