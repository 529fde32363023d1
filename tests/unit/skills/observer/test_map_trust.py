"""What the most probable rod says of itself: unsure of what is hidden, and for how long; healthy unless it is lost."""

import msgspec
import numpy as np
import pytest
from synthetic_clouds import cloud, shape, state

from dlokit.geometry import resample
from dlokit.skills.observer.base import prior_from
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.observer.following import UNUSABLE_HEALTH
from dlokit.skills.observer.map.observer import MapObserver
from dlokit.skills.observer.map.trust import carried
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import Observation, Occlusion
from dlokit.types.pose import Pose

DOWN = Pose(position_m=np.array([0.5, 0.0, 1.0]), wxyz=np.array([0.0, 1.0, 0.0, 0.0]))
CAMERA = CameraCalibration(
    width_px=640, height_px=560, fx_px=500, fy_px=500, cx_px=319.5, cy_px=279.5, T_world_camera=DOWN
)
CELL_PX = 10
LOST_HEALTH = ObserverConfig().lost_health
HALF = (0.25, 0.75)


def seen_by_camera(seen: Observation, robot: Float64Array | None = None) -> Observation:
    """The cloud with a camera straight above (0.5, 0), and a robot half-way up above places (K, 3) [m]."""
    depth_m = np.full((56, 64), np.inf, dtype=np.float32)
    for x, y, _ in [] if robot is None else robot:
        column, row = int((319.5 + 500 * (x - 0.5)) / CELL_PX), int((279.5 - 500 * y) / CELL_PX)
        depth_m[row - 1 : row + 2, column - 1 : column + 2] = 0.5
    return msgspec.structs.replace(seen, calibration=CAMERA, occlusion=Occlusion(depth_m=depth_m, scale=CELL_PX))


def stretch(rod: Float64Array, hidden: tuple[float, float]) -> Float64Array:
    """The places of a stretch, given as shares of the length."""
    first, last = (round(share * 199) for share in hidden)
    return resample(rod, 200)[first : last + 1]


def hidden_by_robot(rod: Float64Array, hidden: tuple[float, float], seed: int = 0) -> Observation:
    """A cloud without a stretch, and the robot that hides it."""
    return seen_by_camera(cloud(rod, seed, hidden=hidden), stretch(rod, hidden))


def spread_m(targets: TargetPoints) -> Float64Array:
    """The stated standard deviation of each node (M,) [m]."""
    assert targets.covariance is not None
    return np.sqrt(np.trace(targets.covariance, axis1=1, axis2=2))


def after(clouds: list[Observation], prior: DloState) -> TargetPoints:
    """The last answer, each prior being the answer before."""
    topology = prior.topology
    for seen in clouds[:-1]:
        prior = prior_from(MapObserver().estimate(seen, prior), topology)
    return MapObserver().estimate(clouds[-1], prior)


def test_a_variance_is_the_smaller_of_what_is_carried_on_and_what_the_cloud_alone_says() -> None:
    rng = np.random.default_rng(0)
    fresh, more = (np.einsum("nij,nkj->nik", roots, roots) for roots in rng.normal(size=(2, 20, 3, 3)))
    alone, before = fresh + more, rng.uniform(0.0, 20.0, 20)
    new, most = np.trace(fresh, axis1=1, axis2=2), np.trace(alone, axis1=1, axis2=2)
    blocks = carried(fresh, alone, before, 0.9, 0.3)
    np.testing.assert_allclose(np.trace(blocks, axis1=1, axis2=2), np.minimum(new + 0.9 * before, most) + 0.3)
    kept = new + 0.9 * before < most
    assert 0 < np.count_nonzero(kept) < 20
    expected = np.where(kept[:, None, None], fresh * ((new + 0.9 * before) / new)[:, None, None], alone)
    np.testing.assert_allclose(blocks, expected + 0.1 * np.eye(3))


@pytest.mark.parametrize("count", [31, 13])  # 13 are so far apart that the chain is refined
def test_what_is_hidden_is_less_sure_from_cloud_to_cloud_and_sure_again_when_it_is_seen(count: int) -> None:
    rod = shape("S")
    full = seen_by_camera(cloud(rod, 9))
    clouds = [full] + [hidden_by_robot(rod, (0.35, 0.65), seed) for seed in range(8)]
    prior, middle = state(resample(rod, count)), count // 2
    rows = (clouds[:2], clouds[:4], clouds, [*clouds, full])
    soon, then, late, again = (spread_m(after(row, prior))[middle] for row in rows)
    assert late > 1.05 * then > 1.1 * soon  # gradually: not known at first and unknown from then on
    assert again < soon


def test_a_shape_before_that_nobody_knows_says_nothing_of_what_is_hidden() -> None:
    rod = shape("S")
    seen, known = hidden_by_robot(rod, HALF), state(rod)
    unknown = msgspec.structs.replace(known, visible=np.zeros(len(rod), dtype=np.bool_))
    assert spread_m(after([seen], unknown))[15] > 2.0 * spread_m(after([seen], known))[15]


def test_length_that_is_missing_in_open_view_makes_every_node_less_sure() -> None:
    rod, gap = shape("S"), (0.45, 0.6)
    explained = MapObserver().estimate(hidden_by_robot(rod, gap), state(rod))
    unexplained = MapObserver().estimate(seen_by_camera(cloud(rod, hidden=gap)), state(rod))
    assert np.all(spread_m(unexplained) > 2.0 * spread_m(explained).min())
    # In doubt, but used: something that nobody knows may hide them.
    assert explained.health > LOST_HEALTH > unexplained.health > UNUSABLE_HEALTH


@pytest.mark.parametrize("name", ["I", "S", "U", "random"])
def test_a_rod_is_trusted_with_half_of_it_or_a_tip_behind_the_robot(name: str) -> None:
    rod = shape(name, 4)
    for hidden in (HALF, (0.0, 0.3), (0.8, 1.0)):
        clouds = [hidden_by_robot(rod, hidden, seed) for seed in range(5)]
        assert after(clouds, state(rod)).health > LOST_HEALTH, hidden


def test_a_rod_is_trusted_among_a_quarter_of_outliers() -> None:
    rod = shape("S")
    assert after([seen_by_camera(cloud(rod, outliers=0.35))], state(rod)).health > LOST_HEALTH


@pytest.mark.parametrize(("name", "turned_rad"), [("S", np.pi / 2), ("U", np.pi / 1.5)])
def test_a_rod_that_is_not_where_its_nodes_are_is_not_trusted(name: str, turned_rad: float) -> None:
    rod = shape(name)
    c, s = np.cos(turned_rad), np.sin(turned_rad)
    turned = (rod - rod.mean(axis=0)) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + rod.mean(axis=0)
    clouds = [seen_by_camera(cloud(rod, seed)) for seed in range(3)]
    result = after(clouds, state(turned + np.array([0.06, 0.03, 0.0])))
    assert np.linalg.norm(result.nodes_world - rod, axis=1).mean() > 0.05  # else it has found back
    assert result.health < LOST_HEALTH


def test_a_cloud_of_the_table_is_not_trusted() -> None:
    table = np.random.default_rng(0).uniform([0.2, -0.3, 0.0], [0.8, 0.3, 0.002], (1800, 3))
    seen = seen_by_camera(msgspec.structs.replace(cloud(shape("S")), points_world=table.astype(np.float32)))
    assert after([seen], state(shape("S"))).health < 0.5 * LOST_HEALTH
