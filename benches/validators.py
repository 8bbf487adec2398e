#!/usr/bin/env python3
"""Plans changed at random, judged by rmem and by the validators of unified-planning.

    PYTHON benches/validators.py RMEM COUNT FOLDER...

PYTHON has unified-planning 1.3; each FOLDER has `domain.pddl` and `problem.pddl`. A plan is found with
RMEM, changed COUNT times (steps left out, doubled, moved, shifted in time, made longer, with other
objects), and judged twice. Prints how many verdicts agree and how many of the plans are valid, and for the first
plans on which they differ, what rmem says. unified-planning takes an action for possible though a condition over all
of it is broken, where the action has conditional effects beside it; it knows no derived predicates.
"""

import os
import random
import re
import subprocess
import sys
import tempfile
from fractions import Fraction

import unified_planning as up
from unified_planning.engines import SequentialPlanValidator, TimeTriggeredPlanValidator
from unified_planning.io import PDDLReader
from unified_planning.shortcuts import ObjectExp

SHIFTS = [Fraction(n, 1000) for n in (1, -1, -2, 500, -500, 2000, -2000, 8000)]


def planned(rmem, domain, problem):
    """The steps of a plan as (start, words, duration); without times where it has none."""
    command = [rmem, "--memory", "mem:", "plan", "-d", domain, "-p", problem, "--no-store", "--timeout", "60s"]
    text = subprocess.run(command, capture_output=True, text=True).stdout
    steps = []
    for start, words, duration in re.findall(r"^(?:([\d.]+): )?\(([^)]*)\)(?: \[([\d.]+)\])?$", text, re.M):
        timed = (Fraction(start), Fraction(duration)) if start else (None, None)
        steps.append((timed[0], words.lower().split(), timed[1]))
    return steps


def changed(steps, objects, dice):
    """The steps with one or two changes."""
    steps = [list(step) for step in steps]
    timed = bool(steps) and steps[0][0] is not None
    for _ in range(dice.choice((1, 1, 2))):
        if not steps:
            break
        place, kind = dice.randrange(len(steps)), dice.randrange(7 if timed else 4)
        start, words, duration = steps[place]
        if kind == 0:
            del steps[place]
        elif kind == 1:
            again = [start + dice.choice((0, 1, 5, 20)) if timed else None, list(words), duration]
            steps.insert(dice.randrange(len(steps) + 1), again)
        elif kind == 2:
            steps.insert(dice.randrange(len(steps)), steps.pop(place))
        elif kind == 3 and len(words) > 1:
            words = list(words)
            words[dice.randrange(1, len(words))] = dice.choice(objects)
            steps[place][1] = words
        elif kind == 4:
            # Less than a rounding is no other duration, to rmem as to VAL.
            steps[place][2] = max(Fraction(1, 1000), duration + dice.choice(SHIFTS[3:]))
        elif kind > 4:
            steps[place][0] = max(Fraction(0), start + dice.choice(SHIFTS))
    return sorted(steps, key=lambda step: step[0]) if timed else steps


def spelled(steps):
    """The plan as IPC validators read it."""
    def line(start, words, duration):
        action = f"({' '.join(words)})"
        return action if start is None else f"{float(start):.6f}: {action} [{float(duration):.6f}]"
    return "".join(line(*step) + "\n" for step in steps)


def judged(task, steps):
    """The verdict of unified-planning."""
    actions = {action.name.lower(): action for action in task.actions}
    objects = {thing.name.lower(): thing for thing in task.all_objects}
    instances = []
    for start, words, duration in steps:
        action, things = actions[words[0]], [objects[word] for word in words[1:]]
        if not all(slot.type.is_compatible(thing.type) for slot, thing in zip(action.parameters, things)):
            return False
        instance = up.plans.ActionInstance(action, tuple(ObjectExp(thing) for thing in things))
        instances.append(instance if start is None else (start, instance, duration))
    timed = bool(steps) and steps[0][0] is not None
    validator = TimeTriggeredPlanValidator() if timed else SequentialPlanValidator()
    validator.skip_checks = True
    plan = up.plans.TimeTriggeredPlan(instances) if timed else up.plans.SequentialPlan(instances)
    return validator.validate(task, plan).status.name == "VALID"


def compare(rmem, count, folder):
    """Judges a plan and changed ones, and prints how often the verdicts agree."""
    name = os.path.basename(folder.rstrip("/"))
    domain, problem = (os.path.join(folder, part + ".pddl") for part in ("domain", "problem"))
    try:
        task = PDDLReader().parse_problem(domain, problem)
    except Exception as error:  # It has no common error for what it does not read.
        return print(f"{name}: unified-planning does not read it: {str(error)[:100]!r}")
    task.epsilon = Fraction(1, 1000)
    steps, objects, dice = planned(rmem, domain, problem), [thing.name.lower() for thing in task.all_objects], random.Random(5)
    if not steps:
        return print(f"{name}: rmem has no plan")
    agreed = valid = given_up = 0
    differing = []
    with tempfile.TemporaryDirectory() as place:
        for number in range(count):
            plan = changed(steps, objects, dice) if number else steps
            with open(os.path.join(place, "plan"), "w") as file:
                file.write(spelled(plan))
            ours = subprocess.run([rmem, "validate", domain, problem, file.name], capture_output=True, text=True)
            try:
                theirs = judged(task, plan)
            except up.exceptions.UPException:
                given_up += 1
                continue
            valid += theirs
            agreed += theirs == (ours.returncode == 0)
            if theirs != (ours.returncode == 0):
                differing.append(f"valid to unified-planning: {theirs}\n{ours.stdout}{spelled(plan)}")
    print(f"{name}: {len(steps)} steps, {agreed} of {count - given_up} verdicts agree, {valid} plans are valid", flush=True)
    for text in differing[:2]:
        print(text)


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    up.shortcuts.get_environment().credits_stream = None
    for path in sys.argv[3:]:
        compare(sys.argv[1], int(sys.argv[2]), path)
