"""Flow charts defined as data."""

import asyncio
import enum

import pytest

from dlokit.decision.flow import End, FaultKind, Flow, FlowError, Step, StepFault, mermaid, run_flow
from dlokit.types.flow import RunOutcome


class Coin(enum.Enum):
    HEADS = "heads"
    TAILS = "tails"


async def heads(task: list[str]) -> Coin:
    task.append("first")
    return Coin.HEADS


async def tails(task: list[str]) -> Coin:
    task.append("second")
    return Coin.TAILS


def flow(first_tails: str = "first") -> Flow[list[str]]:
    return Flow(
        name="toss",
        start="first",
        steps=(
            Step("first", heads, {Coin.HEADS: "second", Coin.TAILS: first_tails}),
            Step("second", tails, {Coin.HEADS: "first", Coin.TAILS: "done"}),
        ),
        ends=(End("done", RunOutcome.CONVERGED),),
    )


def test_a_flow_follows_its_arrows_and_reports_each_step_with_the_previous_outcome() -> None:
    visited: list[tuple[str, str]] = []
    task: list[str] = []

    async def entered(step: str, last: str) -> None:
        visited.append((step, last))

    end = asyncio.run(run_flow(flow(), task, entered))
    assert end.outcome is RunOutcome.CONVERGED
    assert visited == [("first", ""), ("second", "heads"), ("done", "tails")]
    assert task == ["first", "second"]


def test_an_arrow_to_nowhere_is_refused_when_the_flow_is_made() -> None:
    with pytest.raises(FlowError, match="arrow to 'frist'"):
        flow(first_tails="frist")


def test_an_outcome_without_an_arrow_is_refused_when_the_flow_is_made() -> None:
    with pytest.raises(FlowError, match=r"no arrow for .*TAILS"):
        Flow(
            name="toss",
            start="first",
            steps=(Step("first", heads, {Coin.HEADS: "done"}),),
            ends=(End("done", RunOutcome.CONVERGED),),
        )


def test_two_steps_with_one_name_are_refused() -> None:
    with pytest.raises(FlowError, match="two steps"):
        Flow(
            name="toss",
            start="first",
            steps=(Step("first", heads, {Coin.HEADS: "first", Coin.TAILS: "first"}),),
            ends=(End("first", RunOutcome.CONVERGED),),
        )


def test_the_drawing_has_every_arrow_and_highlights_the_current_step() -> None:
    chart = mermaid(flow(), current="second")
    for source, outcome, target in flow().edges():
        assert f"{source} -->|{outcome}| {target}" in chart
    assert "style second" in chart


def faulty(fault: FaultKind, then: dict[Coin | FaultKind, str]) -> tuple[list[tuple[str, str]], list[str]]:
    """The visited steps and reported faults of a flow in which one step raises."""

    async def raises(task: list[str]) -> Coin:
        raise StepFault(fault, "too far", skill="robot.move_to", reason="unreachable")

    chart: Flow[list[str]] = Flow(
        name="toss",
        start="first",
        steps=(Step("first", raises, {Coin.HEADS: "done", Coin.TAILS: "done", **then}),),
        ends=(End("done", RunOutcome.CONVERGED), End("failed", RunOutcome.FAILED)),
    )
    visited: list[tuple[str, str]] = []
    told: list[str] = []

    async def entered(step: str, last: str) -> None:
        visited.append((step, last))

    asyncio.run(run_flow(chart, [], entered, lambda fault: told.append(str(fault))))
    return visited, told


def test_a_fault_takes_its_arrow_and_is_reported() -> None:
    visited, told = faulty(FaultKind.REFUSED, {FaultKind.REFUSED: "done", FaultKind.FAILED: "failed"})
    assert visited == [("first", ""), ("done", "refused")]
    assert told == ["robot.move_to too far"]


def test_a_fault_without_an_arrow_of_its_own_takes_that_of_failed() -> None:
    visited, _ = faulty(FaultKind.LOST, {FaultKind.FAILED: "failed"})
    assert visited[-1] == ("failed", "failed")


def test_a_fault_in_a_step_without_an_arrow_for_faults_is_raised() -> None:
    with pytest.raises(StepFault, match="too far"):
        faulty(FaultKind.REFUSED, {})


def test_a_step_with_an_arrow_for_a_fault_also_needs_that_of_failed() -> None:
    with pytest.raises(FlowError, match="FAILED"):
        faulty(FaultKind.REFUSED, {FaultKind.REFUSED: "done"})
