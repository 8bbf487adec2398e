#!/usr/bin/env python3
"""An executive with pymongo alone: takes the plans that `rmem plan --watch` stores, and executes them.

    executive.py URI [SECONDS]

URI is that of `rmem serve` or of a replica set. Ends with 0 when a plan was executed to its end, with 1
when none was for so many seconds (default: 60).
"""

import datetime
import sys
import time

from pymongo import DESCENDING, MongoClient

import blocks


def steps(plan):
    """The numbers of a plan's steps that are not done."""
    numbers = sorted(int(key) for key in plan if key.isdigit())
    return [number for number in numbers if plan[str(number)].get("_status") != "done"]


def note(plans, plan, number, status, moment):
    """Records the state of a step in the plan."""
    now = datetime.datetime.now(datetime.timezone.utc)
    fields = {f"{number}._status": status, f"{number}.{moment}": now}
    plans.update_one({"_id": plan["_id"]}, {"$set": fields})


def execute(client, plan):
    """Executes a plan, as long as no newer one is stored; says whether it came to its end."""
    plans, world = client.robmem.plans, client.robmem.worldmodel
    for number in steps(plan):
        if newest(plans)["_id"] != plan["_id"]:
            return False
        step = plan[str(number)]
        note(plans, plan, number, "running", "_started")
        # The world is never seen in the middle of an action.
        try:
            with client.start_session() as session, session.start_transaction():
                blocks.act(world, step["action"], *arguments(step), session=session)
        except RuntimeError as error:
            # The plan was made while the world changed; a newer one comes.
            note(plans, plan, number, "failed", "_ended")
            print("failed:", error, flush=True)
            return False
        note(plans, plan, number, "done", "_ended")
        print("did", step["action"], *arguments(step), flush=True)
    return True


def arguments(step):
    return [value for key, value in step.items() if key != "action" and not key.startswith("_")]


def newest(plans):
    return plans.find_one({"plan": "success"}, sort=[("_id", DESCENDING)])


def main():
    client = MongoClient(sys.argv[1])
    until = time.monotonic() + float(sys.argv[2] if len(sys.argv) > 2 else 60)
    plans = client.robmem.plans
    with plans.watch([{"$match": {"operationType": "insert"}}], max_await_time_ms=200) as changes:
        while time.monotonic() < until:
            plan = newest(plans)
            if plan and steps(plan):
                print("plan of", len(steps(plan)), "steps", flush=True)
                if execute(client, plan):
                    return 0
            changes.try_next()
    return 1


sys.exit(main())
