"""The Python module over a real rmem: the wheel's, or the one that RMEM_PROGRAM names."""

from __future__ import annotations

import math
from datetime import datetime, timezone
from pathlib import Path

import pytest

import rmem
from rmem import Memory, ObjectId

ROOT = Path(__file__).resolve().parents[2]
BLOCKS = ROOT / "domains/blocksworld/domain.pddl"
TEMPLATE = ROOT / "templates/blocksworld/problem.pddl.j2"
WORLD = ROOT / "fixtures/blocksworld.json"
NS = "robmem.worldmodel"


@pytest.fixture
def memory(tmp_path: Path) -> Memory:
    return Memory(f"file:{tmp_path}/robot.rmem")


@pytest.fixture
def blocks(memory: Memory) -> Memory:
    memory.run("restore", str(WORLD))
    return memory


def test_documents_come_back_as_they_were_stored(memory: Memory) -> None:
    document = {
        "_id": ObjectId("65f000000000000000000001"),
        "text": "Schrödinger 'x' \" \n",
        "small": 3,
        "large": 2**40,
        "double": 2.0,
        "infinite": math.inf,
        "bytes": b"\x00\xff",
        "when": datetime(2026, 1, 2, 3, 4, 5, 678000, tzinfo=timezone.utc),
        "nested": {"list": [1, None, True, {"a": []}]},
    }
    assert memory.insert(NS, document) == [document["_id"]]
    assert memory.query(NS) == [document]
    assert isinstance(memory.find_one(NS)["double"], float)


def test_a_key_that_begins_with_a_dollar_is_left_as_it_is(memory: Memory) -> None:
    memory.insert(NS, {"_id": 1, "price": {"$numberDecimal": "1.10"}})
    assert memory.find_one(NS)["price"] == {"$numberDecimal": "1.10"}


def test_operations_take_dictionaries_and_texts(memory: Memory) -> None:
    memory.insert(NS, *({"_id": i, "kind": "cup" if i % 2 else "plate"} for i in range(6)))
    assert memory.count(NS, {"kind": "cup"}) == memory.count(NS, "{kind: 'cup'}") == 3
    assert memory.query(NS, {"kind": "cup"}, sort={"_id": -1}, limit=1, skip=1, fields={"kind": 0}) == [{"_id": 3}]
    assert sorted(memory.distinct(NS, "kind")) == ["cup", "plate"]
    assert memory.update(NS, {"_id": 0}, {"$set": {"kind": "bowl"}})["modified"] == 1
    assert memory.update(NS, {"kind": "cup"}, {"$set": {"clean": True}}, many=True)["modified"] == 3
    sums = memory.aggregate(NS, [{"$group": {"_id": "$kind", "n": {"$sum": 1}}}, {"$sort": {"_id": 1}}])
    assert sums == [{"_id": "bowl", "n": 1}, {"_id": "cup", "n": 3}, {"_id": "plate", "n": 2}]
    assert memory.delete(NS, {"kind": "cup"}) == 1
    assert memory.delete(NS, {"kind": "cup"}, many=True) == 2
    assert memory.insert(NS) == []


def test_each_failure_has_its_exception(memory: Memory) -> None:
    with pytest.raises(rmem.BadInput, match="expected"):
        memory.query(NS, "{")
    with pytest.raises(rmem.UsageError):
        memory.run("query")
    memory.insert(NS, {"_id": 1})
    with pytest.raises(rmem.Conflict):
        memory.insert(NS, {"_id": 1})
    with pytest.raises(rmem.StoreFailed):
        Memory("mongodb://127.0.0.1:1/").count(NS)
    with pytest.raises(TypeError, match="set"):
        memory.insert(NS, {"a": {1}})
    with pytest.raises(OverflowError):
        memory.insert(NS, {"a": 2**64})


