"""The memory, its plans, and its changes."""

from __future__ import annotations

import os
import subprocess
import threading
from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import IO, Any, Iterable, Iterator, Mapping, Sequence, Union

from ._documents import Document, ObjectId, decode, encode
from ._errors import RmemError, error_of
from ._program import find_program

Path = Union[str, "os.PathLike[str]"]
Query = Union[str, Document]


@dataclass(frozen=True)
class Step:
    """A step of a plan.

    Attributes:
        index: its number, from 1.
        action: the action's name, as in the domain.
        args: the arguments by the names of the action's parameters.
        list: the arguments in their order.
        start, duration: seconds, of temporal plans.
        status: open, running, done or failed.
    """

    index: int
    action: str
    args: Mapping[str, Any]
    list: Sequence[Any]
    start: float | None = None
    duration: float | None = None
    status: str = "open"


@dataclass(frozen=True)
class Plan:
    """A plan that was found and stored.

    Attributes:
        id: its id in ``namespace``; None where it was not stored.
        outcome: "success".
        steps: its steps, in order; none where the goal holds already.
        report: the whole report of ``rmem plan --format json``.
    """

    id: str | None
    namespace: str | None
    outcome: str
    planner: str | None
    cost: float | None
    makespan: float | None
    steps: Sequence[Step]
    report: Mapping[str, Any] = field(repr=False)


@dataclass(frozen=True)
class Check:
    """Whether the rest of a stored plan still reaches its goal.

    Attributes:
        holds: whether it does.
        report: what ``rmem plan check --format json`` printed.
    """

    holds: bool
    report: Mapping[str, Any] = field(repr=False)

    def __bool__(self) -> bool:
        return self.holds


@dataclass(frozen=True)
class Change:
    """A change of a document.

    Attributes:
        operation: insert, update, replace or delete.
        ns: the namespace.
        id: the document's ``_id``.
        before, after: the document, where the store has it.
    """

    operation: str
    ns: str
    id: Any
    before: Document | None
    after: Document | None


