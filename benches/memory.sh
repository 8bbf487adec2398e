#!/bin/sh
# How much memory rmem takes at most with many documents, in MB.
#
#   benches/memory.sh PROGRAM
#
# PROGRAM is rmem, built with --release. COUNT is the number of documents (default: 1000000). Each row has a command, how long it
# took in seconds, and the most memory that its process had (GNU time's maximum resident set size).
set -eu

rmem=$1
count=${COUNT:-1000000}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
memory="--quiet --memory file:$folder/memory.rmem"
awk -v n="$count" 'BEGIN { for (i = 0; i < n; i++) printf "{\"_id\": %d, \"name\": \"object%d\", \"n\": %d}\n", i, i, i * 7919 % n }' \
    >"$folder/documents.jsonl"
cat >"$folder/problem.j2" <<'JINJA'
(define (problem tidy-up) (:domain tidy)
  (:objects
{%- for thing in query("bench.objects", {}) %}
    {{ thing.name }} - thing
{%- endfor %})
  (:init
{%- for thing in query("bench.objects", {}) %}
    (tidied {{ thing.name }})
{%- endfor %})
  (:goal (tidied object0)))
JINJA
cat >"$folder/domain.pddl" <<'PDDL'
(define (domain tidy) (:requirements :strips :typing) (:types thing) (:predicates (tidied ?thing - thing)))
PDDL

# row NAME ARGUMENTS…: runs rmem with the arguments, and prints what it took.
row() {
    name=$1
    shift
    # shellcheck disable=SC2086
    /usr/bin/time -o "$folder/took" -f '%e %M' "$rmem" $memory "$@" >/dev/null || echo "$name failed"
    tail -n 1 "$folder/took" | awk -v name="$name" '{ printf "%-24s %8.2f %8.0f\n", name, $1, $2 / 1024 }'
}

printf '%-24s %8s %8s\n' "$count documents" seconds MB
row 'insert' insert bench.objects --file "$folder/documents.jsonl"
row 'query (JSON lines)' query bench.objects '{}'
row '--format table' query bench.objects '{}' --format table
row '--format csv' query bench.objects '{}' --format csv
row 'sort' query bench.objects '{}' --sort '{n: 1}'
row 'distinct' distinct bench.objects name
row '$group' aggregate bench.objects '[{$group: {_id: "$name", n: {$sum: "$n"}}}]'
row '$sort' aggregate bench.objects '[{$sort: {n: 1}}]'
row '$bucketAuto' aggregate bench.objects '[{$bucketAuto: {groupBy: "$n", buckets: 10}}]'
row '$facet' aggregate bench.objects '[{$facet: {a: [{$group: {_id: "$name"}}, {$count: "n"}], b: [{$sort: {n: 1}}, {$limit: 1}]}}]'
row '$setWindowFields' aggregate bench.objects '[{$setWindowFields: {sortBy: {n: 1}, output: {s: {$sum: "$n", window: {documents: [-1, 0]}}}}}]'
row '$lookup' aggregate bench.objects '[{$lookup: {from: "objects", localField: "n", foreignField: "_id", as: "other"}}]'
row '$out' aggregate bench.objects '[{$match: {}}, {$out: "copy"}]'
# shellcheck disable=SC2086
"$rmem" $memory backup "$folder/other.rmem" >/dev/null
row 'diff' diff "file:$folder/memory.rmem" "file:$folder/other.rmem"
row 'index' index bench.objects '{n: 1}'
row 'update --many' update bench.objects '{}' '{$inc: {n: 1}}' --many
row 'dump' dump bench.objects -o "$folder/dump"
row 'restore' restore "$folder/dump" --drop
row 'gen-problem' gen-problem --template "$folder/problem.j2" -o "$folder/problem.pddl"
row 'gen-problem --domain' gen-problem --template "$folder/problem.j2" --domain "$folder/domain.pddl" -o "$folder/problem.pddl"
row 'delete' delete bench.objects --all
