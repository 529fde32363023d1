import numpy as np
import pytest

from dlokit.skills.viewer.goal.frames import TURNED_RAD, GoalHandles

STRAIGHT = np.linspace([0.5, -0.25, 0.004], [0.5, 0.25, 0.004], 31)
BENT = STRAIGHT + 0.1 * np.sin(np.linspace(1.0, 4.0, 31))[:, None] * [1.0, 0.0, 0.0]
X_M, Y_M = (0.30, 0.75), (-0.35, 0.35)


@pytest.fixture
def handles() -> GoalHandles:
    return GoalHandles(STRAIGHT, X_M, Y_M)


def test_three_frames_are_at_both_ends_and_the_middle_along_the_rod(handles: GoalHandles) -> None:
    for handle, node in zip(handles.handles, (0, 15, 30), strict=True):
        assert handle.node == node
        np.testing.assert_allclose((handle.x_m, handle.y_m), STRAIGHT[node, :2])
        assert handle.yaw_rad == pytest.approx(np.pi / 2)


def test_frames_follow_the_goal_until_the_first_drag(handles: GoalHandles) -> None:
    assert handles.follow(BENT)
    np.testing.assert_allclose(handles.handles[0].x_m, BENT[0, 0])
    handles.drag(0, 0.4, 0.1, handles.handles[0].yaw_rad)
    assert not handles.follow(STRAIGHT)
    assert (handles.handles[0].x_m, handles.handles[0].y_m) == (0.4, 0.1)


def test_a_released_goal_resets_the_frames(handles: GoalHandles) -> None:
    handles.drag(0, 0.4, 0.1, 2.5)
    handles.follow(BENT)
    handles.release()
    np.testing.assert_allclose(handles.handles[0].x_m, BENT[0, 0])
    assert handles.message(1).frames[0].yaw_rad is None


def test_a_frame_cannot_leave_the_table(handles: GoalHandles) -> None:
    moved = handles.drag(2, 2.0, -3.0, np.pi / 2)
    assert (moved.x_m, moved.y_m) == (X_M[1], Y_M[0])


def test_only_a_frame_that_was_turned_imposes_its_direction(handles: GoalHandles) -> None:
    handles.drag(0, 0.4, 0.1, np.pi / 2 + 0.5 * TURNED_RAD)
    handles.drag(1, 0.5, 0.0, np.pi / 2 + 0.4)
    assert [frame.yaw_rad for frame in handles.message(7).frames] == [None, pytest.approx(np.pi / 2 + 0.4), None]
    assert handles.message(7).stamp_ns == 7


def test_small_turns_add_up_and_a_full_turn_is_no_turn(handles: GoalHandles) -> None:
    for step in (0.6, 1.2):
        handles.drag(0, 0.4, 0.1, np.pi / 2 + step * TURNED_RAD)
    assert handles.handles[0].turned
    handles.drag(1, 0.4, 0.1, np.pi / 2 - 2 * np.pi)
    assert not handles.handles[1].turned


def test_a_turned_frame_can_be_turned_back_finely(handles: GoalHandles) -> None:
    handles.drag(0, 0.4, 0.1, 2.0)
    assert handles.drag(0, 0.4, 0.1, 2.001).yaw_rad == 2.001
