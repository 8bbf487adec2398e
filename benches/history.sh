#!/bin/sh
# What it costs to keep a history, and what it costs where none is kept.
#
#   benches/history.sh PROGRAM [EARLIER_PROGRAM]
#
# PROGRAM is rmem, built with --release. With the program of an earlier commit, as one before 84b04fc, which had no
# histories, the rows `off` of both are what a history costs where it is off. Each row is the shortest of five runs,
# in seconds, which take turns: inserting documents, updating them all, and 200 updates of one, a process each.
set -eu

count=${COUNT:-100000}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
awk -v n="$count" 'BEGIN { for (i = 0; i < n; i++) printf "{\"_id\": %d, \"name\": \"object %d\", \"n\": 0}\n", i, i }' \
    >"$folder/documents.jsonl"
echo 'keep_history = "24h"' >"$folder/on.toml"
: >"$folder/off.toml"

now() { date +%s.%N; }

# run PROGRAM SETTINGS: one line with the three times.
run() {
    rm -f "$folder"/memory.rmem*
    rmem="$1 --config $folder/$2.toml --memory file:$folder/memory.rmem --quiet"
    a=$(now)
    $rmem insert bench.objects --file "$folder/documents.jsonl" >/dev/null
    b=$(now)
    $rmem update bench.objects '{}' '{$inc: {n: 1}}' --many >/dev/null
    c=$(now)
    i=0
    while [ "$i" -lt 200 ]; do
        $rmem update bench.objects "{_id: $i}" '{$inc: {n: 1}}' >/dev/null
        i=$((i + 1))
    done
    d=$(now)
    echo "$a $b $c $d" | awk '{ print $2 - $1, $3 - $2, $4 - $3 }'
}

for round in 1 2 3 4 5; do
    run "$1" off >>"$folder/off"
    run "$1" on >>"$folder/on"
    [ $# -lt 2 ] || run "$2" off >>"$folder/earlier"
done

echo "history  insert  update  200 processes"
for name in off on earlier; do
    [ -e "$folder/$name" ] || continue
    awk -v name="$name" '{ for (i = 1; i <= 3; i++) if (NR == 1 || $i < least[i]) least[i] = $i }
        END { printf "%-7s  %6.2f  %6.2f  %6.2f\n", name, least[1], least[2], least[3] }' "$folder/$name"
done
