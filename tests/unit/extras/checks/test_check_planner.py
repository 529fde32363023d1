"""Every requirement of `check_planner` and `check_segmentation` is violated once on purpose, and named."""

from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import msgspec
import numpy as np
import pytest

from dlokit.extras.checks.checks import Check, findings
from dlokit.extras.checks.planners import PLANNER_CHECKS, Build
from dlokit.extras.checks.segmentations import SEGMENTATION_CHECKS
from dlokit.skills.planning.base import PlanningTools
from dlokit.skills.planning.farthest import FarthestConfig
from dlokit.testing import CheckFailed, check_planner, check_segmentation
from dlokit.types.action import Action, Marks
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.image import Image, Mask

replace = msgspec.structs.replace


@dataclass(frozen=True, kw_only=True)
class FlawedPlanner:
    """The paper's planner, with one flaw."""

    name: ClassVar[str] = "flawed"

    flaw: str = ""
    """The requirement that it violates."""

    def build(self, tools: PlanningTools) -> Any:
        """The planner."""
        if self.flaw == "builds":
            return object()
        return Flawed(self.flaw, tools)


class Flawed:
    decisions = 0

    def __init__(self, flaw: str, tools: PlanningTools) -> None:
        self._flaw = flaw
        self._tools = tools

    async def propose(self, shape: DloState, goal: GoalShape, marks: Marks) -> AsyncIterator[Action]:
        tools = self._tools
        if self._flaw == "arguments untouched":
            shape.nodes_world[0] += 0.0
        if self._flaw == "actions":
            return
        if self._flaw == "marks":
            marks = Marks(invalid_nodes=np.array([], dtype=np.int64))
        if self._flaw == "reach":
            tools = PlanningTools(reachable=lambda T: True, actions=tools.actions, model=tools.model)
        Flawed.decisions += 1
        async for action in FarthestConfig().build(tools).propose(shape, goal, marks):
            yield self._spoilt(action)

    def _spoilt(self, action: Action) -> Action:
        if self._flaw == "grasps":
            return replace(action, grasp=replace(action.grasp, node=(action.grasp.node + 9) % 31))
        if self._flaw == "paths":
            return replace(action, path=action.path[-1:])
        if self._flaw == "repeatable":
            return replace(action, stamp_ns=Flawed.decisions)
        return action


FLAWS = ["builds", *(check.name for check in PLANNER_CHECKS)]


def test_a_sound_planner_passes_every_check() -> None:
    report = check_planner(FlawedPlanner)
    assert set(report.passed) >= set(FLAWS)
    assert "proposes pick-and-place" in str(report)


@pytest.mark.parametrize("check", PLANNER_CHECKS, ids=lambda check: check.name)
def test_a_planner_that_violates_a_requirement_is_found(check: Check[Build]) -> None:
    assert findings([check], FlawedPlanner(flaw=check.name).build)


@pytest.mark.parametrize("flaw", ["builds", "actions"])
def test_a_planner_that_violates_a_requirement_fails_by_its_name(flaw: str) -> None:
    with pytest.raises(CheckFailed, match=rf"failed: .*{flaw}"):
        check_planner(FlawedPlanner(flaw=flaw))


@dataclass(frozen=True, kw_only=True)
class FlawedSegmentation:
    """By brightness, with one flaw."""

    name: ClassVar[str] = "flawed"

    flaw: str = ""
    """The requirement that it violates."""

    def build(self) -> Any:
        """The segmentation."""
        return object() if self.flaw == "builds" else FlawedMask(self.flaw)


class FlawedMask:
    def __init__(self, flaw: str) -> None:
        self._flaw = flaw
        self._pictures = 0

    def mask(self, image: Image) -> Mask:
        self._pictures += 1
        flaws: dict[str, Callable[[Any], Any]] = {
            "mask": lambda bright: bright[::2],
            "finds": lambda bright: bright & (np.arange(bright.shape[1]) < 100),
            "empty picture": lambda bright: bright if bright.any() else ~bright,
            "pure": lambda bright: np.roll(bright, 3 * (self._pictures > 1), axis=0),
        }
        if self._flaw == "arguments untouched":
            image.pixels[0] = 0
        grey = image.pixels if image.pixels.ndim == 2 else image.pixels.mean(axis=2)
        return Mask(pixels=flaws.get(self._flaw, lambda bright: bright)(grey > 120))


SEGMENTATION_FLAWS = ["builds", *(check.name for check in SEGMENTATION_CHECKS)]


def test_a_sound_segmentation_passes_every_check() -> None:
    assert set(check_segmentation(FlawedSegmentation, pictures=2).passed) >= set(SEGMENTATION_FLAWS)


@pytest.mark.parametrize("flaw", SEGMENTATION_FLAWS)
def test_a_segmentation_that_violates_a_requirement_fails_by_its_name(flaw: str) -> None:
    with pytest.raises(CheckFailed, match=rf"failed: .*{flaw}"):
        check_segmentation(FlawedSegmentation(flaw=flaw))
