//! The arguments of `rmem clips run`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use crate::formats::quantity;
use crate::store::Namespace;

/// What stands below the help of `clips run`.
const HELP: &str = "\
Examples:
  rmem clips run agent.clp
  rmem clips run templates.clp agent.clp --facts world.txt --timeout 10m --sync

Loads the programs, runs the commands among their constructs, resets, asserts the facts of --facts, and fires rules until no rule can fire. A program with \
triggers or a synchronized world model then waits for changes, until (exit), (halt), --timeout or an interrupt. \
Its output goes to stdout.

Exits with 0; with CODE of (exit CODE); with 1 after an error that halted the program; with 3 if a file does not \
load; with 23 if --timeout is over while rules fire; with 130 after an interrupt.

Functions: NS is DATABASE.COLLECTION, DOC is a document (an external address) or its text. If an operation fails, \
the error is printed on stderr and the function returns FALSE; wrong arguments and destroyed documents halt the \
program.

  (rm-insert NS DOC) (rm-query NS [DOC [SORT]]) (rm-query-sort NS DOC SORT) (rm-count NS [DOC])
  (rm-update NS DOC QUERY) sets the fields of the first match, or applies operators to it
  (rm-replace NS DOC QUERY) (rm-upsert NS DOC QUERY) (rm-delete NS QUERY), also called rm-remove
  (rm-create-index NS KEYS) (rm-create-unique-index NS KEYS)
  (rm-aggregate NS PIPELINE), a cursor; PIPELINE is a text, or made by (rm-pipeline-create)
     (rm-pipeline-append PIPELINE STAGE) (rm-pipeline-destroy PIPELINE)
  (rm-cursor-next C), a document or FALSE, (rm-cursor-more C) (rm-cursor-destroy C)
  (rm-fact-to-bson FACT [RELATION]) (rm-structured-fact-to-bson FACT [RELATION]) (rm-ordered-fact-to-bson FACT)
  (rm-assert-from-bson DOC)
  (rm-trigger-register NS QUERY NAME) (rm-trigger-destroy T); each change asserts
     (robmem-trigger (name \"NAME\") (rcvd-at SEC USEC) (ptr DOC) (operation insert) (namespace \"NS\")
        (id \"…\") (before \"…\") (after \"…\")) and the ordered fact (NAME)
  (rm-gen-problem TEMPLATE [GOAL [NAME VALUE]…]), a string
  (rm-plan DOMAIN PROBLEM [PLANNER [SECONDS]]), the id of the stored plan or FALSE; asserts the facts of
     rmem plan --format clips for which the program has the deftemplates plan and plan-action
  (rm-dump NS PATH) (rm-restore PATH [NS])
  (synced-assert \"(template (slot value) …)\") (synced-modify FACT SLOT VALUE …) (synced-retract FACT)
  (synced-add-to-multifield FACT SLOT VALUE) (synced-remove-from-multifield FACT SLOT VALUE)
     keep a world model with all programs that use the namespace of --sync, by the slot sync-id

As in Fawkes: robmem-insert robmem-query robmem-query-sort robmem-count robmem-update robmem-replace
robmem-upsert robmem-remove robmem-create-index robmem-create-unique-index robmem-cursor-next
robmem-cursor-more robmem-cursor-destroy robmem-trigger-register robmem-trigger-destroy
(robmem-dump-collection NS DIR) (robmem-restore-collection NS DIR [NS]) (robmem-mutex-create NAME)
robmem-mutex-destroy (robmem-mutex-try-lock NAME OWNER) robmem-mutex-renew-lock robmem-mutex-force-lock
robmem-mutex-unlock (robmem-mutex-setup-ttl SEC) (robmem-mutex-expire-locks SEC)
bson-create bson-parse bson-destroy bson-tostring bson-append bson-append-array bson-append-time
bson-append-regex bson-array-start bson-array-append bson-array-finish bson-field-names bson-has-field
bson-get bson-get-array bson-get-time robmem-aggregate robmem-pipeline-create robmem-pipeline-append
robmem-pipeline-destroy now now-systime
(robmem-mutex-create-async NAME) robmem-mutex-destroy-async (robmem-mutex-try-lock-async NAME OWNER)
robmem-mutex-renew-lock-async robmem-mutex-force-lock-async robmem-mutex-unlock-async
(robmem-mutex-expire-locks-async SEC), which assert (mutex-op-feedback OPERATION OK|FAIL NAME) as there.
Mutexes are those of rmem lock; after a trigger on robmem_coordination.mutex, those of that collection.

As in the CLIPS executive, for a deftemplate wm-fact with the slots id, key, type, is-list, value and values:
(wm-robmem-sync-enable PREFIX …) keeps facts whose id begins so in syncedrobmem.worldmodel, with all engines
that do; the later change wins. (wm-robmem-sync-restore) (wm-robmem-sync-restore-prefix PREFIX) (wm-robmem-flush)

As in the RCLL referee box, a collection without a database is one of the database of --collection:
mongodb-insert mongodb-query mongodb-query-sort mongodb-update mongodb-replace mongodb-upsert
mongodb-cursor-next mongodb-cursor-more mongodb-cursor-destroy bson-builder-destroy

As in Fawkes, for the files of a program: (path-load FILE), also as path-load* path-batch path-batch*, loads the first FILE in the folders of
--path, of the programs, and the current one; (path-resolve FILE), also as resolve-file, gives its path or FALSE;
(path-add DIR …) (path-add-subst WHAT BY) (path-get), also as get-clips-dirs. (config-load PREFIX), also as load-config, asserts
(confval (path \"/a/b\") (type T) (value V)) for the values of --values below PREFIX, and (config-load FILE PREFIX), as in
the CLIPS executive, those of another YAML file. (ff-feature-request robot_memory) is TRUE and asserts (ff-feature-loaded robot_memory)

As in CLIPS 6.30: length, and length$ of texts. A function that a program defines itself takes the place of one of this list, and of one
that is new in CLIPS 6.40, such as str-replace.";

/// Run CLIPS programs with functions for the memory
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct RunArgs {
    /// Files with constructs, loaded in this order; - is stdin
    #[arg(value_name = "PROGRAM", required = true)]
    pub programs: Vec<PathBuf>,
    /// File with facts to assert after the reset, as (save-facts) writes them (can be repeated)
    #[arg(long, value_name = "FILE")]
    pub facts: Vec<PathBuf>,
    /// Folder where (path-load) finds files, before those of the programs (can be repeated)
    #[arg(long, value_name = "DIR")]
    pub path: Vec<PathBuf>,
    /// YAML file with the robot's configuration for (config-load) (can be repeated)
    #[arg(long, value_name = "FILE")]
    pub values: Vec<PathBuf>,
    /// Fire at most N rules
    #[arg(long, value_name = "N")]
    pub cycles: Option<u64>,
    /// Exit after this time
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub timeout: Option<Duration>,
    /// Synchronize the world model of NS from the start, not from the first change of the program
    #[arg(long, value_name = "NS", num_args = 0..=1, default_missing_value = WORLD, require_equals = true)]
    pub sync: Option<Namespace>,
}

/// The default namespace of the synchronized world model, as in Fawkes.
pub(super) const WORLD: &str = "syncedrobmem.clipswm";

#[cfg(all(test, feature = "clips-engine"))]
mod tests {
    use crate::clips::engine;

    #[test]
    fn the_help_names_every_function() {
        let missing: Vec<_> = engine::names().into_iter().filter(|name| !super::HELP.contains(name)).collect();
        assert!(missing.is_empty(), "{missing:?}");
    }
}
