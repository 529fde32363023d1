"""Bad clouds, which must not reach a strategy: the last state is kept, and no node counts as seen."""

from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from synthetic_clouds import cloud, shape, state

from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer import following
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.config import OURS, ObserverConfig
from dlokit.skills.observer.following import MOST_POINTS, cleaned, followed
from dlokit.skills.observer.initialise.first_shape import initial_targets
from dlokit.skills.observer.visibility import grown_covariance
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import DistrustReason, Observation

ROD = shape("S")
SECOND_NS = 1_000_000_000
CONFIG = ObserverConfig()


def prior() -> DloState:
    return msgspec.structs.replace(state(ROD), observed_stamp_ns=SECOND_NS, stamp_ns=SECOND_NS)


def seen(points: np.ndarray, stamp_ns: int = 2 * SECOND_NS) -> Observation:
    return Observation(stamp_ns=stamp_ns, points_world=points.astype(np.float32))


def table() -> Observation:
    return seen(np.random.default_rng(0).uniform([0.2, -0.4, 0.0], [0.8, 0.4, 0.004], (4000, 3)))


BAD: dict[str, tuple[Callable[[], Observation], DistrustReason]] = {
    "empty": (lambda: seen(np.zeros((0, 3))), DistrustReason.NO_POINTS),
    "all NaN": (lambda: seen(np.full((500, 3), np.nan)), DistrustReason.NO_POINTS),
    "one point": (lambda: seen(ROD[:1]), DistrustReason.NO_POINTS),
    "another frame": (lambda: seen(cloud(ROD).points_world + np.float32(3.0)), DistrustReason.FAR_POINTS),
    "millimetres": (lambda: seen(cloud(ROD).points_world * 1000.0), DistrustReason.FAR_POINTS),
    "a stamp that repeats": (lambda: seen(cloud(ROD).points_world, SECOND_NS), DistrustReason.OLD_STAMP),
    "a stamp that goes backwards": (lambda: seen(cloud(ROD).points_world, 5), DistrustReason.OLD_STAMP),
    "the table alone": (table, DistrustReason.NOT_THE_DLO),
}


@pytest.mark.parametrize("config", OURS, ids=[config.name for config in OURS])
@pytest.mark.parametrize("name", BAD)
def test_a_bad_cloud_is_named_and_the_last_state_is_kept_with_growing_uncertainty(
    config: type[ObserverStrategyConfig], name: str
) -> None:
    make, reason = BAD[name]
    answer = followed(config().build(BelievedDlo()), make(), prior(), CONFIG)
    assert answer.distrust is reason
    np.testing.assert_array_equal(answer.targets.nodes_world, ROD)
    assert not answer.targets.visible.any()
    assert answer.targets.health == 0.0
    assert answer.targets.covariance is not None
    # A second at the drift speed; none passes between equal stamps, or backwards.
    grown_m = 0.0 if reason is DistrustReason.OLD_STAMP else CONFIG.drift_m_s
    assert np.sqrt(answer.targets.covariance[0, 0, 0]) == pytest.approx(0.005 + grown_m)


def test_ten_million_points_are_downsampled_before_use() -> None:
    rng = np.random.default_rng(0)
    points = np.tile(cloud(ROD).points_world, (6000, 1))[:10_000_000]
    points[rng.integers(0, len(points), 1000)] = np.nan
    usable = cleaned(seen(points), MOST_POINTS)
    assert 0.9 * MOST_POINTS < len(usable.points_world) <= MOST_POINTS
    assert np.isfinite(usable.points_world).all()


@pytest.mark.parametrize("config", OURS, ids=[config.name for config in OURS])
def test_nan_points_are_ignored(config: type[ObserverStrategyConfig]) -> None:
    points = cloud(ROD).points_world.copy()
    points[::7] = np.nan
    answer = followed(config().build(BelievedDlo()), seen(points), prior(), CONFIG)
    assert answer.distrust is None
    assert np.isfinite(answer.targets.nodes_world).all()


class Broken:
    """A strategy that returns its input."""

    def __init__(self, answer: Callable[[], TargetPoints]) -> None:
        self._answer = answer

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        return self._answer()


def fails() -> TargetPoints:
    raise ZeroDivisionError("no points on this side")


