#!/usr/bin/env bash
# Documents counted by a function in JavaScript: rmem, and a mongod, in turn, over the same documents.
#
#   PYTHON=/path/to/python RMEM_TEST_MONGOD=/path/to/mongod benches/where.sh [DOCUMENTS]
#
# PYTHON has pymongo; RMEM is an rmem built for release (target/release/rmem). Prints seconds by the clock, the best of
# five runs of rmem and of two of mongod (RUNS=N: of so many), and their ratio: rmem as a process from its start to its
# end, mongod by its answer to `count` alone. Both have to count the same.
set -euo pipefail
cd "$(dirname "$0")/.."
count=${1:-100000} python=${PYTHON:-python3} rmem=${RMEM:-$PWD/target/release/rmem} port=${PORT:-27992} runs=${RUNS:-2}
folder=$(mktemp -d)
trap 'kill "${server:-}" 2>/dev/null; wait 2>/dev/null || true; rm -rf "$folder"' EXIT

mkdir "$folder/db"
"${RMEM_TEST_MONGOD:-mongod}" --dbpath "$folder/db" --port "$port" --bind_ip 127.0.0.1 --nounixsocket >"$folder/log" 2>&1 &
server=$!
"$python" - "$folder" "$count" "$port" <<'PY'
import json, sys
import pymongo
folder, count, port = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
things = [{"_id": n, "name": f"thing {n}", "n": n * 7919 % count} for n in range(count)]
with open(folder + "/documents.jsonl", "w") as out:
    out.writelines(json.dumps(thing) + "\n" for thing in things)
pymongo.MongoClient("127.0.0.1", port).bench.things.insert_many(things)
PY
memory=(--quiet --memory "file:$folder/memory.rmem")
"$rmem" "${memory[@]}" insert bench.things --file "$folder/documents.jsonl" >/dev/null
cat >"$folder/count.py" <<'PY'
import sys, time
import pymongo
database = pymongo.MongoClient("127.0.0.1", int(sys.argv[1])).bench
start = time.perf_counter()
found = database.command("count", "things", query={"$where": sys.argv[2]})["n"]
print(found, time.perf_counter() - start)
PY

# row FUNCTION: counts with it on both.
row() {
  for _ in 1 2 3 4 5; do
    begin=$(date +%s.%N)
    ours=$("$rmem" "${memory[@]}" count bench.things "{\$where: \"$1\"}")
    echo "$ours $begin $(date +%s.%N)" | awk '{ print $1, $3 - $2 }' >>"$folder/ours"
  done
  for _ in $(seq "$runs"); do "$python" "$folder/count.py" "$port" "$1" >>"$folder/theirs"; done
  if [ "$(cut -d ' ' -f 1 "$folder/ours" "$folder/theirs" | sort -u | wc -l)" != 1 ]; then
    echo "the counts differ: $1" >&2
    exit 1
  fi
  best() { cut -d ' ' -f 2 "$folder/$1" | sort -g | head -n 1; }
  echo "$(best ours) $(best theirs)" | awk -v text="$1" '{ printf "%-44s %9.3f %9.3f %7.1f\n", text, $1, $2, $2 / $1 }'
  rm "$folder/ours" "$folder/theirs"
}

printf '%-44s %9s %9s %7s\n' "$count documents" rmem mongod ratio
row 'this.n % 7 == 3'
row 'function() { return this.name.length > 9; }'
