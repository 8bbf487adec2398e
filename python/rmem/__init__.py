"""A robot memory for Python programs, over the program ``rmem``.

>>> from rmem import Memory
>>> memory = Memory("mem:")               # doctest: +SKIP
>>> memory = Memory("file:robot.rmem")    # doctest: +SKIP
>>> memory.insert("robmem.worldmodel", {"relation": "on-table", "object": "A"})  # doctest: +SKIP

Each call runs ``rmem`` once and reads its JSON. A program that needs many operations a second keeps one connection
to ``rmem serve`` with pymongo instead.
"""

from ._documents import ObjectId
from ._errors import (
    BadInput,
    Conflict,
    Interrupted,
    MemoryLimit,
    NoPlan,
    PlannerFailed,
    PlannerGaveUp,
    PlannerNotFound,
    RmemError,
    StoreFailed,
    TimeLimit,
    Unsolvable,
    Unsupported,
    UsageError,
)
from ._memory import Change, Check, Memory, Plan, Step
from ._program import find_program

__all__ = [
    "BadInput",
    "Change",
    "Check",
    "Conflict",
    "Interrupted",
    "Memory",
    "MemoryLimit",
    "NoPlan",
    "ObjectId",
    "Plan",
    "PlannerFailed",
    "PlannerGaveUp",
    "PlannerNotFound",
    "RmemError",
    "Step",
    "StoreFailed",
    "TimeLimit",
    "Unsolvable",
    "Unsupported",
    "UsageError",
    "find_program",
]


def __getattr__(name: str) -> str:
    # Asked for seldom, and known to the program only.
    if name == "__version__":
        return Memory().run("--version").split()[-1]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
