#!/usr/bin/env python3
"""Many clients of one server at once, for minutes: whether anything that was acknowledged is lost.

    load.py [--clients N] [--minutes M] [--pid PID] URI

N processes (default: 64) insert, update, find, read cursors, delete and move amounts between accounts in transactions,
for M minutes (default: 10), beside a change stream that receives all inserts. At the end it is verified that every
acknowledged insert and update is there and no deleted document, that the amounts add up, and that the stream
has received every insert once. Prints all kinds of errors, the median and the 99th percentile of each kind of work, and
the server's resident memory over time (of the process PID; default: what serverStatus says, where that is on this machine).
Exits with 1 where something is wrong. Needs pymongo and a server with transactions: `rmem serve` or a replica set.
"""

import argparse
import collections
import multiprocessing
import queue
import random
import sys
import threading
import time

from pymongo import MongoClient
from pymongo.errors import PyMongoError

ACCOUNTS, AMOUNT = 200, 1000
KNOWN = 1000
DATABASE = "load"


def client(uri):
    return MongoClient(uri, maxPoolSize=2, w="majority")


def prepare(uri):
    connection = client(uri)
    connection.drop_database(DATABASE)
    database = connection[DATABASE]
    database.known.insert_many([{"_id": n, "name": f"thing {n}", "position": {"x": n, "y": 0.5}} for n in range(KNOWN)])
    database.known.create_index("name")
    database.accounts.insert_many([{"_id": n, "amount": AMOUNT} for n in range(ACCOUNTS)])
    database.create_collection("things")
    database.create_collection("counters")


class Worker:
    """One client: what it did, as far as it was acknowledged."""

    def __init__(self, uri, seed):
        self.connection, self.seed, self.choose = client(uri), seed, random.Random(seed)
        self.database = self.connection[DATABASE]
        self.inserted, self.deleted, self.updates, self.moves = set(), set(), 0, 0
        self.times, self.errors, self.count = collections.defaultdict(list), collections.Counter(), 0

    def insert(self):
        self.count += 1
        name = f"{self.seed}-{self.count}"
        self.database.things.insert_one({"_id": name, "by": self.seed, "position": {"x": 1.5, "room": "kitchen"}})
        self.inserted.add(name)

    def update(self):
        self.database.counters.update_one({"_id": self.seed}, {"$inc": {"n": 1}}, upsert=True)
        self.updates += 1

    def find(self):
        n = self.choose.randrange(KNOWN)
        found = self.database.known.find_one({"name": f"thing {n}"})
        if found is None or found["_id"] != n:
            self.errors[f"find: thing {n} is {found}"] += 1

    def cursor(self):
        found = sum(1 for _ in self.database.known.find({}, {"name": 1}, batch_size=150).limit(600))
        if found != 600:
            self.errors[f"cursor: {found} of 600 documents"] += 1

    def delete(self):
        name = f"{self.seed}-{self.choose.randint(1, max(1, self.count))}"
        if name in self.inserted - self.deleted:
            self.deleted.add(name)
            if self.database.things.delete_one({"_id": name}).deleted_count != 1:
                self.errors["delete: an acknowledged document is not there"] += 1

    def transaction(self):
        giver, taker = self.choose.sample(range(ACCOUNTS), 2)

        def move(session):
            accounts = self.database.accounts
            accounts.find_one({"_id": giver}, session=session)
            accounts.update_one({"_id": giver}, {"$inc": {"amount": -1}}, session=session)
            accounts.update_one({"_id": taker}, {"$inc": {"amount": 1, "taken": 1}}, session=session)

        with self.connection.start_session() as session:
            session.with_transaction(move)
        self.moves += 1

    def run(self, until):
        work = [self.insert, self.update, self.find] * 6 + [self.cursor, self.delete, self.transaction]
        while time.time() < until:
            task = self.choose.choice(work)
            start = time.perf_counter()
            try:
                task()
            except PyMongoError as error:
                self.errors[f"{task.__name__}: {type(error).__name__}: {str(error)[:160]}"] += 1
            self.times[task.__name__].append(time.perf_counter() - start)


def work(uri, seed, barrier, seconds, results):
    worker = Worker(uri, seed)
    worker.connection.admin.command("ping")
    barrier.wait()
    worker.run(time.time() + seconds)
    results.put((seed, worker.inserted, worker.deleted, worker.updates, worker.moves, dict(worker.times), worker.errors))


def watch(uri, barrier, ended, results):
    """Collects what a change stream receives, until nothing comes after the end."""
    received, errors = collections.Counter(), collections.Counter()
    try:
        with client(uri)[DATABASE].things.watch([{"$match": {"operationType": "insert"}}]) as stream:
            barrier.wait()
            while True:
                over, event = ended.is_set(), stream.try_next()
                if event is not None:
                    received[event["documentKey"]["_id"]] += 1
                elif over:
                    break
    except PyMongoError as error:
        errors[f"stream: {type(error).__name__}: {str(error)[:160]}"] += 1
    results.put((received, errors))


