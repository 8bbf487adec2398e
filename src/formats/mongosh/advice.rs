//! What rmem has for a line of mongosh that no command says as a whole.

use super::line::{Line, of_database};

/// Returns which commands do what a line does, where `db` is `database`; none where it is no line of mongosh.
#[must_use]
pub fn advice(line: &str, database: &str) -> Option<String> {
    if let Some(method) = of_database(line) {
        return for_database(method, database);
    }
    let Line { namespace, method, .. } = Line::parse(line, database)?;
    for_collection(method, &namespace)
}

fn for_database(method: &str, database: &str) -> Option<String> {
    Some(match method {
        "dropDatabase" => {
            format!("'rmem collections' lists the collections of {database}, and 'rmem drop NS' removes one of them")
        }
        "runCommand" | "adminCommand" => {
            "rmem has a command for each, which 'rmem --help' lists; 'rmem serve' takes commands from MongoDB's drivers"
                .to_owned()
        }
        "createCollection" => "a collection is made with its first document: 'rmem insert NS DOC'".to_owned(),
        "createView" => {
            "'rmem aggregate NS PIPELINE' answers a pipeline; a computable of rmem.toml is like a view".to_owned()
        }
        "stats" | "serverStatus" | "hostInfo" | "version" | "getName" => {
            "'rmem collections' lists the collections, 'rmem doctor' checks the memory, and 'rmem config' names it"
                .to_owned()
        }
        "watch" => "'rmem watch NS [QUERY]' prints the changes of a collection".to_owned(),
        "aggregate" => "'rmem aggregate NS PIPELINE' runs a pipeline on a collection".to_owned(),
        _ => return None,
    })
}

fn for_collection(method: &str, ns: &str) -> Option<String> {
    Some(match method {
        "bulkWrite" | "initializeOrderedBulkOp" | "initializeUnorderedBulkOp" => {
            format!(
                "'rmem insert {ns} DOC…', 'rmem update {ns} QUERY UPDATE' and 'rmem delete {ns} QUERY' write one kind of change each"
            )
        }
        "find" | "findOne" => {
            format!("'rmem query {ns} [QUERY]' has --sort, --skip, --limit, --fields and more; see its help")
        }
        "insert" | "insertOne" | "insertMany" | "save" => format!("'rmem insert {ns} DOC…' stores documents"),
        "update" | "updateOne" | "updateMany" | "replaceOne" => {
            format!("'rmem update {ns} QUERY UPDATE' has --many, --upsert, --replace and --array-filter")
        }
        "remove" | "deleteOne" | "deleteMany" => {
            format!(
                "'rmem delete {ns} QUERY' removes the first document, with --many all that match, and 'rmem delete {ns} --all' all"
            )
        }
        "findAndModify" | "findOneAndUpdate" | "findOneAndReplace" | "findOneAndDelete" => {
            format!("'rmem find-and-modify {ns} QUERY UPDATE' has --new, --upsert, --replace, --sort and --remove")
        }
        "count" | "countDocuments" | "estimatedDocumentCount" => format!("'rmem count {ns} [QUERY]' counts documents"),
        "distinct" => format!("'rmem distinct {ns} FIELD [QUERY]' prints the values of a field"),
        "aggregate" => format!("'rmem aggregate {ns} PIPELINE' runs a pipeline"),
        "mapReduce" => format!("'rmem map-reduce {ns} --map FUNCTION --reduce FUNCTION' runs functions"),
        "createIndex" | "createIndexes" | "ensureIndex" | "reIndex" => {
            format!("'rmem index {ns} KEYS' has --unique, --ttl, --sparse, --partial and --name")
        }
        "getIndexes" | "getIndices" | "getIndexKeys" => format!("'rmem index {ns}' lists the indexes"),
        "dropIndex" | "dropIndexes" => format!("'rmem index {ns} KEYS --drop' removes an index"),
        "stats" | "dataSize" | "storageSize" | "totalSize" | "totalIndexSize" | "latencyStats" => {
            format!(
                "'rmem aggregate {ns} \"[{{\\$collStats: {{storageStats: {{}}}}}}]\"' says how large it is, and 'rmem schema {ns}' what is in it"
            )
        }
        "watch" => format!("'rmem watch {ns} [QUERY]' prints changes as they happen"),
        "drop" => format!("'rmem drop {ns}' removes the collection"),
        "renameCollection" => {
            format!(
                "'rmem dump {ns} -o FILE.json' and 'rmem restore FILE.json --into NS' copy it, and 'rmem drop {ns}' removes it"
            )
        }
        "explain" => format!("'rmem query {ns} [QUERY] --explain' says how it is answered"),
        "exists" | "isCapped" | "validate" => "'rmem collections' lists the collections".to_owned(),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_without_a_command_of_their_own_have_a_tip() {
        for (line, wanted) in [
            ("db.orders.bulkWrite([{insertOne: {document: {a: 1}}}])", "rmem insert lab.orders DOC"),
            ("db.orders.findAndModify({query: {a: 1}, remove: true})", "rmem find-and-modify lab.orders"),
            ("db.orders.createIndex({a: 1}, {expireAfterSeconds: 60})", "rmem index lab.orders KEYS"),
            ("robmem.orders.stats()", "rmem aggregate robmem.orders"),
            ("db.orders.updateOne({a: 1}, {$set: {b: 1}}, {arrayFilters: [{x: 1}]})", "--array-filter"),
            ("db.orders.explain().find({a: 1})", "rmem query lab.orders"),
            ("db.dropDatabase()", "rmem drop NS"),
            ("db.runCommand({ping: 1})", "rmem serve"),
            ("db.getSiblingDB('x').adminCommand({ping: 1})", "rmem serve"),
        ] {
            let tip = advice(line, "lab");
            assert!(tip.as_ref().is_some_and(|tip| tip.contains(wanted)), "{line}: {tip:?}");
        }
        for line in ["", "db", "db.orders.dance()", "robmem.orders", "db.dance()", "f()"] {
            assert_eq!(advice(line, "lab"), None, "{line}");
        }
    }

    #[test]
    fn tips_are_whole() {
        let methods = [
            "bulkWrite",
            "find",
            "insert",
            "update",
            "remove",
            "findAndModify",
            "count",
            "distinct",
            "aggregate",
            "mapReduce",
            "createIndex",
            "getIndexes",
            "dropIndex",
            "stats",
            "watch",
            "drop",
            "renameCollection",
            "explain",
            "exists",
        ];
        let of_database =
            ["dropDatabase", "runCommand", "createCollection", "createView", "stats", "watch", "aggregate"];
        let collections = methods.iter().map(|method| format!("db.x.{method}()"));
        let databases = of_database.iter().map(|method| format!("db.{method}()"));
        for tip in collections.chain(databases).map(|line| advice(&line, "lab").unwrap_or_default()) {
            assert!(tip.contains("rmem"), "{tip}");
        }
    }
}
