#!/usr/bin/env bash
# Facts out of and into documents: rmem, and clipspy with a loop written by hand, in turn.
#
#   PYTHON=/path/to/python benches/clips.sh [FACTS]
#
# PYTHON has clipspy; RMEM is an rmem built for release (target/release/rmem). Prints seconds, the best of three runs
# of each as a process from its start to its end: by the clock, and of the processor, which a busy machine changes less.
set -euo pipefail
cd "$(dirname "$0")/.."
count=${1:-100000} python=${PYTHON:-python3} rmem=${RMEM:-$PWD/target/release/rmem}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

cat >"$folder/t.clp" <<'CLP'
(deftemplate thing (slot id (type INTEGER)) (slot name (type STRING)) (slot kind (type SYMBOL)) (multislot xy (type FLOAT)))
CLP
"$python" - "$folder" "$count" <<'PY'
import json, sys
folder, count = sys.argv[1], int(sys.argv[2])
with open(folder + "/documents.jsonl", "w") as out:
    for n in range(count):
        out.write(json.dumps({"relation": "thing", "id": n, "name": f"thing number {n}", "kind": f"kind{n % 7}", "xy": [n / 8, n / 4]}) + "\n")
PY

cat >"$folder/export.py" <<'PY'
import json, sys
import clips
folder = sys.argv[1]
environment = clips.Environment()
environment.load(folder + "/t.clp")
template = environment.find_template("thing")
with open(folder + "/documents.jsonl") as lines:
    for line in lines:
        document = json.loads(line)
        template.assert_fact(id=document["id"], name=document["name"], kind=clips.Symbol(document["kind"]), xy=document["xy"])
environment.save_facts(folder + "/clipspy.facts")
PY
cat >"$folder/import.py" <<'PY'
import json, sys
import clips
folder = sys.argv[1]
environment = clips.Environment()
environment.load(folder + "/t.clp")
environment.load_facts(folder + "/clipspy.facts")
with open(folder + "/clipspy.jsonl", "w") as out:
    for fact in environment.facts():
        if fact.template.name != "thing":
            continue
        document = {"relation": fact.template.name}
        for slot, value in fact:
            document[slot] = list(value) if isinstance(value, tuple) else str(value) if isinstance(value, clips.Symbol) else value
        out.write(json.dumps(document) + "\n")
PY

# What rmem exports from and imports into is a memory on disk, durable; clipspy has a file of JSON.
"$rmem" --memory "file:$folder/from.rmem" insert a.b --file "$folder/documents.jsonl" >/dev/null
TIMEFORMAT='%R %U %S'
seconds() { { time "$@" >/dev/null 2>&1; } 2>&1 | awk '{print $1, $2 + $3}'; }
rmem_export() { "$rmem" --memory "file:$folder/from.rmem" clips export a.b --deftemplates "$folder/t.clp" -o "$folder/rmem.facts"; }
rmem_import() { rm -f "$folder"/into.rmem*; "$rmem" --memory "file:$folder/into.rmem" clips import "$folder/rmem.facts" --into a.b --deftemplates "$folder/t.clp"; }
clipspy_export() { "$python" "$folder/export.py" "$folder"; }
clipspy_import() { "$python" "$folder/import.py" "$folder"; }

best() { printf '%s\n' "${@:2}" | cut -d ' ' -f "$1" | sort -g | head -n 1; }

printf '%-8s %-10s %8s %8s %6s\n' "$count" '' rmem clipspy ratio
for work in export import; do
  ours=() theirs=()
  for _ in 1 2 3; do
    ours+=("$(seconds "rmem_$work")")
    theirs+=("$(seconds "clipspy_$work")")
  done
  for column in 1 2; do
    name=$([ "$column" = 1 ] && echo clock || echo processor)
    echo "$(best "$column" "${ours[@]}") $(best "$column" "${theirs[@]}")" |
      awk -v work="$work" -v name="$name" '{printf "%-8s %-10s %8.2f %8.2f %6.1f\n", work, name, $1, $2, $2 / $1}'
  done
done

# Both made the same facts: spelled differently, they are the same documents.
facts() {
  "$rmem" --memory "file:$folder/$1.rmem" clips import "$folder/$1.facts" --into a.c --deftemplates "$folder/t.clp" >/dev/null 2>&1
  "$rmem" --memory "file:$folder/$1.rmem" query a.c "{relation: 'thing'}" --fields '{_id: 0}' --sort '{id: 1}'
}
cmp <(facts rmem) <(facts clipspy) && echo "the facts are the same"
