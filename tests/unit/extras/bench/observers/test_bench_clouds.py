"""Simulated clouds: noise along the view ray, and the requested hidden fraction, by exact view rays."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from dlokit.description.default_cameras import default_calibration
from dlokit.description.shapes import builtin_shape
from dlokit.extras.bench.observers.clouds import NOISE_DEPTH_M, Looks, ObserverFrame, camera_of, stereo_cloud
from dlokit.extras.bench.observers.conditions import (
    Ball,
    Conditions,
    Place,
    ball_hiding,
    behind_itself,
    dark_frames,
    depth_image,
    depths_m,
    hides,
    long_enough,
)
from dlokit.extras.bench.observers.sequence import Sequence
from dlokit.geometry import pose
from dlokit.skills.observer.visibility import shaded
from dlokit.types.image import CameraCalibration

CAMERA = default_calibration()
EYE = CAMERA.T_world_camera.position_m
CLEAN = Conditions(hidden=0.0, noise_m=0.0, outliers=0.0)


def _sequence(frames: int = 2) -> Sequence:
    nodes = builtin_shape("S", 0.5, 50)
    return Sequence(
        name="still",
        rate_hz=25.0,
        nodes_world=np.broadcast_to(nodes, (frames, *nodes.shape)).copy(),
        radius_m=0.004,
        pin_nodes=(0,),
        pins_world=np.concatenate([nodes[None, :1], np.full((frames - 1, 1, 3), np.nan)]),
        T_world_camera=CAMERA.T_world_camera,
    )


def _camera_above(place_world: np.ndarray) -> CameraCalibration:
    """The rig 1 m above a place, looking straight down."""
    above = pose(place_world + np.array([0.0, 0.0, 1.0]), [0.0, 1.0, 0.0, 0.0])
    return msgspec.structs.replace(CAMERA, T_world_camera=above)


def _look(conditions: Conditions, seed: int = 0) -> ObserverFrame:
    return Looks(_sequence(), conditions, seed)[0]


def _cloud(noise_m: float) -> np.ndarray:
    line = builtin_shape("I", 0.5, 401)
    conditions = replace(CLEAN, noise_m=noise_m, points=4000)
    # The same random numbers: point i with noise is the shifted point i without.
    return stereo_cloud(line, np.ones(401, dtype=np.bool_), 0.004, conditions, CAMERA, np.random.default_rng(3))


def test_noise_moves_points_along_their_view_rays_alone() -> None:
    clean, noisy = _cloud(0.0), _cloud(0.002)
    rays = (clean - EYE) / np.linalg.norm(clean - EYE, axis=1, keepdims=True)
    off = noisy - clean
    across = off - np.sum(off * rays, axis=1, keepdims=True) * rays
    assert np.abs(off).max() > 0.002
    assert np.abs(across).max() < 1e-12


def test_noise_is_as_asked_at_the_reference_depth_and_grows_with_the_square_of_depth() -> None:
    clean, noisy = _cloud(0.0), _cloud(0.002)
    depth = depths_m(clean, CAMERA)
    normalised = (depths_m(noisy, CAMERA) - depth) * (NOISE_DEPTH_M / depth) ** 2
    # 4000 samples: the standard error of a standard deviation is 1.1 %; four of them.
    assert np.std(normalised) == pytest.approx(0.002, rel=0.045)
    far = depth > np.median(depth)
    assert np.std(normalised[far]) == pytest.approx(np.std(normalised[~far]), rel=0.1)


def test_without_noise_points_lie_within_a_radius_of_the_centre_line() -> None:
    line = builtin_shape("I", 0.5, 401)
    distance = np.linalg.norm(_cloud(0.0)[:, None, :] - line[None, ::4, :], axis=2).min(axis=1)
    # Perception shifts the surface by one radius: at the rim, a point is off by r sideways and r in depth.
    assert distance.max() < np.sqrt(2.0) * 0.004 + 0.001


@pytest.mark.parametrize("place", ["middle", "tip", "moving"])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_the_hidden_fraction_is_the_requested_one(place: Place, share: float) -> None:
    look = _look(Conditions(hidden=share, place=place))
    # 50 nodes are 2 % each; a bend of the rod disappears behind the ball's edge a few nodes at once.
    assert np.mean(~look.visible) == pytest.approx(share, abs=0.06)
    assert len(look.seen.points_world) == pytest.approx(1000 * (1.0 - share), abs=60)


def test_the_hidden_part_is_at_the_requested_place() -> None:
    assert not _look(Conditions(place="middle")).visible[25]
    assert not _look(Conditions(place="tip")).visible[0]
    moving = Looks(replace(_sequence(26), pins_world=None, pin_nodes=()), Conditions(place="moving"), 0)
    assert not moving[0].visible[0]
    assert not moving[-1].visible[-1], "after half a period of 2 s, at 25 Hz"


def test_no_point_shows_what_a_ball_hides() -> None:
    look = _look(Conditions(hidden=0.5, noise_m=0.0, outliers=0.0))
    points = np.asarray(look.seen.points_world, dtype=np.float64)
    hidden = _sequence().nodes_world[0][~look.visible][2:-2]  # the outermost have visible points at one edge length
    assert np.linalg.norm(points[None] - hidden[:, None], axis=2).min() > 0.005


def test_a_ball_hides_only_points_behind_it() -> None:
    ball = Ball(centre_world=np.array([0.0, 0.0, 1.0]), radius_m=0.1)
    positions = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 0.5], [0.19, 0.0, 2.0], [0.21, 0.0, 2.0]])
    # A ray that touches the ball leaves the axis by asin(0.1): 0.201 m at 2 m.
    assert hides(ball, np.zeros(3), positions).tolist() == [True, False, True, False]


def test_the_depth_image_shows_the_observer_what_the_ball_hides() -> None:
    look = _look(Conditions(hidden=0.5))
    known = shaded(_sequence().nodes_world[0], look.seen)
    # Cells of 8 pixels and one around: up to 16 px, 2.6 cm, at each edge of the shadow, which the rod leaves aslant.
    assert np.all(known[~look.visible])
    assert np.count_nonzero(known & look.visible) <= 10


def test_the_depth_image_shows_the_nearest_point_of_the_ball() -> None:
    line = builtin_shape("S", 0.5, 401)
    ball = ball_hiding(0.3, line[200], line, EYE)
    depth = depth_image(ball, CAMERA).depth_m
    nearest = depths_m(ball.centre_world[None], CAMERA)[0] - ball.radius_m
    # Seen at an angle, the nearest ray is slightly off the axis; cells are coarse.
    assert depth.min() == pytest.approx(nearest, abs=0.005)
    assert np.isinf(depth).any()


def test_outliers_are_the_requested_fraction() -> None:
    points = np.asarray(_look(Conditions(hidden=0.0, noise_m=0.0, outliers=0.2)).seen.points_world, dtype=np.float64)
    line = builtin_shape("S", 0.5, 401)
    stray = np.linalg.norm(points[:, None] - line[None], axis=2).min(axis=1) > 0.008
    # A few of them fall within 8 mm of the rod by chance: less than 1 % of the box's volume.
    assert np.mean(stray) == pytest.approx(0.2, abs=0.005)


def test_nothing_is_seen_in_the_dark() -> None:
    seen = Looks(_sequence(12), Conditions(dark_s=0.12), 0)
    assert [frame for frame, look in enumerate(seen) if look.dark] == [3, 4, 5]
    assert len(seen[4].seen.points_world) == 0
    assert not seen[4].visible.any()
    assert len(seen[6].seen.points_world) > 0


def test_the_dark_period_has_the_requested_length_and_position() -> None:
    dark = dark_frames(Conditions(dark_s=1.0), 100, 25.0)
    assert (dark.start, len(dark), 100 - dark.stop) == (25, 25, 50)
    assert long_enough(Conditions(dark_s=1.0), 50, 25.0), "the quick run"
    assert not long_enough(Conditions(dark_s=1.0), 38, 25.0), "a track may take 10 frames to recover"
    assert long_enough(Conditions(), 2, 25.0)


def _crossing_line(gap_m: float) -> np.ndarray:
    """Half a turn of a helix around a ring, which returns `gap_m` above its start."""
    angle = np.linspace(-0.3, 2.0 * np.pi + 0.3, 401)
    height = 0.3 + gap_m * np.clip((angle - np.pi) / 2.0, 0.0, 1.0)
    return np.column_stack([0.5 + 0.08 * np.cos(angle), 0.05 * np.sin(2.0 * angle), height])


def test_a_rod_hides_the_part_that_lies_under_its_crossing() -> None:
    line = _crossing_line(0.02)
    above = _camera_above(line.mean(axis=0))
    hidden = behind_itself(line, 0.004, above)
    apart = np.linalg.norm(line[hidden][:, None, :2] - line[None, ~hidden, :2], axis=2).min(axis=1)
    assert hidden.any()
    assert np.all(line[hidden, 2] < 0.32 - 0.01), "the lower part is hidden, never the upper"
    assert np.all(apart < 0.0075), "only where it crosses: within a radius and the steps of the line"


def test_a_rod_that_does_not_cross_itself_in_the_picture_hides_nothing() -> None:
    line = builtin_shape("S", 0.5, 401)
    assert not behind_itself(line, 0.004, CAMERA).any()


def test_parts_that_cross_at_one_depth_do_not_hide_one_another() -> None:
    line = _crossing_line(0.001)
    assert not behind_itself(line, 0.004, _camera_above(line.mean(axis=0))).any()


def test_a_node_under_a_crossing_is_not_visible_and_has_no_points() -> None:
    nodes = _crossing_line(0.05)[::8]
    sequence = replace(
        _sequence(2),
        nodes_world=np.array([nodes, nodes]),
        pins_world=None,
        pin_nodes=(),
        T_world_camera=_camera_above(nodes.mean(axis=0)).T_world_camera,
    )
    look = Looks(sequence, CLEAN, 0)[0]
    assert 1 <= np.count_nonzero(~look.visible) <= 6
    points = np.asarray(look.seen.points_world, dtype=np.float64)
    middle = nodes[~look.visible].mean(axis=0)
    assert np.linalg.norm(points - middle, axis=1).min() > 0.004


def test_an_error_of_the_camera_pose_displaces_all_points_rigidly() -> None:
    off = replace(CLEAN, camera_error_m=0.003, camera_error_rad=float(np.deg2rad(0.3)))
    right, wrong = _look(CLEAN).seen, _look(off).seen
    a, b = (np.asarray(seen.points_world, dtype=np.float64) for seen in (right, wrong))
    far = np.linalg.norm(a - b, axis=1)
    # 3 mm, and 0.3° at 1.3 m, in any direction; clouds are in single precision.
    assert 0.0005 < far.mean() < 0.003 + 0.0053 * 1.4
    assert np.linalg.norm(a[0] - a, axis=1) == pytest.approx(np.linalg.norm(b[0] - b, axis=1), abs=1e-6)
    assert wrong.calibration is not None
    shift = wrong.calibration.T_world_camera.position_m - EYE
    assert np.linalg.norm(shift) == pytest.approx(0.003), "the observer is told the camera that is believed"
    again = Looks(_sequence(), off, 0)[1].seen.calibration
    assert again is not None
    assert np.array_equal(again.T_world_camera.position_m, wrong.calibration.T_world_camera.position_m)


def test_the_same_seed_gives_the_same_clouds_and_another_gives_others() -> None:
    a, b, c = (_look(Conditions(), seed).seen.points_world for seed in (0, 0, 1))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


def test_pins_are_known_only_while_a_hand_holds() -> None:
    first, second = Looks(_sequence(), CLEAN, 0)
    assert [pin.node for pin in first.pins] == [0]
    assert second.pins == ()
    assert first.seen.pins == (), "the unpinned rows do not get them"


def test_a_frame_is_the_same_in_any_order_and_on_repetition() -> None:
    once, again = Looks(_sequence(), Conditions(), 0), Looks(_sequence(), Conditions(), 0)
    later = again[1].seen.points_world
    assert np.array_equal(once[0].seen.points_world, again[0].seen.points_world)
    assert np.array_equal(once[1].seen.points_world, later)
    assert len(once) == len(list(once)) == 2


def test_a_long_sequence_is_not_kept_in_memory() -> None:
    seen = Looks(_sequence(500), Conditions(), 0)
    assert seen[3] is seen[3], "the first frames are made once for all methods"
    assert seen[499] is not seen[499], "later ones are made anew"
    assert np.array_equal(seen[499].seen.points_world, seen[499].seen.points_world)


def test_the_image_is_as_large_as_the_sequence_needs() -> None:
    sequence = _sequence()
    wide = replace(sequence, nodes_world=sequence.nodes_world * [1.0, 4.0, 1.0])
    camera = camera_of(wide)
    assert camera is not None
    assert camera.width_px >= CAMERA.width_px
    look = Looks(wide, CLEAN, 0)[0]
    assert not shaded(wide.nodes_world[0], look.seen).any()
