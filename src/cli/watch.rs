//! `watch`: triggers.

use std::time::Duration;

use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use super::quantity;
use crate::store::Namespace;

/// What stands below the help of `watch`.
pub(super) const HELP: &str = "\
Examples:
  rmem watch robmem.worldmodel \"{relation: 'on'}\"
  rmem watch robmem.plans \"{plan: 'success'}\" --resume executive --exec ./execute-plan.sh
  rmem watch robmem.orders --count 1 --timeout 30s
  rmem watch --names
  rmem watch robmem.plans --resume executive --forget

Prints a line for each change, in order: {operation, ns, _id, before, after, time, position}. The
operation is insert, update, replace, delete, or drop (the collection is gone; what restore --drop,
a rename or $out puts in its place follows as inserts). The query is matched against the document
after the change, before it for a deletion. Begins with what happens from now on; once it is ready
it says so on stderr.

--resume NAME keeps in the memory how far it is: who uses the name later goes on there, and misses
nothing; after a crash, changes may be delivered again: those of the last moment, or of the last
seconds where others write without a pause. One process at a time has a name (exit code 5). Changes
are kept for names until they are delivered, up to 256 MiB in a file and as long as the oplog on
MongoDB; a name that missed some says so. Forget names that nobody uses any more with --forget;
--names lists all with what waits for each. On MongoDB they are documents in rmem.watchers of the
watched database, a collection that no list and no dump of all has.

--exec runs CMD with sh -c for each change, one at a time: the line on stdin, RMEM_OPERATION,
RMEM_NAMESPACE and RMEM_POSITION in the environment. Where it fails, rmem says so and goes on; with
--resume it ends with the command's exit code, and begins with the same change the next time. What
the command leaves in the background lives on, unless rmem is killed while the command runs.

--format clips prints facts for (load-facts), each document as JSON in a string, and with
--resume NAME the ordered fact (NAME) too. CLIPS has to know their template:

(deftemplate robmem-trigger
   (slot name (type STRING))
   (multislot rcvd-at (type INTEGER) (cardinality 2 2))
   (slot operation (type SYMBOL))
   (slot namespace (type STRING))
   (slot id (type STRING))
   (slot before (type STRING))
   (slot after (type STRING)))

Ends with 0 after --count changes; with 1 when --timeout is over and there were fewer (without
--count: none); a command that still runs then is ended (TERM, two seconds later KILL), and its
change does not count. A MongoDB server has to be a replica set, which one member can be; the
collection is made to keep images of its documents before and after changes (and made, where it is
missing).";

/// `watch`
#[derive(Debug, Args)]
pub struct Watch {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS", required_unless_present = "names")]
    pub namespace: Option<Namespace>,
    /// Of which documents; all where it is left out
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// Run CMD for each change instead of printing it
    #[arg(long, value_name = "CMD")]
    pub exec: Option<String>,
    /// Go on where the last one of this name was done; a new name starts now
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub resume: Option<String>,
    /// Only forget the name
    #[arg(long, requires = "resume", conflicts_with_all = ["exec", "count", "timeout"])]
    pub forget: bool,
    /// Only list the names, who uses each, and what is kept for it
    #[arg(long, conflicts_with_all = ["namespace", "query", "exec", "resume", "count", "timeout", "computed", "meta"])]
    pub names: bool,
    /// End after N changes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// End after so long
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub timeout: Option<Duration>,
    /// Deliver documents that computables made, too
    #[arg(long)]
    pub computed: bool,
    /// Show the memory's metadata, `_robmem_info`
    #[arg(long)]
    pub meta: bool,
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_help_shows_the_template_of_the_facts() {
        assert!(super::HELP.contains(crate::clips::facts::TRIGGER));
    }
}
