"""Every requirement of `check_observer` is violated once on purpose, and named."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from broken_observers import BROKEN, Broken, BrokenConfig, change, not_at_all
from broken_settings import Bare, Demanding, Empty, Kinded, NameIsASetting, Silent, Spaced, Stuck, Taken, Thawed

from dlokit.errors import DlokitError
from dlokit.extras.checks.checks import findings
from dlokit.extras.checks.observer_checks import OBSERVER_CHECKS
from dlokit.extras.checks.settings import settings_checks
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategy
from dlokit.testing import CheckFailed, check_observer
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation


def test_a_valid_observer_passes_every_check_and_its_time_is_reported() -> None:
    report = check_observer(BrokenConfig, frames=3)
    assert set(report.passed) >= set(BROKEN)
    assert report.follows_branches
    assert not report.gives_covariance
    assert 0.0 < report.frame_p50_s <= report.frame_p99_s
    assert "24 checks passed; follows branched DLOs, without covariance, no memory" in str(report)


def test_each_requirement_has_an_observer_that_violates_it() -> None:
    assert list(BROKEN) == [check.name for check in OBSERVER_CHECKS]


@pytest.mark.parametrize("name", BROKEN)
def test_a_violated_requirement_is_found(name: str) -> None:
    (check,) = (check for check in OBSERVER_CHECKS if check.name == name)
    assert findings([check], partial(BrokenConfig(breaks=name).build, BelievedDlo()))
    assert not findings([check], partial(BrokenConfig().build, BelievedDlo()))


class Remembering(Broken):
    def __init__(self) -> None:
        super().__init__(not_at_all)
        self._before: TargetPoints | None = None

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        before, self._before = self._before, super().estimate(seen, prior)
        return before or self._before


def test_an_observer_that_remembers_in_its_object_is_not_pure() -> None:
    (check,) = (check for check in OBSERVER_CHECKS if check.name == "pure")
    found = findings([check], Remembering)
    assert "something is kept in the object" in found[0].wrong


class Smoothing(Broken):
    """Averages its nodes with those of the cloud before, which it has in its memory."""

    def __init__(self) -> None:
        super().__init__(not_at_all)

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        found = super().estimate(seen, prior)
        before = self.before(prior, found)
        nodes = found.nodes_world if before is None else (0.9 * found.nodes_world + 0.1 * before)
        return change(found, nodes_world=nodes, memory={"before": found.nodes_world})

    def before(self, prior: DloState, found: TargetPoints) -> Float64Array | None:
        before = prior.memory.get("before")
        return None if before is None or before.shape != found.nodes_world.shape else before


class TakingAnything(Smoothing):
    def before(self, prior: DloState, found: TargetPoints) -> Float64Array | None:
        return next((np.broadcast_to(one[:1], found.nodes_world.shape) for one in prior.memory.values()), None)


class KeptElsewhere(Smoothing):
    """As `Smoothing`, but what it remembers stays in the object once there is a memory."""

    def __init__(self) -> None:
        super().__init__()
        self._kept: Float64Array | None = None

    def before(self, prior: DloState, found: TargetPoints) -> Float64Array | None:
        before, self._kept = self._kept, found.nodes_world
        return before if prior.memory else None


def test_an_observer_with_a_memory_passes() -> None:
    assert findings([check for check in OBSERVER_CHECKS if check.name in ("pure", "memory")], Smoothing) == []


@pytest.mark.parametrize(
    ("build", "name", "says"),
    [
        (TakingAnything, "memory", "a memory with other names, of another observer, is not ignored"),
        (KeptElsewhere, "memory", "from the recorded prior and its memory in a new instance"),
        (KeptElsewhere, "pure", "something is kept in the object"),
    ],
)
def test_a_memory_that_does_not_travel_is_found(build: Callable[[], ObserverStrategy], name: str, says: str) -> None:
    (check,) = (check for check in OBSERVER_CHECKS if check.name == name)
    assert any(says in found.wrong for found in findings([check], build))


def test_all_violations_are_in_one_error() -> None:
    with pytest.raises(CheckFailed) as caught:
        check_observer(BrokenConfig(breaks="follows"))
    text = str(caught.value)
    assert isinstance(caught.value, DlokitError)
    assert isinstance(caught.value, AssertionError)
    assert "observer broken_observers:BrokenConfig" in text.splitlines()[0]
    assert "failed: follows, hidden nodes" in text  # an observer that never moves also fails for hidden nodes
    assert "a rod that moved by 30 mm is found 30.0 mm off" in text
    assert "wanted: nodes within 15 mm" in text


def test_an_exception_is_a_finding_with_its_location() -> None:
    with pytest.raises(CheckFailed, match=r"raised ValueError: too few points \(.*broken_observers\.py:\d+\)"):
        check_observer(BrokenConfig(breaks="few points"))


class Refusing(Broken):
    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        from dlokit.errors import SkillFailure

        if len(prior.topology.edges) == 39:
            raise SkillFailure("not_a_chain", "plain rods only")
        return super().estimate(seen, prior)


def refusing() -> ObserverStrategy:
    return Refusing(not_at_all)


def test_an_observer_for_rods_may_refuse_a_branched_dlo_by_name() -> None:
    assert findings(OBSERVER_CHECKS, refusing) == []


@pytest.mark.parametrize(
    ("config", "check", "says"),
    [
        (Thawed, "frozen dataclass", "Thawed is not frozen"),
        (NameIsASetting, "name", "name is a setting"),
        (Spaced, "name", "'two words', which a command line cannot list"),
        (Taken, "free name", "taken by dlokit.skills.observer.cpd:CpdConfig"),
        (Demanding, "defaults", "radius_m has no default"),
        (Silent, "documented", "radius_m has no docstring"),
        (Bare, "documented", "Bare has no docstring"),
        (Stuck, "travels", "raised"),
        (Kinded, "travels", "a setting is called 'kind'"),
    ],
)
def test_settings_that_violate_a_requirement_are_found(config: type[Any], check: str, says: str) -> None:
    with pytest.raises(CheckFailed) as caught:
        check_observer(config)
    assert f"- {check}: " in str(caught.value)
    assert says in str(caught.value)


@pytest.mark.parametrize(("config", "says"), [(Kinded, "AttributeError"), (Empty, "a object without estimate")])
def test_settings_that_build_no_observer_are_a_single_finding(config: type[Any], says: str) -> None:
    with pytest.raises(CheckFailed) as caught:
        check_observer(config)
    assert f"builds: {says}" in str(caught.value).replace("raised ", "").replace("build() gives ", "")
    assert "order" not in str(caught.value)


def test_each_requirement_of_settings_is_violated_above() -> None:
    names = {check.name for check in settings_checks("observer", {})}
    assert names == {"frozen dataclass", "name", "free name", "defaults", "documented", "travels"}
