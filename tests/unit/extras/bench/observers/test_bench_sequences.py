"""The bench's own sequences: reproducible, with rods of constant length and hands of the requested speed."""

import functools

import numpy as np
import pytest

from dlokit.description.default_cameras import default_calibration
from dlokit.errors import ConfigError
from dlokit.extras.bench.observers.cases import CASES
from dlokit.extras.bench.observers.clouds import camera_of
from dlokit.extras.bench.observers.sequence import Sequence
from dlokit.extras.bench.observers.simulated import RATE_HZ, SPEED_M_S, Motion, simulate

MOTIONS: tuple[Motion, ...] = ("two hands", "pick and place", "swing", "crossing")


@functools.cache
def _played(motion: Motion, frames: int = 40, pace: float = 1.0) -> Sequence:
    return simulate(motion, 0, frames=frames, pace=pace)


def _hand_speed_m_s(sequence: Sequence) -> float:
    assert sequence.pins_world is not None
    return float(np.nanmax(np.linalg.norm(np.diff(sequence.pins_world, axis=0), axis=2)) * sequence.rate_hz)


def test_the_same_seed_gives_the_same_sequence_and_another_gives_another() -> None:
    a, b = simulate("two hands", 3, frames=10), simulate("two hands", 3, frames=10)
    assert np.array_equal(a.nodes_world, b.nodes_world)
    assert not np.allclose(a.nodes_world, simulate("two hands", 4, frames=10).nodes_world)


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_rod_keeps_its_length(motion: Motion) -> None:
    nodes = _played(motion).nodes_world
    lengths = np.linalg.norm(np.diff(nodes, axis=1), axis=2).sum(axis=1)
    assert lengths == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize("motion", MOTIONS)
def test_all_of_the_rod_stays_in_view_of_the_papers_camera(motion: Motion) -> None:
    camera = camera_of(_played(motion))
    assert camera is not None
    assert (camera.width_px, camera.height_px) == (default_calibration().width_px, default_calibration().height_px)


def test_hands_move_at_full_speed() -> None:
    # Frames are 40 ms apart: the mean over one is a little below the peak.
    assert _hand_speed_m_s(_played("two hands", frames=100)) == pytest.approx(SPEED_M_S, rel=0.05)
    assert _hand_speed_m_s(_played("pick and place")) == pytest.approx(SPEED_M_S, rel=0.05)


def test_a_slow_sequence_is_the_same_motion_at_a_quarter_of_the_speed() -> None:
    full, slow = _played("two hands"), _played("two hands", frames=80, pace=0.25)
    assert full.pins_world is not None
    assert slow.pins_world is not None
    # The hands have the positions of a quarter of the time; the rod between them may differ.
    assert slow.pins_world[::4] == pytest.approx(full.pins_world[:20], abs=1e-9)


def test_the_swing_reaches_its_speed() -> None:
    nodes = _played("swing").nodes_world
    speed = np.linalg.norm(np.diff(nodes, axis=0), axis=2).max() * RATE_HZ
    assert speed == pytest.approx(1.0, rel=0.12)  # [m/s]


def test_the_crossing_crosses() -> None:
    nodes = _played("crossing").nodes_world[-1]
    a, b = nodes[:-1, :2], nodes[1:, :2]
    left = (
        np.sign(_cross(b[None] - a[None], a[:, None] - a[None])),
        np.sign(_cross(b[None] - a[None], b[:, None] - a[None])),
    )
    separated = left[0] * left[1] < 0  # [i, j]: edge i's ends lie on either side of the line through edge j
    apart = np.abs(np.subtract.outer(np.arange(len(a)), np.arange(len(a)))) > 5
    assert np.any(separated & separated.T & apart)


def test_pick_and_place_releases_between_grasps() -> None:
    pins = _played("pick and place").pins_world
    assert pins is not None
    held = np.isfinite(pins[:, :, 0]).any(axis=1)
    assert held.any()
    assert not held.all()


def test_an_invalid_sequence_is_refused() -> None:
    with pytest.raises(ConfigError, match="frames 1"):
        simulate("swing", 0, frames=1)
    with pytest.raises(ConfigError, match="pace 2"):
        simulate("swing", 0, frames=10, pace=2.0)


def test_the_cases_change_one_factor_of_the_base_at_a_time() -> None:
    base = CASES[0]
    assert base.conditions.hidden == 0.3
    assert len({case.name for case in CASES}) == len(CASES)
    for case in CASES[1:]:
        changed = [name for name in ("motion", "pace") if getattr(case, name) != getattr(base, name)]
        changed += [
            name
            for name in ("hidden", "place", "noise_m", "outliers", "points", "dark_s", "camera_error_m")
            if getattr(case.conditions, name) != getattr(base.conditions, name)
        ]
        assert len(changed) == 1, case.name


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
