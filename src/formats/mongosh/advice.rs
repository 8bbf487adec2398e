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

/// Returns which commands do what a method of mongosh does, by its name alone.
#[must_use]
pub fn advice_on_method(method: &str, database: &str) -> Option<String> {
    for_collection(method, "NS").or_else(|| for_database(method, database))
}

fn for_database(method: &str, database: &str) -> Option<String> {
    Some(match method.to_ascii_lowercase().as_str() {
        "dropdatabase" => {
            format!(
                "'rmem drop --database {database}' removes all collections of {database}, and 'rmem drop NS' one of them"
            )
        }
        "runcommand" | "admincommand" => {
            "rmem has a command for each, which 'rmem --help' lists; 'rmem serve' takes commands from MongoDB's drivers"
                .to_owned()
        }
        "createcollection" => {
            "a collection is made with its first document: 'rmem insert NS DOC'; 'rmem create NS --collation COLLATION' \
             makes an empty one"
                .to_owned()
        }
        "createview" => {
            "'rmem aggregate NS PIPELINE' answers a pipeline; a computable of rmem.toml is like a view".to_owned()
        }
        "stats" | "serverstatus" | "hostinfo" | "version" | "getname" => {
            "'rmem collections' lists the collections, 'rmem doctor' checks the memory, and 'rmem config' names it"
                .to_owned()
        }
        "watch" => "'rmem watch NS [QUERY]' prints the changes of a collection".to_owned(),
        "aggregate" => "'rmem aggregate NS PIPELINE' runs a pipeline on a collection".to_owned(),
        _ => return None,
    })
}

fn for_collection(method: &str, ns: &str) -> Option<String> {
    Some(match method.to_ascii_lowercase().as_str() {
        "bulkwrite" | "initializeorderedbulkop" | "initializeunorderedbulkop" => {
            format!(
                "'rmem insert {ns} DOC…', 'rmem update {ns} QUERY UPDATE' and 'rmem delete {ns} QUERY' write one kind of change each"
            )
        }
        "find" | "findone" => {
            format!("'rmem query {ns} [QUERY]' prints documents, with --sort, --skip, --limit, --fields and more")
        }
        "insert" | "insertone" | "insertmany" | "save" => format!("'rmem insert {ns} DOC…' stores documents"),
        "update" | "updateone" | "updatemany" | "replaceone" => {
            format!(
                "'rmem update {ns} QUERY UPDATE' changes documents, with --many, --upsert, --replace and --array-filter"
            )
        }
        "remove" | "deleteone" | "deletemany" => {
            format!(
                "'rmem delete {ns} QUERY' removes the first document, with --many all that match, and 'rmem delete {ns} --all' all"
            )
        }
        "findandmodify" | "findoneandupdate" | "findoneandreplace" | "findoneanddelete" => {
            format!("'rmem find-and-modify {ns} QUERY UPDATE' has --new, --upsert, --replace, --sort and --remove")
        }
        "count" | "countdocuments" | "estimateddocumentcount" => format!("'rmem count {ns} [QUERY]' counts documents"),
        "distinct" => format!("'rmem distinct {ns} FIELD [QUERY]' prints the values of a field"),
        "aggregate" => format!("'rmem aggregate {ns} PIPELINE' runs a pipeline"),
        "mapreduce" => format!("'rmem map-reduce {ns} --map FUNCTION --reduce FUNCTION' runs functions"),
        "createindex" | "createindexes" | "ensureindex" | "reindex" => {
            format!("'rmem index {ns} KEYS' has --unique, --ttl, --sparse, --partial and --name")
        }
        "getindexes" | "getindices" | "getindexkeys" => format!("'rmem index {ns}' lists the indexes"),
        "dropindex" | "dropindexes" => format!("'rmem index {ns} KEYS --drop' removes an index"),
        "stats" | "datasize" | "storagesize" | "totalsize" | "totalindexsize" | "latencystats" => {
            format!(
                "'rmem aggregate {ns} \"[{{\\$collStats: {{storageStats: {{}}}}}}]\"' says how large it is, and 'rmem schema {ns}' what is in it"
            )
        }
        "watch" => format!("'rmem watch {ns} [QUERY]' prints changes as they happen"),
        "drop" => format!("'rmem drop {ns}' removes the collection"),
        "renamecollection" => {
            format!("'rmem rename {ns} NS' gives it another name")
        }
        "explain" => format!("'rmem query {ns} [QUERY] --explain' says how it is answered"),
        "exists" | "iscapped" | "validate" => "'rmem collections' lists the collections".to_owned(),
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
            ("db.dropDatabase()", "rmem drop --database lab"),
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
