"""Invalid arguments of skills: each call is refused by name, at once, and nothing moves."""

import itertools
import time
import tracemalloc
from typing import Any

import msgspec
import numpy as np
import pytest
from robot_bench import Bench, on_bench, reason

from dlokit.geometry import compose, downward, pose
from dlokit.skills.robot import api
from dlokit.types.action import VelocityProfile
from dlokit.types.outcome import Succeeded
from dlokit.types.pose import Pose

SPOILT = (np.nan, np.inf, -np.inf, 1e308, -1e308)
NO_SPEED = (0.0, -0.25, np.nan, np.inf, -np.inf)
LONGEST_S, MOST_BYTES = 1.0, 256 * 2**20


def spoilt_poses() -> list[Pose]:
    """Poses as a program without checks would send them: made invalid after their construction."""
    poses: list[Pose] = []
    for name, size in (("position_m", 3), ("wxyz", 4)):
        for index, value in itertools.product(range(size), SPOILT):
            spoilt = downward([0.5, 0.1, 0.1], 0.3)
            getattr(spoilt, name)[index] = value
            poses.append(spoilt)
    for factor in (0.0, 0.5, 1.01, 1e-200, 1e200):
        spoilt = downward([0.5, 0.1, 0.1], 0.3)
        spoilt.wxyz[:] *= factor
        poses.append(spoilt)
    return poses


def spoilt_profiles() -> list[VelocityProfile]:
    profiles: list[VelocityProfile] = []
    for name, value in itertools.product(("speed_m_s", "acceleration_m_s2", "jerk_m_s3"), NO_SPEED):
        profile = VelocityProfile()
        msgspec.structs.force_setattr(profile, name, value)
        profiles.append(profile)
    return profiles


GOOD_POSE, GOOD_PROFILE = downward([0.5, 0.1, 0.1], 0.3), VelocityProfile()
FAR_POSES = [downward(place, 0.0) for place in ([1e9, 0.0, 0.1], [0.0, -1e300, 0.1], [0.5, 0.0, 1.5])]
EXTREME = [
    VelocityProfile(speed_m_s=v, acceleration_m_s2=a, jerk_m_s3=j)
    for v, a, j in itertools.product((1e-300, 1e-6, 1e300), repeat=3)
    if min(v, a, j) < 1.0  # the fastest of all profiles runs at the joints' limits
]
CALLS: list[tuple[str, Any, tuple[Any, ...]]] = [
    *(("move_to", api.MOVE_TO, (bad,)) for bad in (*spoilt_poses(), *FAR_POSES)),
    *(("move_linear", api.MOVE_LINEAR, (bad, GOOD_PROFILE)) for bad in (*spoilt_poses(), *FAR_POSES)),
    *(("move_linear", api.MOVE_LINEAR, (GOOD_POSE, profile)) for profile in spoilt_profiles()),
    *(("follow_path", api.FOLLOW_PATH, ((GOOD_POSE, bad), GOOD_PROFILE)) for bad in (*spoilt_poses(), *FAR_POSES)),
    *(("follow_path", api.FOLLOW_PATH, ((GOOD_POSE,), profile)) for profile in (*spoilt_profiles(), *EXTREME)),
    *(
        ("move_joints", api.MOVE_JOINTS, (np.full(size, value),))
        for size, value in ((7, np.nan), (7, np.inf), (7, 1e308), (7, 9.0), (6, 0.0), (8, 0.0), (0, 0.0))
    ),
    *(("grasp", api.GRASP, (force,)) for force in (0.0, -1.0, 71.0, *SPOILT)),
    *(("release", api.RELEASE, (width,)) for width in (-1e-3, 0.081, *SPOILT)),
    *(("renew_lease", api.RENEW_LEASE, ("another", duration)) for duration in (0.0, -1.0, 61.0, *SPOILT)),
]
NAMED = {
    *("bad_arguments", "bad_trajectory", "bad_force", "bad_width", "bad_lease"),
    *("unreachable", "too_slow", "joint_limit"),
}


@pytest.mark.parametrize("name", sorted({name for name, _, _ in CALLS}))
def test_invalid_arguments_are_refused_by_name_at_once(name: str) -> None:
    async def scenario(bench: Bench) -> None:
        for _, skill, arguments in (call for call in CALLS if call[0] == name):
            began = time.process_time()
            outcome = await bench.port.call(skill, *arguments)
            assert time.process_time() - began < LONGEST_S
            assert reason(outcome) in NAMED, (arguments, outcome)
        assert bench.arm.followed == []
        assert bench.arm.width_m == 0.08

    tracemalloc.start()
    try:
        on_bench(scenario)
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    finally:
        tracemalloc.stop()


def test_a_path_with_countless_reversals_is_refused_at_once() -> None:
    async def scenario(bench: Bench) -> None:
        path = tuple(downward([0.5, 0.01 * (-1) ** i, 0.2], 0.0) for i in range(2000))
        began = time.process_time()
        assert reason(await bench.port.call(api.FOLLOW_PATH, path, GOOD_PROFILE)) == "too_slow"
        assert time.process_time() - began < LONGEST_S
        assert isinstance(await bench.port.call(api.FOLLOW_PATH, path[:5], GOOD_PROFILE), Succeeded)

    on_bench(scenario)


@pytest.mark.parametrize("tilt_rad", [0.0, 0.3])
def test_a_path_that_takes_long_to_plan_is_refused_at_once(tilt_rad: float) -> None:
    async def scenario(bench: Bench) -> None:
        tilt = pose([0.0, 0.0, 0.0], [np.cos(tilt_rad / 2), np.sin(tilt_rad / 2), 0.0, 0.0])
        circle = [[0.5 + 0.1 * np.cos(angle), 0.1 * np.sin(angle), 0.3] for angle in np.linspace(0.0, 280.0, 1000)]
        path = tuple(compose(downward(place, 0.0), tilt) for place in circle)
        began = time.process_time()
        assert reason(await bench.port.call(api.FOLLOW_PATH, path, VelocityProfile(speed_m_s=2.0))) == "too_slow"
        assert time.process_time() - began < LONGEST_S
        assert isinstance(await bench.port.call(api.FOLLOW_PATH, path[:50], GOOD_PROFILE), Succeeded)

    on_bench(scenario)
