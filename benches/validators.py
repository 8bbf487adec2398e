#!/usr/bin/env python3
"""Plans changed at random, validated by rmem and by unified-planning.

    PYTHON benches/validators.py RMEM COUNT FOLDER...

PYTHON has unified-planning 1.3; each FOLDER has `domain.pddl` and `problem.pddl`. A plan is found with
RMEM, changed COUNT times (steps left out, doubled, moved, shifted in time, made longer, with other
objects), and validated twice. Prints how many verdicts agree and how many of the plans are valid, and for the first
plans on which they differ, what rmem says.

The other validator is unified-planning. It takes an action for possible though a condition over all of it is broken, where
the action has conditional effects beside it, or though another action undoes at the same moment what it needs; it takes
neither two actions that make the same fact true at one moment nor a duration that was rounded. It knows no derived
predicates: on tasks with these the validator is
`fast-downward`, which is asked for a plan of a task that has none but the one in question.
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
from unified_planning.shortcuts import BoolType, DurativeAction, ObjectExp, StartTiming

SHIFTS = [Fraction(n, 1000) for n in (1, -1, -2, 500, -500, 2000, -2000, 8000)]


def planned(rmem, domain, problem, planner):
    """The steps of a plan as (start, words, duration); without times where it has none."""
    command = [rmem, "--memory", "mem:", "plan", "-d", domain, "-p", problem, "--no-store", "--timeout", "60s"]
    command += ["--planner", planner]
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


class UnifiedPlanning:
    """The validators of unified-planning."""

    planner = "builtin"

    def __init__(self, domain, problem):
        self.task = PDDLReader().parse_problem(domain, problem)
        self.task.epsilon = Fraction(1, 1000)
        self.actions = {action.name.lower(): action for action in self.task.actions}
        for action in filter(lambda action: isinstance(action, DurativeAction), self.actions.values()):
            # Conditions over all of an action are looked at from its start on only where it changes something there.
            slots = {slot.name: slot.type for slot in action.parameters}
            mark = self.task.add_fluent(f"started-{action.name}", BoolType(), default_initial_value=False, **slots)
            action.add_effect(StartTiming(), mark(*action.parameters), True)
        self.objects = {thing.name.lower(): thing for thing in self.task.all_objects}

    def validate(self, steps):
        """Whether a plan is valid; nothing where it cannot say."""
        instances = []
        for start, words, duration in steps:
            action, things = self.actions[words[0]], [self.objects[word] for word in words[1:]]
            if not all(slot.type.is_compatible(thing.type) for slot, thing in zip(action.parameters, things)):
                return False
            instance = up.plans.ActionInstance(action, tuple(ObjectExp(thing) for thing in things))
            instances.append(instance if start is None else (start, instance, duration))
        timed = bool(steps) and steps[0][0] is not None
        validator = TimeTriggeredPlanValidator() if timed else SequentialPlanValidator()
        validator.skip_checks = True
        plan = up.plans.TimeTriggeredPlan(instances) if timed else up.plans.SequentialPlan(instances)
        try:
            return validator.validate(self.task, plan).status.name == "VALID"
        except up.exceptions.UPException:
            return None


class FastDownward:
    """A planner whose task has each step of the plan as an action of its own, possible once and in its turn."""

    planner = "fast-downward"

    def __init__(self, domain, problem):
        self.domain, self.problem = parsed(domain), parsed(problem)
        trees = [part for tree in (self.domain, self.problem) for part in tree]
        # What has no type comes last: a type is for all before it.
        self.lists = sorted((part[1:] for part in trees if part[0] in (":objects", ":constants")), key=lambda words: "-" not in words)
        typed = [("", *words)[at:at + 2] for words in self.lists for at in range(len(words))]
        self.objects = [word for before, word in typed if isinstance(word, str) and "-" not in (before, word)]

    def validate(self, steps):
        """Whether a plan is valid; nothing where the planner does not say."""
        with tempfile.TemporaryDirectory() as place:
            for name, tree in zip(("domain.pddl", "problem.pddl"), self.staged(steps)):
                with open(os.path.join(place, name), "w") as file:
                    file.write(written(tree))
            command = ["fast-downward", "domain.pddl", "problem.pddl", "--search", "astar(blind())"]
            code = subprocess.run(command, cwd=place, capture_output=True).returncode
            return {0: True, 10: False, 11: False, 12: False}.get(code)

    def staged(self, steps):
        """The task."""
        turns = [[f"turn-{number}"] for number in range(len(steps) + 1)]
        schemas = {part[1]: part for part in self.domain if part[0] == ":action"}
        known = [":constants", *(word for words in self.lists for word in words)]
        domain = [part for part in self.domain if part[0] not in (":action", ":constants")]
        domain.insert(next(at for at, part in enumerate(domain) if part[0] == ":predicates"), known)
        domain = [part + turns if part[0] == ":predicates" else part for part in domain]
        for number, (_, words, _) in enumerate(steps):
            fields = dict(zip(schemas[words[0]][2::2], schemas[words[0]][3::2]))
            slots = [name for name in fields.get(":parameters", []) if name.startswith("?")]
            fixed = [["=", slot, thing] for slot, thing in zip(slots, words[1:])]
            before, after = (list(filter(None, [fields.get(name)])) for name in (":precondition", ":effect"))
            fields[":precondition"] = ["and", turns[number], *fixed, *before]
            fields[":effect"] = ["and", ["not", turns[number]], turns[number + 1], *after]
            domain.append([":action", f"step-{number}", *(part for field in fields.items() for part in field)])
        problem = [part for part in self.problem if part[0] not in (":metric", ":objects")]
        problem = [part + turns[:1] if part[0] == ":init" else part for part in problem]
        problem = [[":goal", ["and", turns[-1], part[1]]] if part[0] == ":goal" else part for part in problem]
        return domain, problem


def parsed(path):
    """The expression of a PDDL file: lists of words and lists."""
    with open(path) as file:
        words = re.findall(r"[()]|[^\s()]+", re.sub(r";.*", "", file.read()).lower())
    stack = [[]]
    for word in words:
        if word == "(":
            stack.append([])
        elif word == ")":
            stack[-2].append(stack.pop())
        else:
            stack[-1].append(word)
    return stack[0][0]


def written(tree):
    """An expression as PDDL."""
    return tree if isinstance(tree, str) else f"({' '.join(map(written, tree))})"


def compare(rmem, count, folder):
    """Validates a plan and changed ones, and prints how often the verdicts agree."""
    name = os.path.basename(folder.rstrip("/"))
    domain, problem = (os.path.join(folder, part + ".pddl") for part in ("domain", "problem"))
    with open(domain) as file:
        kind = FastDownward if "(:derived" in file.read().lower() else UnifiedPlanning
    try:
        other = kind(domain, problem)
    except Exception as error:  # unified-planning has no common error for what it does not read.
        return print(f"{name}: {kind.__name__} does not read it: {str(error)[:100]!r}")
    steps, objects, dice = planned(rmem, domain, problem, kind.planner), list(other.objects), random.Random(5)
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
            theirs = other.validate(plan)
            if theirs is None:
                given_up += 1
                continue
            valid += theirs
            agreed += theirs == (ours.returncode == 0)
            if theirs != (ours.returncode == 0):
                differing.append(f"valid to {kind.__name__}: {theirs}\n{ours.stdout}{ours.stderr}{spelled(plan)}")
    print(f"{name}: {len(steps)} steps, {kind.__name__}: {agreed} of {count - given_up} verdicts agree, {valid} plans are valid", flush=True)
    for text in differing[:2]:
        print(text)


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    up.shortcuts.get_environment().credits_stream = None
    for path in sys.argv[3:]:
        compare(sys.argv[1], int(sys.argv[2]), path)
