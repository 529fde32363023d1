"""The robot refuses to strike a fixture before anything moves, and goes over fixtures where it may."""

import numpy as np
import pytest
from robot_bench import KINEMATICS, PROFILE, Bench, on_bench, reason

from dlokit.description.scene import Post, Scene
from dlokit.geometry import downward
from dlokit.skills.robot import api
from dlokit.types.outcome import Failed, Succeeded

ROW = Scene(fixtures=tuple(Post(name=f"post{i}", position_m=(0.4 + 0.03 * i, 0.0, 0.0)) for i in range(6)))
LEFT, RIGHT = (downward([0.5, y, 0.02], 0.0) for y in (0.15, -0.15))
BESIDE = Scene(fixtures=(Post(name="beside", position_m=(0.5, 0.045, 0.0), height_m=0.018),))


def below(bench: Bench) -> float:
    """Height of the tool during the last motion where it is lowest among the posts [m]."""
    (motion,) = bench.arm.followed[-1:]
    tools = np.array([KINEMATICS.forward(q).position_m for q in motion.q_rad])
    return float(tools[np.abs(tools[:, 1]) < 0.02, 2].min())


def test_a_path_into_a_post_is_refused_before_anything_moves() -> None:
    async def scenario(bench: Bench) -> None:
        assert isinstance(await bench.port.call(api.MOVE_TO, LEFT), Succeeded)
        moved = len(bench.arm.followed)
        outcome = await bench.port.call(api.MOVE_LINEAR, RIGHT, PROFILE)
        assert isinstance(outcome, Failed)
        assert outcome.reason == "fixture_collision"
        assert "the fixture post" in outcome.detail
        assert len(bench.arm.followed) == moved

    on_bench(scenario, scene=ROW)


def test_joint_moves_go_over_the_posts_between_start_and_target() -> None:
    async def scenario(bench: Bench) -> None:
        for target in (LEFT, RIGHT, LEFT):
            assert isinstance(await bench.port.call(api.MOVE_TO, target), Succeeded)
            np.testing.assert_allclose(bench.arm.state().T_world_tcp.position_m, target.position_m, atol=1e-4)
            assert len(bench.arm.followed) == 1 or below(bench) > 0.038
        assert isinstance(await bench.port.call(api.HOME), Succeeded)

    on_bench(scenario, scene=ROW)


@pytest.mark.parametrize(("width_m", "expected"), [(0.01, ""), (0.04, "fixture_collision"), (0.1, "bad_width")])
def test_fingers_do_not_open_into_a_post(width_m: float, expected: str) -> None:
    async def scenario(bench: Bench) -> None:
        bench.arm.width_m = 0.0
        assert isinstance(await bench.port.call(api.MOVE_TO, downward([0.5, 0.0, 0.011], 0.0)), Succeeded)
        outcome = await bench.port.call(api.RELEASE, width_m)
        if expected:
            assert reason(outcome) == expected
            assert bench.arm.width_m == 0.0
        else:
            assert isinstance(outcome, Succeeded)

    on_bench(scenario, scene=BESIDE)


def test_a_move_is_checked_with_the_present_width_of_the_fingers() -> None:
    async def scenario(bench: Bench) -> None:
        at = downward([0.5, 0.0, 0.011], 0.0)
        bench.arm.width_m = 0.04
        assert reason(await bench.port.call(api.MOVE_TO, at)) == "fixture_collision"
        assert bench.arm.followed == []
        bench.arm.width_m = 0.0
        assert isinstance(await bench.port.call(api.MOVE_TO, at), Succeeded)

    on_bench(scenario, scene=BESIDE)