@pytest.mark.parametrize(
    "answer",
    [
        fails,
        lambda: TargetPoints(stamp_ns=1, nodes_world=ROD[:5], visible=np.ones(5, dtype=np.bool_)),
        lambda: TargetPoints(stamp_ns=1, nodes_world=ROD * np.nan, visible=np.ones(len(ROD), dtype=np.bool_)),
        lambda: TargetPoints(stamp_ns=1, nodes_world=ROD, visible=np.ones(len(ROD), dtype=np.bool_), health=np.nan),
        lambda: TargetPoints(stamp_ns=1, nodes_world=ROD, visible=np.ones(5, dtype=np.bool_)),
        lambda: TargetPoints(stamp_ns=1, nodes_world=ROD, visible=np.ones(len(ROD))),  # pyright: ignore[reportArgumentType]
        lambda: TargetPoints(stamp_ns=1, nodes_world=ROD, visible=[True] * len(ROD)),  # pyright: ignore[reportArgumentType]
        lambda: TargetPoints(
            stamp_ns=1, nodes_world=ROD, visible=np.ones(len(ROD), dtype=np.bool_), covariance=np.eye(3)
        ),
    ],
    ids=["raises", "too few nodes", "NaN nodes", "NaN health", "too few flags", "no flags", "a list", "one covariance"],
)
def test_a_failing_strategy_loses_the_rod_but_does_not_end_the_run(answer: Callable[[], TargetPoints]) -> None:
    result = followed(Broken(answer), seen(cloud(ROD).points_world), prior(), CONFIG)
    assert result.distrust is DistrustReason.BAD_TARGETS
    np.testing.assert_array_equal(result.targets.nodes_world, ROD)
    assert result.targets.health == 0.0


def test_uncertainty_grows_equally_in_one_step_and_in_many() -> None:
    stated = np.broadcast_to(np.diag([1e-6, 4e-6, 9e-6]), (len(ROD), 3, 3))
    once = grown_covariance(msgspec.structs.replace(prior(), covariance=stated), 0.5, 0.1)
    steps = stated
    for _ in range(10):
        steps = grown_covariance(msgspec.structs.replace(prior(), covariance=steps), 0.05, 0.1)
    np.testing.assert_allclose(steps, once, rtol=1e-9)
    wide = grown_covariance(msgspec.structs.replace(prior(), covariance=once * 1e4), 9.0, 0.1)
    np.testing.assert_array_equal(wide, once * 1e4)


class Answering:
    """A strategy that answers every cloud with the same nodes."""

    def __init__(self, nodes: np.ndarray, visible: np.ndarray) -> None:
        self._targets = TargetPoints(stamp_ns=2 * SECOND_NS, nodes_world=nodes, visible=visible, health=0.9)

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        return self._targets


@pytest.fixture
def orders(monkeypatch: pytest.MonkeyPatch) -> list[Observation]:
    """The clouds that were ordered from scratch."""
    sought: list[Observation] = []

    def counted(seen: Observation, *rest: object) -> TargetPoints:
        sought.append(seen)
        return initial_targets(seen, *rest)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(following, "initial_targets", counted)
    return sought


def hidden(*nodes: int) -> np.ndarray:
    visible = np.ones(len(ROD), dtype=np.bool_)
    visible[list(nodes)] = False
    return visible


@pytest.mark.parametrize("outliers", [0.0, 0.05])
def test_a_hidden_node_alone_does_not_trigger_ordering_from_scratch(outliers: float, orders: list[Observation]) -> None:
    look = seen(cloud(ROD, outliers=outliers, hidden=(0.4, 0.6)).points_world)
    answer = followed(Answering(ROD, hidden(13, 14, 15, 16, 17)), look, prior(), CONFIG)
    assert answer.distrust is None
    assert orders == []


def test_a_rod_away_from_targets_with_hidden_nodes_is_found(orders: list[Observation]) -> None:
    beside = ROD + np.array([0.0, 0.03, 0.0])
    answer = followed(Answering(beside, hidden(15)), seen(cloud(ROD).points_world), prior(), CONFIG)
    assert answer.distrust is DistrustReason.ELSEWHERE
    assert np.linalg.norm(answer.targets.nodes_world - ROD, axis=1).mean() < 0.004
    assert len(orders) == 1


def test_a_thick_rod_is_not_elsewhere_because_its_surface_is() -> None:
    beside = ROD + np.array([0.0, 0.03, 0.0])
    look = seen(cloud(ROD).points_world)
    assert followed(Answering(beside, hidden(15)), look, prior(), CONFIG, radius_m=0.02).distrust is None


def test_targets_that_slid_along_the_rod_are_corrected() -> None:
    line = shape("I")
    slid = line + 0.02 * (line[0] - line[1]) / np.linalg.norm(line[0] - line[1])
    before = msgspec.structs.replace(state(line), observed_stamp_ns=SECOND_NS, stamp_ns=SECOND_NS)
    answer = followed(Answering(slid, hidden(0)), seen(cloud(line).points_world), before, CONFIG)
    assert answer.distrust is DistrustReason.ELSEWHERE
