#!/usr/bin/env python3
"""An executive: plans, acts, notices that the world has changed, plans again.

    executive.py DOMAIN TEMPLATE GOAL ACT [options of rmem plan …]

ACT is a program that is called with each action and its arguments (`ACT unstack D A`), changes the memory as the
world changes, and fails where the action failed. The memory is that of RMEM_MEMORY. Exits with 0 when the goal is
reached, else with the exit code of `rmem plan`.
"""

import json
import subprocess
import sys

ATTEMPTS = 10


def rmem(*arguments):
    """Runs rmem; returns its exit code and what it printed."""
    run = subprocess.run(["rmem", "--quiet", *arguments], stdout=subprocess.PIPE, text=True)
    return run.returncode, run.stdout


def plan(domain, template, goal, options):
    """The steps of a new plan, each an action and its arguments; ends the program where there is none."""
    task = ["--domain", domain, "--template", template, "--goal", goal]
    code, printed = rmem("plan", *task, *options, "--format", "json")
    if code != 0:
        sys.exit(code)
    report = json.loads(printed)
    return [[step["action"], *map(str, step["list"])] for step in report["steps"]]


def holds():
    """Whether the rest of the plan still reaches the goal."""
    code, reason = rmem("plan", "check", "last")
    if code != 0:
        print(reason, end="", file=sys.stderr)
    return code == 0


def note(number, status):
    rmem("plan", "step", "last", str(number), status)


def execute(steps, act):
    """Executes a plan; returns whether all of it was done."""
    for number, step in enumerate(steps, start=1):
        if not holds():
            return False
        note(number, "--started")
        done = subprocess.run([act, *step]).returncode == 0
        note(number, "--done" if done else "--failed")
        print("did" if done else "failed", *step, flush=True)
        if not done:
            return False
    return holds()


def main(domain, template, goal, act, *options):
    for attempt in range(1, ATTEMPTS + 1):
        steps = plan(domain, template, goal, options)
        print("plan", attempt, flush=True)
        if execute(steps, act):
            return 0
    return 12


if __name__ == "__main__":
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
