#!/usr/bin/env python3
"""Pipelines and queries over all of a collection, on two servers side by side.

    pipelines.py [--documents N] URI URI

The first server is a `rmem serve`, the second one a mongod. Each kind of work is done three times on each in turn; the best
time counts, and the last column is the second server's time divided by the first one's. Both get the same documents, in the
database `bench_pipelines`. No field has an index but `_id`. Needs pymongo.
"""

import argparse
import random
import time

from pymongo import MongoClient

BATCH = 5_000


def documents(count):
    chance = random.Random(1)
    for n in range(count):
        place = lambda: str(chance.randrange(1_000))
        pose = {"x": chance.random(), "y": n}
        yield {"_id": n, "name": str(n), "position": place(), "tidied": place(), "n": chance.random(), "tags": ["a", "b", str(n % 7)], "pose": pose}


def nearest():
    distance = {"$abs": {"$subtract": [{"$toInt": "$position"}, 500]}}
    return [{"$project": {"_id": 0, "name": 1, "distance": distance}}, {"$sort": {"distance": 1, "name": 1}}, {"$limit": 1}]


COUNT = {"$count": "count"}
PIPELINES = {
    "the nearest of all": nearest(),
    "$match, $count": [{"$match": {"n": {"$gt": 0.5}}}, COUNT],
    "$group, count": [{"$group": {"_id": "$position", "count": {"$sum": 1}}}, COUNT],
    "$group, average": [{"$group": {"_id": "$tidied", "average": {"$avg": "$n"}}}, COUNT],
    "$group, $push": [{"$group": {"_id": "$position", "names": {"$push": "$name"}}}, COUNT],
    "$bucket": [{"$bucket": {"groupBy": "$n", "boundaries": [0, 0.5, 1]}}],
    "$sort, $limit": [{"$sort": {"n": 1}}, {"$limit": 10}],
    "$sort": [{"$sort": {"n": 1}}, {"$skip": 10**9}],
    "$project, computed": [{"$project": {"sum": {"$add": ["$n", 1]}}}, {"$match": {"sum": 0}}],
    "$project, nested": [{"$project": {"pose.x": 1}}, {"$match": {"pose.x": 2}}],
    "$set, nested": [{"$set": {"pose.z": {"$add": ["$n", 1]}}}, {"$match": {"pose.z": 0}}],
    "$replaceWith": [{"$replaceWith": {"$mergeObjects": ["$pose", {"name": "$name"}]}}, {"$match": {"x": 2}}],
    "$unwind, $group": [{"$unwind": "$tags"}, {"$group": {"_id": "$tags", "count": {"$sum": 1}}}],
    "$setWindowFields": [
        {"$setWindowFields": {"partitionBy": "$position", "sortBy": {"n": 1}, "output": {"rank": {"$rank": {}}}}},
        {"$match": {"rank": 0}},
    ],
    "$lookup of 300 by _id": [
        {"$limit": 300},
        {"$lookup": {"from": "things", "localField": "pose.y", "foreignField": "_id", "as": "same"}},
        COUNT,
    ],
}
WORK = {
    **{name: lambda things, stages=stages: list(things.aggregate(stages)) for name, stages in PIPELINES.items()},
    "count_documents": lambda things: things.count_documents({"n": {"$gt": 0.5}}),
    "distinct": lambda things: things.distinct("position"),
    "find, equality": lambda things: list(things.find({"name": "77"})),
    "find, regular expression": lambda things: list(things.find({"name": {"$regex": "777$"}})),
    "find, range, sorted": lambda things: list(things.find({"n": {"$lt": 0.01}}).sort("n")),
    "find, projection": lambda things: list(things.find({}, {"name": 1, "_id": 0})),
    "find, all": lambda things: list(things.find()),
}


def seconds(work, things):
    start = time.perf_counter()
    work(things)
    return time.perf_counter() - start


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--documents", type=int, default=100_000)
    arguments.add_argument("uri", nargs=2)
    given = arguments.parse_args()
    servers = [MongoClient(uri).bench_pipelines.things for uri in given.uri]
    everything = list(documents(given.documents))
    for things in servers:
        things.drop()
        for begin in range(0, len(everything), BATCH):
            things.insert_many(everything[begin : begin + BATCH])
    for name, work in WORK.items():
        times = [min(taken) for taken in zip(*([seconds(work, things) for things in servers] for _ in range(3)))]
        first, second = (least * 1e3 for least in times)
        print(f"{name:26} {first:9.1f} ms {second:9.1f} ms {second / first:7.2f}", flush=True)
    for things in servers:
        things.drop()


if __name__ == "__main__":
    main()