class Memory:
    """A robot memory.

    Args:
        uri: ``file:PATH``, ``mongodb://…``; None is what the settings say.
        config: a settings file, as ``--config``.
        load: world files to put into the memory before each call (``--load``); with ``uri="mem:"`` the memory is empty
            but for these.
        program: the program ``rmem``; found by itself where it is None.

    Every method raises a subclass of :class:`RmemError` by the exit code of the program. Queries, updates and pipelines
    are dictionaries, or texts as in MongoDB's shell.
    """

    def __init__(
        self,
        uri: str | None = None,
        *,
        config: Path | None = None,
        load: Iterable[Path] = (),
        program: str | None = None,
    ) -> None:
        self._program = program or find_program()
        self._options: list[str] = []
        if uri is not None:
            self._options += ["--memory", uri]
        if config is not None:
            self._options += ["--config", os.fspath(config)]
        for world in load:
            self._options += ["--load", os.fspath(world)]

    # Operations

    def insert(self, ns: str, *documents: Document) -> list[Any]:
        """Stores documents; returns their ids."""
        if not documents:
            return []
        lines = "".join(f"{_object(document)}\n" for document in documents)
        return _lines(self._run(["insert", ns, "-"], lines))

    def query(
        self,
        ns: str,
        query: Query = "{}",
        *,
        sort: Query | None = None,
        limit: int | None = None,
        skip: int | None = None,
        fields: Query | None = None,
        at: str | datetime | None = None,
    ) -> list[dict[str, Any]]:
        """Returns the documents that match; with ``at``, those that did at a time (where a history is kept)."""
        words = ["query", ns, _text(query), "--format", "jsonl"]
        words += _option("--sort", sort) + _option("--limit", limit)
        words += _option("--skip", skip) + _option("--fields", fields) + _at(at)
        return _lines(self._run(words))

    def find_one(self, ns: str, query: Query = "{}", *, sort: Query | None = None) -> dict[str, Any] | None:
        """Returns the first document that matches, or None."""
        return next(iter(self.query(ns, query, sort=sort, limit=1)), None)

    def count(self, ns: str, query: Query = "{}", *, at: str | datetime | None = None) -> int:
        """Returns how many documents match, or did ``at`` a time."""
        return int(self._run(["count", ns, _text(query), "--format", "jsonl", *_at(at)]))

    def distinct(self, ns: str, key: str, query: Query = "{}") -> list[Any]:
        """Returns the distinct values of a key."""
        return _lines(self._run(["distinct", ns, key, _text(query), "--format", "jsonl"]))

    def aggregate(self, ns: str, pipeline: str | Sequence[Document]) -> list[dict[str, Any]]:
        """Returns the results of an aggregation pipeline."""
        return _lines(self._run(["aggregate", ns, _text(pipeline), "--format", "jsonl"]))

    def update(
        self,
        ns: str,
        query: Query,
        update: str | Document | Sequence[Document],
        *,
        many: bool = False,
        upsert: bool = False,
        replace: bool = False,
    ) -> dict[str, Any]:
        """Changes the first document that matches (all with ``many``); returns ``{"matched": …, "modified": …}``.

        With ``replace``, ``update`` is a whole document, which takes its place.
        """
        words = ["update", ns, _text(query), _text(update), "--format", "jsonl"]
        words += ["--many"] if many else []
        words += ["--upsert"] if upsert else []
        words += ["--replace"] if replace else []
        report: dict[str, Any] = decode(self._run(words))
        return report

    def delete(self, ns: str, query: Query, *, many: bool = False) -> int:
        """Removes the first document that matches (all with ``many``); returns how many were removed.

        An empty query is taken with ``many`` only: it removes all documents.
        """
        text = _text(query)
        everything = "--all" if "".join(text.split()) == "{}" else "--many"
        words = ["delete", ns, text, "--format", "jsonl"] + ([everything] if many else [])
        return int(self._run(words))

    # Problems and plans

    def gen_problem(
        self,
        template: Path,
        *,
        domain: Path | None = None,
        goal: str | None = None,
        parameters: Mapping[str, Any] | None = None,
        strict: bool = False,
        at: str | datetime | None = None,
    ) -> str:
        """Returns the PDDL problem that a template makes of the memory, as it is or was ``at`` a time."""
        words = ["gen-problem", "--template", os.fspath(template), *_task(domain, goal, parameters)]
        return self._run(words + (["--strict"] if strict else []) + _at(at))

    def plan(
        self,
        domain: Path,
        *,
        template: Path | None = None,
        problem: Path | None = None,
        goal: str | None = None,
        parameters: Mapping[str, Any] | None = None,
        planner: str | Sequence[str] | None = None,
        timeout: str | None = None,
        anytime: bool = False,
        into: str | None = None,
        store: bool = True,
    ) -> Plan:
        """Finds a plan, stores it and returns it; with ``anytime``, the best that is found within ``timeout``.

        Raises:
            NoPlan: there is none; the subclass says why.
        """
        words = ["plan", "--format", "json", *_task(domain, goal, parameters)]
        words += _option("--template", template) + _option("--problem", problem)
        for name in [planner] if isinstance(planner, str) else planner or []:
            words += ["--planner", name]
        words += _option("--timeout", timeout) + _option("--into", into) + (["--anytime"] if anytime else [])
        return _plan(decode(self._run(words + ([] if store else ["--no-store"]))))

    def step(
        self,
        plan: str | Plan,
        step: int | str | Step,
        status: str,
        *,
        out_of_order: bool = False,
        namespace: str | None = None,
    ) -> None:
        """Notes how the execution of a step went.

        Args:
            plan: the plan, its id, or ``last``.
            step: the step, its number from 1, or ``next``.
            status: ``started``, ``done``, ``failed`` or ``open``.
            out_of_order: whether a step that has to come before may be open.
        """
        if status not in ("started", "done", "failed", "open"):
            raise ValueError(f"a step is started, done, failed or open, not {status!r}")
        number = step.index if isinstance(step, Step) else step
        words = ["plan", "step", _id(plan), str(number), f"--{status}", *(["--out-of-order"] if out_of_order else [])]
        self._run(words + _option("--in", _namespace(plan, namespace)))

    def check(self, plan: str | Plan = "last", *, problem: Path | None = None, namespace: str | None = None) -> Check:
        """Returns whether the rest of a stored plan still reaches its goal from the memory as it is now."""
        words = ["plan", "check", _id(plan), "--format", "json", *_option("--problem", problem)]
        words += _option("--in", _namespace(plan, namespace))
        code, stdout, stderr = self._call(words, None)
        if code not in (0, 1) or not stdout.strip():
            raise error_of(code, stderr)
        return Check(holds=code == 0, report=decode(stdout))

    # Changes

    def watch(
        self, ns: str, query: Query = "{}", *, resume: str | None = None, count: int | None = None, timeout: str | None = None
    ) -> Iterator[Change]:
        """Iterates over the changes of the documents that match, as they are made.

        The watch is in place when this returns. With ``resume``, the position is kept in the memory under that name, so
        that a program that is started again misses nothing. It ends after ``count`` changes or after ``timeout`` (as
        "2s"); closing the iterator ends it too.
        """
        words = ["watch", ns, _text(query), "--format", "jsonl", *_option("--resume", resume)]
        words += _option("--count", count) + _option("--timeout", timeout)
        return _changes(_Following([self._program, *self._options, *words]))

    # The program

    def run(self, *words: str, stdin: str | None = None) -> str:
        """Runs any command of rmem on this memory and returns its stdout."""
        code, stdout, stderr = self._call(list(words), stdin)
        if code != 0:
            raise error_of(code, stderr, in_python=False)
        return stdout

    def _run(self, words: list[str], stdin: str | None = None) -> str:
        code, stdout, stderr = self._call(words, stdin)
        if code != 0:
            raise error_of(code, stderr)
        return stdout

    def _call(self, words: list[str], stdin: str | None) -> tuple[int, str, str]:
        # Without input of our own, rmem must not read what is meant for the calling program.
        given: dict[str, Any] = {"input": stdin} if stdin is not None else {"stdin": subprocess.DEVNULL}
        done = subprocess.run(
            [self._program, *self._options, *words],
            capture_output=True,
            text=True,
            encoding="utf-8",
            **given,
        )
        return done.returncode, done.stdout, done.stderr


