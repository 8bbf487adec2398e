#!/bin/sh
# How long a process that inserts one document waits while another one does a long write.
#
#   benches/waits.sh PROGRAM
#
# PROGRAM is rmem, built with --release. COUNT is the number of documents (default: 1000000). Each row has a long write, how long
# it took, and the longest insert of one document meanwhile, in seconds; a start of the program is part of it.
set -eu

rmem=$1
count=${COUNT:-1000000}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
memory="--quiet --memory file:$folder/memory.rmem"
awk -v n="$count" 'BEGIN { for (i = 0; i < n; i++) printf "{\"_id\": %d, \"name\": \"object %d\", \"n\": %d}\n", i, i, i % 97 }' \
    >"$folder/documents.jsonl"
$rmem $memory insert bench.objects --file "$folder/documents.jsonl" >/dev/null
$rmem $memory dump bench.objects -o "$folder/dump"

# during NAME ARGUMENTS…: inserts while rmem does what the arguments say.
during() {
    name=$1
    shift
    begin=$(date +%s.%N)
    $rmem $memory "$@" >/dev/null &
    long=$!
    longest=0
    while kill -0 "$long" 2>/dev/null; do
        before=$(date +%s.%N)
        $rmem $memory insert bench.other '{}' >/dev/null || echo "$name: the insert failed"
        longest=$(echo "$longest $before $(date +%s.%N)" | awk '{ wait = $3 - $2; print (wait > $1) ? wait : $1 }')
    done
    wait "$long" || echo "$name failed"
    echo "$begin $(date +%s.%N) $longest" | awk -v name="$name" '{ printf "%-20s %8.2f %8.2f\n", name, $2 - $1, $3 }'
}

printf '%-20s %8s %8s\n' '' took longest
during 'update --many' update bench.objects '{}' '{$inc: {n: 1}}' --many
during 'index' index bench.objects '{n: 1}'
during '$out' aggregate bench.objects '[{$match: {}}, {$out: "copy"}]'
during '$merge' aggregate bench.objects '[{$match: {}}, {$merge: "copy"}]'
during 'restore' restore "$folder/dump" --drop
during 'delete' delete bench.objects --all
