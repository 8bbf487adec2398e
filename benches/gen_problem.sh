#!/usr/bin/env bash
# A PDDL problem from a memory: rmem, and a script in Python with pymongo and Jinja2 reading a mongod, in turn.
#
#   PYTHON=/path/to/python RMEM_TEST_MONGOD=/path/to/mongod benches/gen_problem.sh [DOCUMENTS]
#
# PYTHON has pymongo and jinja2; RMEM is an rmem built for release (target/release/rmem). Both render the same template
# over the same documents. Prints seconds, the best of five runs of each as a process from its start to its end: by the
# clock, and of the processor, which a busy machine changes less; what the server works for Python is not counted.
set -euo pipefail
cd "$(dirname "$0")/.."
count=${1:-100000} python=${PYTHON:-python3} rmem=${RMEM:-$PWD/target/release/rmem} port=${PORT:-27993}
folder=$(mktemp -d)
trap 'kill "${server:-}" 2>/dev/null; wait 2>/dev/null || true; [ -n "${KEEP:-}" ] || rm -rf "$folder"' EXIT

"$python" - "$folder" "$count" <<'PY'
import json, sys
folder, count = sys.argv[1], int(sys.argv[2])
with open(folder + "/documents.jsonl", "w") as out:
    for n in range(count):
        thing = {"type": "object", "name": f"thing{n}", "location": f"place{n % 100}", "tidied": n % 3 == 0}
        out.write(json.dumps(thing) + "\n")
    for n in range(100):
        out.write(json.dumps({"type": "place", "name": f"place{n}"}) + "\n")
PY
cat >"$folder/domain.pddl" <<'PDDL'
(define (domain tidy) (:requirements :strips :typing) (:types thing place)
  (:predicates (at ?thing - thing ?place - place) (tidied ?thing - thing)))
PDDL
cat >"$folder/problem.j2" <<'JINJA'
(define (problem tidy-up) (:domain tidy)
  (:objects
{%- for place in query("a.b", {"type": "place"}) %}
    {{ place.name }} - place
{%- endfor %}
{%- for thing in query("a.b", {"type": "object"}) %}
    {{ thing.name }} - thing
{%- endfor %}
  )
  (:init
{%- for thing in query("a.b", {"type": "object"}) %}
    (at {{ thing.name }} {{ thing.location }})
{%- if thing.tidied %}
    (tidied {{ thing.name }})
{%- endif %}
{%- endfor %}
  )
  (:goal (and (at thing0 place1))))
JINJA
cat >"$folder/script.py" <<'PY'
import sys
import jinja2, pymongo
folder, port = sys.argv[1], sys.argv[2]
client = pymongo.MongoClient("127.0.0.1", int(port))
def query(namespace, filter):
    database, collection = namespace.split(".")
    return client[database][collection].find(filter)
template = jinja2.Environment(keep_trailing_newline=True).from_string(open(folder + "/problem.j2").read())
with open(folder + "/python.pddl", "w") as out:
    out.writelines(template.generate(query=query))
PY

mkdir "$folder/db"
"${RMEM_TEST_MONGOD:-mongod}" --dbpath "$folder/db" --port "$port" --bind_ip 127.0.0.1 --nounixsocket >"$folder/log" 2>&1 &
server=$!
"$python" - "$folder" "$port" <<'PY'
import json, sys
import pymongo
client = pymongo.MongoClient("127.0.0.1", int(sys.argv[2]))
with open(sys.argv[1] + "/documents.jsonl") as lines:
    client.a.b.insert_many([json.loads(line) for line in lines])
PY
"$rmem" --memory "file:$folder/memory.rmem" insert a.b --file "$folder/documents.jsonl" >/dev/null 2>&1

TIMEFORMAT='%R %U %S'
seconds() { { time "$@" >/dev/null 2>&1; } 2>&1 | awk '{print $1, $2 + $3}'; }
rendered() { "$rmem" --memory "file:$folder/memory.rmem" gen-problem --template "$folder/problem.j2" "$@"; }
plain() { rendered -o "$folder/plain.pddl"; }
checked() { rendered --domain "$folder/domain.pddl" -o "$folder/checked.pddl"; }
script() { "$python" "$folder/script.py" "$folder" "$port"; }
best() { printf '%s\n' "${@:2}" | cut -d ' ' -f "$1" | sort -g | head -n 1; }

plain=() checked=() script=()
for _ in 1 2 3 4 5; do
  plain+=("$(seconds plain)") checked+=("$(seconds checked)") script+=("$(seconds script)")
done
printf '%-10s %12s %12s %8s %6s %6s\n' "$count" rmem 'with domain' Python ratio ratio
for column in 1 2; do
  name=$([ "$column" = 1 ] && echo clock || echo processor)
  echo "$(best "$column" "${plain[@]}") $(best "$column" "${checked[@]}") $(best "$column" "${script[@]}")" |
    awk -v name="$name" '{printf "%-10s %12.2f %12.2f %8.2f %6.1f %6.1f\n", name, $1, $2, $3, $3 / $1, $3 / $2}'
done
words() { tr -s ' \n' '\n\n' <"$folder/$1.pddl"; }
cmp <(words plain) <(words checked) && cmp <(words plain) <(words python) && echo "the problems are the same"
