"""One exception for each exit code of ``rmem`` (``rmem help exit-codes``)."""

from __future__ import annotations

import re


class RmemError(Exception):
    """rmem ended with an error.

    Attributes:
        code: the exit code of the program.
        message: the error that it printed, without what it said before.
        stderr: all that it printed on stderr.
    """

    code: int = 1

    def __init__(self, message: str, code: int | None = None, stderr: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.stderr = message if stderr is None else stderr
        if code is not None:
            self.code = code


class UsageError(RmemError):
    """The call is wrong: an unknown option, a namespace that is none (exit code 2)."""

    code = 2


class BadInput(RmemError):
    """A document, query, template, PDDL file or world file is wrong (exit code 3)."""

    code = 3


class StoreFailed(RmemError):
    """The store cannot be reached or failed (exit code 4)."""

    code = 4


class Conflict(RmemError):
    """A unique key or a lock is taken (exit code 5)."""

    code = 5


class NoPlan(RmemError):
    """A planner returned no plan; its subclasses say why."""


class Unsolvable(NoPlan):
    """It is proven that no plan exists (exit code 11)."""

    code = 11


class PlannerGaveUp(NoPlan):
    """The planner gave up without a proof (exit code 12)."""

    code = 12


class MemoryLimit(NoPlan):
    """The planner reached its limit of memory (exit code 22)."""

    code = 22


class TimeLimit(NoPlan):
    """The planner reached its limit of time (exit code 23)."""

    code = 23


class PlannerFailed(NoPlan):
    """The planner crashed, or returned an invalid plan or none (exit code 32)."""

    code = 32


class Unsupported(NoPlan):
    """The planner cannot handle a feature that the task uses (exit code 34)."""

    code = 34


class PlannerNotFound(NoPlan):
    """The planner's program is not installed (exit code 127)."""

    code = 127


class Interrupted(RmemError):
    """rmem was interrupted (exit code 130)."""

    code = 130


_BY_CODE: dict[int, type[RmemError]] = {
    kind.code: kind
    for kind in (
        UsageError,
        BadInput,
        StoreFailed,
        Conflict,
        Unsolvable,
        PlannerGaveUp,
        MemoryLimit,
        TimeLimit,
        PlannerFailed,
        Unsupported,
        PlannerNotFound,
        Interrupted,
    )
}


# Options that messages name, and the arguments of the methods that stand for them.
_ARGUMENTS: dict[str, str] = {
    "--all": "many=True",
    "--many": "many=True",
    "--upsert": "upsert=True",
    "--replace": "replace=True",
    "--out-of-order": "out_of_order=True",
    "--strict": "strict=True",
    "--anytime": "anytime=True",
    "--no-store": "store=False",
    "--domain": "domain=…",
    "--goal": "goal=…",
    "--template": "template=…",
    "--problem": "problem=…",
    "--into": "into=…",
    "--planner": "planner=…",
    "--timeout": "timeout=…",
    "--sort": "sort=…",
    "--fields": "fields=…",
    "--at": "at=…",
}

# A value in double quotes stays as it is, and so does a path.
_OPTION = re.compile(r'"(?:[^"\\\n]|\\.)*"|' r"(?<![\w/-])(--[a-z][a-z-]*)(?: [A-Z]+\b| (?P<value>'[^'\n]*'))?(?![\w=-])")


def _in_python(message: str) -> str:
    """Returns a message with arguments instead of options; what it says of commands stays."""
    lines = message.splitlines()
    # An excerpt of a text has a number in front.
    is_ours = [not re.search(r"\brmem |^\s*\d* \|", line) for line in lines]
    replaced = [_OPTION.sub(_argument, line) for line in lines]
    return "\n".join(new if ours else line for line, new, ours in zip(lines, replaced, is_ours))


def _argument(found: re.Match[str]) -> str:
    if found[1] is None:
        return found[0]
    return _ARGUMENTS.get(found[1], found[0]).replace("…", found["value"] or "…")


def error_of(code: int, message: str, *, in_python: bool = True) -> RmemError:
    """Returns the exception for an exit code; ``message`` is all of stderr, which names options of the command line."""
    kind = _BY_CODE.get(code, RmemError)
    lines = message.splitlines(keepends=True)
    first = next((index for index, line in enumerate(lines) if line.startswith("error: ")), 0)
    error = "".join(lines[first:]).strip()
    error = _in_python(error) if in_python else error
    return kind(error or f"rmem ended with exit code {code}", code, message)