def test_messages_name_arguments_instead_of_options(memory: Memory) -> None:
    memory.insert(NS, {"_id": 1, "kind": "cup"}, {"_id": 2})
    with pytest.raises(rmem.UsageError, match="expected a query, or many=True") as refused:
        memory.delete(NS, {})
    assert "--all" in refused.value.stderr
    with pytest.raises(rmem.BadInput, match="or replace=True to replace the document as a whole"):
        memory.update(NS, {"_id": 1}, {"kind": "bowl"})
    assert memory.update(NS, {"_id": 1}, {"kind": "bowl"}, replace=True)["modified"] == 1
    with pytest.raises(rmem.UsageError, match="--all"):
        memory.run("delete", NS)
    assert memory.delete(NS, " {\n}", many=True) == 2
    memory.insert(NS, {"_id": "--all"})
    with pytest.raises(rmem.Conflict, match='_id: "--all"'):
        memory.insert(NS, {"_id": "--all"})
    with pytest.raises(rmem.BadInput, match="/x/--all"):
        memory.plan("/x/--all", template=TEMPLATE, goal="(and)")


def test_an_argument_that_looks_like_an_option_is_none(memory: Memory) -> None:
    memory.insert(NS, {"_id": "--help"})
    assert memory.distinct(NS, "_id") == ["--help"]
    assert memory.query(NS, sort={"_id": 1}, limit=0) == memory.query(NS)


def test_a_plan_is_found_stepped_and_checked(blocks: Memory) -> None:
    plan = blocks.plan(BLOCKS, template=TEMPLATE, goal="(and (on A B) (on B C))")
    assert (plan.outcome, plan.cost, len(plan.steps)) == ("success", 5, 5)
    assert (plan.steps[0].action, plan.steps[0].args) == ("stack", {"x": "B", "y": "C"})
    assert blocks.check(plan.id)
    blocks.step(plan.id, 1, "started")
    blocks.delete(NS, {"relation": "clear", "object": "D"})
    check = blocks.check(plan.id)
    assert not check and check.report
    with pytest.raises(ValueError):
        blocks.step(plan.id, 1, "finished")


def test_plans_and_steps_are_arguments_themselves(blocks: Memory) -> None:
    plan = blocks.plan(BLOCKS, template=TEMPLATE, goal="(and (on A B) (on B C))", anytime=True, timeout="1s", into="a.plans")
    blocks.step(plan, plan.steps[0], "started")
    blocks.step(plan, plan.steps[0], "open")
    assert blocks.check(plan)
    blocks.step(plan, plan.steps[2], "done", out_of_order=True)
    with pytest.raises(ValueError, match="not stored"):
        blocks.check(blocks.plan(BLOCKS, template=TEMPLATE, goal="(on A B)", store=False))


def test_the_message_of_an_exception_is_the_error_alone(blocks: Memory) -> None:
    with pytest.raises(rmem.Unsolvable) as raised:
        blocks.plan(BLOCKS, template=TEMPLATE, goal="(on A A)")
    assert raised.value.message.startswith("error: ") and "stored in" in raised.value.stderr


def test_the_module_has_the_version_of_the_program(blocks: Memory) -> None:
    assert rmem.__version__ == blocks.run("--version").split()[-1]


def test_a_problem_is_generated_and_why_there_is_no_plan_is_an_exception(blocks: Memory) -> None:
    assert "(on D A)" in blocks.gen_problem(TEMPLATE, domain=BLOCKS, goal="(on A B)")
    with pytest.raises(rmem.Unsolvable):
        blocks.plan(BLOCKS, template=TEMPLATE, goal="(on A A)")


def test_a_planner_that_is_not_installed_is_an_exception(blocks: Memory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nonexistent")
    with pytest.raises(rmem.PlannerNotFound, match="fast-downward"):
        blocks.plan(BLOCKS, template=TEMPLATE, goal="(on A B)", planner="fast-downward")


def test_changes_arrive_and_a_name_resumes(memory: Memory) -> None:
    changes = memory.watch(NS, {"kind": "cup"}, resume="executive", timeout="30s")
    memory.insert(NS, {"_id": 1, "kind": "cup"}, {"_id": 2, "kind": "plate"})
    change = next(changes)
    assert (change.operation, change.ns, change.id, change.after) == ("insert", NS, 1, {"_id": 1, "kind": "cup"})
    changes.close()
    memory.update(NS, {"_id": 2}, {"$set": {"kind": "cup"}})
    seen = [change.id for change in memory.watch(NS, {"kind": "cup"}, resume="executive", count=2, timeout="2s")]
    assert seen[-1] == 2


def test_a_watch_that_cannot_begin_raises(memory: Memory) -> None:
    with pytest.raises(rmem.BadInput):
        list(memory.watch(NS, "{"))
