import numpy as np
import pytest

from dlokit import geometry
from dlokit.errors import ConfigError
from dlokit.skills.perception.releases import Release
from dlokit.skills.perception.shift import Offset, Shift, ShiftConfig, offset_after_release
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

CONFIG = ShiftConfig()
OFF_M = np.array([0.003, -0.002, 0.0])


def tool(yaw_rad: float) -> Pose:
    return geometry.downward([0.5, 0.1, 0.011], yaw_rad)


def cloud(T_world_tcp: Pose, *, seed: int = 0) -> Float64Array:
    """Points of a rod that lies where the tool let it go, seen off by `OFF_M`, with 1 mm of noise."""
    rng = np.random.default_rng(seed)
    along = np.linspace(-0.1, 0.1, 80)
    points_tcp = np.column_stack([along, 2.0 * along**2, np.full(80, 0.007)]) + rng.normal(0.0, 0.001, (80, 3))
    return geometry.transform(T_world_tcp, points_tcp) + OFF_M


def measured(yaw_rad: float, *, lifted: bool = False) -> Offset:
    found = offset_after_release(cloud(tool(yaw_rad)), Release(tool(yaw_rad), lifted), CONFIG)
    assert found is not None
    return found


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, 2.0])
def test_the_rod_is_measured_across_the_fingers_that_let_it_go(yaw_rad: float):
    found = measured(yaw_rad)
    # The mean of about 16 points of 1 mm noise, and of the bend beside the fingers, is good to 0.7 mm.
    assert abs(found.offset_m - found.across_world @ OFF_M[:2]) < 0.0007


def test_a_stray_stretch_beside_the_place_moves_the_measurement_little():
    T = tool(0.4)
    strays = geometry.transform(T, np.column_stack([np.linspace(-0.02, 0.02, 5), np.full(5, 0.02), np.full(5, 0.007)]))
    found = offset_after_release(np.vstack([cloud(T), strays + OFF_M]), Release(T, lifted=False), CONFIG)
    assert found is not None
    assert abs(found.offset_m - measured(0.4).offset_m) < 0.001  # a plain mean would move by 4 mm


def test_too_few_points_and_a_heap_of_rod_say_nothing():
    T = tool(0.0)
    rng = np.random.default_rng(0)
    heap = geometry.transform(T, np.column_stack([rng.uniform(-0.02, 0.02, (60, 2)), np.full(60, 0.007)]))
    assert offset_after_release(cloud(T)[::20], Release(T, lifted=False), CONFIG) is None
    assert offset_after_release(heap, Release(T, lifted=False), CONFIG) is None


def test_a_rod_that_hung_from_the_fingers_is_trusted_less():
    assert measured(0.0, lifted=True).sigma_m > measured(0.0).sigma_m


def test_releases_at_two_yaws_tell_the_shift_and_one_tells_it_across_the_fingers_only():
    unknown = Shift.unknown(CONFIG)
    once = unknown.after(measured(0.0), CONFIG.gate)  # across is along y
    assert abs(once.mean_m[0]) < 1e-9
    assert once.covariance_m2[0, 0] == pytest.approx(CONFIG.prior_m**2)

    found = measured(np.pi / 2)
    left = Offset(found.across_world, found.offset_m - float(found.across_world @ once.mean_m), found.sigma_m)
    twice = once.after(left, CONFIG.gate)
    assert np.abs(twice.mean_m - OFF_M[:2]).max() < 0.001  # noise as above, and the prior's pull of 8 %


def test_a_slip_is_not_believed():
    unknown = Shift.unknown(CONFIG)
    slipped = Offset(np.array([1.0, 0.0]), 0.02, CONFIG.noise_m)
    assert unknown.after(slipped, CONFIG.gate) is unknown


def test_the_corrected_pose_brings_seen_points_to_where_they_are():
    camera = geometry.downward([0.5, 0.0, 1.2], 0.0)
    shift = Shift(OFF_M[:2], np.eye(2))
    assert np.allclose(shift.corrected(camera).position_m, camera.position_m - OFF_M)


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(ConfigError, match=r"shift\.noise_m"):
        ShiftConfig(noise_m=0.0)