def _id(plan: str | Plan) -> str:
    if not isinstance(plan, Plan):
        return plan
    if plan.id is None:
        raise ValueError("the plan is not stored; plan(…, store=True) stores it")
    return plan.id


def _namespace(plan: str | Plan, namespace: str | None) -> str | None:
    return namespace or (plan.namespace if isinstance(plan, Plan) else None)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else encode(value)


def _at(time: str | datetime | None) -> list[str]:
    if isinstance(time, datetime):
        time = time.astimezone(timezone.utc).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return _option("--at", time)


def _object(document: Document) -> str:
    if not isinstance(document, Mapping):
        raise TypeError(f"a document is a mapping, not a {type(document).__name__}")
    return encode(document)


def _option(name: str, value: Any) -> list[str]:
    if value is None:
        return []
    if isinstance(value, (str, os.PathLike)):
        return [f"{name}={os.fspath(value)}"]
    return [f"{name}={_text(value)}"]


def _task(domain: Path | None, goal: str | None, parameters: Mapping[str, Any] | None) -> list[str]:
    words = _option("--domain", domain) + _option("--goal", goal)
    for name, value in (parameters or {}).items():
        words += ["-D", f"{name}={value}" if isinstance(value, str) else f"{name}:={encode(value)}"]
    return words


def _lines(text: str) -> list[Any]:
    return [decode(line) for line in text.split("\n") if line.strip()]


def _plan(report: Mapping[str, Any]) -> Plan:
    steps = [Step(**{key: step.get(key) for key in Step.__dataclass_fields__}) for step in report["steps"]]
    return Plan(
        id=report.get("id"),
        namespace=report.get("namespace"),
        outcome=report["outcome"],
        planner=report.get("planner"),
        cost=report.get("cost"),
        makespan=report.get("makespan"),
        steps=steps,
        report=report,
    )


class _Following:
    """A running ``rmem watch``; when it is made, the watch is in place or has failed."""

    def __init__(self, command: list[str]) -> None:
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
        )
        self._messages: list[str] = []
        self._in_place = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._in_place.wait()

    def _read(self) -> None:
        stderr: IO[str] = self.process.stderr  # type: ignore[assignment]
        for line in stderr:
            self._messages.append(line)
            if "watching " in line:
                self._in_place.set()
        self._in_place.set()

    def end(self) -> str:
        """Ends the process; returns what it printed on stderr."""
        if self.process.poll() is None:
            self.process.terminate()
        self.process.wait()
        self._reader.join()
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()
        return "".join(self._messages)


def _changes(following: _Following) -> Iterator[Change]:
    process = following.process
    stdout: IO[str] = process.stdout  # type: ignore[assignment]
    try:
        for line in stdout:
            change = decode(line)
            yield Change(
                operation=change["operation"],
                ns=change["ns"],
                id=change.get("_id"),
                before=change.get("before"),
                after=change.get("after"),
            )
        process.wait()
    finally:
        running = process.poll() is None
        messages = following.end()
    # 1: the timeout came before the last of `count` changes.
    if not running and process.returncode not in (0, 1):
        raise error_of(process.returncode, messages)


__all__ = ["Change", "Check", "Memory", "ObjectId", "Plan", "RmemError", "Step"]
