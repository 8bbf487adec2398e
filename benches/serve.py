#!/usr/bin/env python3
"""Clients of servers, side by side: how many operations a second, and how long each takes.

    serve.py [--connections N] [--seconds S] [--computable] URI...

Each kind of work is done on each server in turn, for S seconds (default: 3), by N processes with a
connection each (default: 1 and 64). With --computable, what a computable adds to the time of its
own pipeline: a query that needs it, and its pipeline as an aggregation, in turn, on the first server, a `rmem serve`.
Writes are journaled. Needs pymongo.
"""

import argparse
import multiprocessing
import random
import time

from pymongo import MongoClient
from pymongo.write_concern import WriteConcern

DOCUMENTS = 10_000


def collection(uri):
    client = MongoClient(uri, maxPoolSize=1)
    return client.get_database("bench", write_concern=WriteConcern(w=1, j=True)).things


def document(name):
    return {"name": name, "position": {"x": 1.5, "y": 2.5, "room": "kitchen"}, "tidied": False, "count": 0}


def prepare(uri):
    things = collection(uri)
    things.drop()
    things.insert_many([{"_id": n, **document(f"thing {n}")} for n in range(DOCUMENTS)])
    things.create_index("name")


WORK = {
    "insert": lambda things, n: things.insert_one(document(f"new {n}")),
    "find by _id": lambda things, n: things.find_one({"_id": n % DOCUMENTS}),
    "indexed find": lambda things, n: things.find_one({"name": f"thing {n % DOCUMENTS}"}),
    "update": lambda things, n: things.update_one({"_id": n % DOCUMENTS}, {"$inc": {"count": 1}}),
}


def worker(uri, kind, seconds, barrier, results, seed):
    things, choose = collection(uri), random.Random(seed)
    things.find_one({"_id": 0})
    barrier.wait()
    times, end = [], time.perf_counter() + seconds
    while (start := time.perf_counter()) < end:
        WORK[kind](things, choose.randrange(1 << 30))
        times.append(time.perf_counter() - start)
    results.put(times)


def measure(uri, kind, connections, seconds):
    barrier, results = multiprocessing.Barrier(connections), multiprocessing.Queue()
    workers = [
        multiprocessing.Process(target=worker, args=(uri, kind, seconds, barrier, results, seed))
        for seed in range(connections)
    ]
    [one.start() for one in workers]
    times = sorted(time for _ in workers for time in results.get())
    [one.join() for one in workers]
    at = lambda part: times[min(len(times) - 1, int(len(times) * part))] * 1e3
    return len(times) / seconds, at(0.5), at(0.99)


def computable(uri, seconds):
    database = collection(uri).database
    rooms, kept = database.rooms, database["rmem.computables"]
    rooms.drop()
    rooms.insert_many([{"_id": n, "left": n, "right": 2 * n} for n in range(100)])
    width = {"$project": {"width": {"$subtract": ["$right", "$left"]}}}
    total = [width, {"$group": {"_id": "total", "width": {"$sum": "$width"}}}]
    named = {"spec": {"width": {"$exists": True}}, "collection": "bench.rooms", "adds": ["width"], "pipeline": [width]}
    given = {"from": "bench.rooms", "pipeline": total}
    caches = {"once": {}, "stale": {"cache": "1ms"}, "kept": {"cache": "10s"}}
    records = [{"_id": "width", **named}]
    for kind, cache in caches.items():
        records.append({"_id": kind, "spec": {"_id": "total"}, "collection": f"bench.{kind}", **given, **cache})
    names = {"_id": {"$in": [record["_id"] for record in records]}}
    kept.delete_many(names)
    kept.insert_many(records)
    wide = {"width": {"$gt": 50}}
    asking = lambda kind: lambda: list(database[kind].find({"_id": "total"}))
    body = lambda: list(rooms.aggregate(total))
    ways = {
        "adds a key": (lambda: list(rooms.aggregate([width, {"$match": wide}])), lambda: list(rooms.find(wide)), 49),
        "gives a document": (body, asking("once"), 1),
        "with a cache that is over": (body, asking("stale"), 1),
        "with a cache that holds": (body, asking("kept"), 1),
    }
    for name, (*asks, count) in ways.items():
        times, end = [[], []], time.perf_counter() + seconds
        while time.perf_counter() < end:
            for ask, taken in zip(asks, times):
                start = time.perf_counter()
                found = ask()
                taken.append(time.perf_counter() - start)
                assert len(found) == count, f"{name}: {len(found)} documents"
        body, whole = (sorted(taken)[len(taken) // 2] * 1e3 for taken in times)
        print(f"{name:26}  its pipeline p50 {body:.3f} ms, the computable p50 {whole:.3f} ms, {whole - body:+.3f} ms")
    kept.delete_many(names)


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--connections", type=int, action="append")
    arguments.add_argument("--seconds", type=float, default=3)
    arguments.add_argument("--computable", action="store_true")
    arguments.add_argument("uri", nargs="+")
    given = arguments.parse_args()
    for uri in given.uri:
        prepare(uri)
    if given.computable:
        return computable(given.uri[0], given.seconds)
    for connections in given.connections or [1, 64]:
        for kind in WORK:
            for uri in given.uri:
                rate, median, tail = measure(uri, kind, connections, given.seconds)
                print(f"{connections:3} {kind:13} {uri:40} {rate:9.0f}/s  p50 {median:7.2f} ms  p99 {tail:7.2f} ms", flush=True)


if __name__ == "__main__":
    multiprocessing.set_start_method("fork")
    main()