def resident(pid):
    """Mebibytes of a process."""
    try:
        with open(f"/proc/{pid}/status") as status:
            return next((int(line.split()[1]) // 1024 for line in status if line.startswith("VmRSS")), None)
    except OSError:
        return None


def measure(pid, ended, found):
    while pid and not ended.wait(5):
        found.append(resident(pid))


def verify(uri, reports, received):
    """Returns what is wrong with what is stored."""
    database, wrong = client(uri)[DATABASE], []
    stored = {found["_id"] for found in database.things.find({}, {"_id": 1})}
    inserted = set().union(*(report[1] for report in reports))
    deleted = set().union(*(report[2] for report in reports))
    if lost := inserted - deleted - stored:
        wrong.append(f"{len(lost)} acknowledged inserts are lost, like {sorted(lost)[0]}")
    if back := stored & deleted:
        wrong.append(f"{len(back)} deleted documents are there, like {sorted(back)[0]}")
    counters = {found["_id"]: found["n"] for found in database.counters.find()}
    for seed, _, _, updates, *_ in reports:
        if counters.get(seed, 0) != updates:
            wrong.append(f"counter {seed} is {counters.get(seed, 0)}, and {updates} were acknowledged")
    accounts = list(database.accounts.find())
    total, taken = (sum(account.get(key, 0) for account in accounts) for key in ("amount", "taken"))
    moves = sum(report[4] for report in reports)
    if total != ACCOUNTS * AMOUNT or taken != moves:
        wrong.append(f"the accounts hold {total} of {ACCOUNTS * AMOUNT} after {taken} moves; {moves} were acknowledged")
    if missed := inserted - set(received):
        wrong.append(f"the change stream missed {len(missed)} inserts, like {sorted(missed)[0]}")
    if twice := [name for name, count in received.items() if count > 1]:
        wrong.append(f"the change stream received {len(twice)} inserts again, like {twice[0]}")
    return wrong


def pid_of(uri):
    # A server on another machine has no process here.
    status = client(uri).admin.command("serverStatus")
    return int(status["pid"]) if "pid" in status and resident(int(status["pid"])) else None


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--clients", type=int, default=64)
    arguments.add_argument("--minutes", type=float, default=10)
    arguments.add_argument("--pid", type=int)
    arguments.add_argument("uri")
    given = arguments.parse_args()
    prepare(given.uri)
    pid = given.pid or pid_of(given.uri)
    barrier = multiprocessing.Barrier(given.clients + 1)
    results, streamed, ended = multiprocessing.Queue(), multiprocessing.Queue(), multiprocessing.Event()
    watcher = multiprocessing.Process(target=watch, args=(given.uri, barrier, ended, streamed))
    seconds = given.minutes * 60
    workers = [
        multiprocessing.Process(target=work, args=(given.uri, seed, barrier, seconds, results))
        for seed in range(given.clients)
    ]
    for process in [watcher, *workers]:
        process.start()
    memory = [resident(pid)]
    meter = threading.Thread(target=measure, args=(pid, ended, memory))
    meter.start()
    reports, limit = [], time.time() + seconds + 300
    try:
        while len(reports) < given.clients:
            reports.append(results.get(timeout=max(1, limit - time.time())))
    except queue.Empty:
        print(f"{given.clients - len(reports)} clients have not ended; is a command unanswered?")
    ended.set()
    received, errors = streamed.get(timeout=300)
    meter.join()
    for process in [watcher, *workers]:
        process.join(timeout=10)
        process.terminate()
    for report in reports:
        errors += report[6]
    print(f"{given.clients} clients, {given.minutes:g} minutes")
    for kind in ["insert", "update", "find", "cursor", "delete", "transaction"]:
        times = sorted(time for report in reports for time in report[5].get(kind, []))
        if times:
            at = lambda part: times[min(len(times) - 1, int(len(times) * part))] * 1e3
            print(f"{kind:12} {len(times):8}  p50 {at(0.5):8.2f} ms  p99 {at(0.99):8.2f} ms  longest {times[-1] * 1e3:8.0f} ms")
    if pid:
        shown = [size for size in memory if size is not None]
        parts = [shown[(len(shown) - 1) * part // 6] for part in range(7)]
        print(f"resident memory of {pid}, in MiB: {' '.join(map(str, parts))}; at most {max(shown)}")
    for error, count in errors.most_common():
        print(f"error, {count} times: {error}")
    wrong = verify(given.uri, reports, received)
    print("\n".join(wrong) or f"nothing is lost; the change stream received {len(received)} inserts")
    sys.exit(1 if wrong or errors or len(reports) < given.clients else 0)


if __name__ == "__main__":
    multiprocessing.set_start_method("fork")
    main()
