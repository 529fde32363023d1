"""Where the tool lays what it holds: straight, on the usable table, not across what lies, else straight down."""

import math

import numpy as np
import pytest

from dlokit import geometry
from dlokit.decision.steps.put_down import paths_down
from dlokit.description.clearance import clear_of
from dlokit.description.scene import Post
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

REST_M, LENGTH_M = 0.004, 0.5


def hanging(
    lies_xy: Float64Array, height_m: float, yaw_rad: float = 0.0, *, first: bool = False
) -> tuple[Float64Array, Pose]:
    """A DLO that lies along a curve (K, 2) [m] and hangs from a tool straight above its end; the tool."""
    lies = np.column_stack((lies_xy, np.full(len(lies_xy), REST_M)))
    count = math.ceil(height_m / 0.0167)
    up = np.column_stack((np.tile(lies_xy[-1], (count, 1)), np.linspace(REST_M + 0.0167, height_m, count)))
    nodes = np.concatenate((lies, up))
    return nodes[::-1] if first else nodes, geometry.downward(up[-1], yaw_rad)


def along_y(begin_m: float, end_m: float, x_m: float = 0.5) -> Float64Array:
    y = np.arange(begin_m, end_m, math.copysign(0.0167, end_m - begin_m))
    return np.column_stack((np.full(len(y), x_m), y))


@pytest.mark.parametrize("first", [False, True], ids=["last node held", "first node held"])
def test_what_hangs_is_laid_straight_on_from_what_lies(first: bool) -> None:
    nodes, tool = hanging(along_y(-0.25, 0.0), 0.25, first=first)
    (pose,) = paths_down(nodes, tool)[0]
    assert pose.position_m == pytest.approx([0.5, 0.23, REST_M], abs=0.01)


def test_it_is_not_laid_across_what_lies() -> None:
    turned = np.array([[0.5, -0.1], [0.5, 0.0], [0.5, 0.1], [0.55, 0.14], [0.6, 0.1], [0.6, 0.0], [0.56, -0.04]])
    lies = geometry.resample(np.column_stack((turned, np.zeros(len(turned)))), 25)[:, :2]
    nodes, tool = hanging(lies, 0.15)
    laid = [path[0].position_m[:2] for path in paths_down(nodes, tool)[:-2]]
    assert laid
    for end in laid:
        new = np.linspace(lies[-1], end, 20)[4:]
        assert np.linalg.norm(new[:, None] - lies[None, :-3], axis=-1).min() > 0.02


@pytest.mark.parametrize("end_y_m", [-0.2, 0.05, 0.2])
def test_what_hangs_almost_whole_is_laid_along_the_middle_of_the_table_from_the_nearer_side(end_y_m: float) -> None:
    nodes, tool = hanging(along_y(end_y_m - 0.03, end_y_m), 0.47)
    begin, end = next(path for path in paths_down(nodes, tool) if len(path) == 2)
    nearer = math.copysign(1.0, end_y_m)
    assert begin.position_m == pytest.approx([0.525, nearer * LENGTH_M / 2.0, 0.47], abs=0.02)
    assert end.position_m == pytest.approx([0.525, -nearer * LENGTH_M / 2.0, REST_M], abs=0.02)


def test_it_is_laid_beside_a_fixture_and_not_along_the_middle_where_one_stands() -> None:
    nodes, tool = hanging(along_y(-0.25, 0.0), 0.25)
    post = Post(name="A", position_m=(0.51, 0.12, 0.0))
    *around, _ = paths_down(nodes, tool, (post,))  # the last is straight down
    assert around
    for (pose,) in around:  # 30 mm from where the DLO leaves the table, a node beside the point taken here
        assert clear_of(np.array([[0.5, 0.0, REST_M], pose.position_m]), (post,), 0.02)
    assert len(around) < len(paths_down(nodes, tool)) - 1


@pytest.mark.parametrize("length_m", [0.1, 0.3, 0.45])
@pytest.mark.parametrize("heading_deg", range(0, 360, 45))
def test_every_path_ends_on_the_usable_table_at_the_height_of_what_lies(heading_deg: int, length_m: float) -> None:
    along = np.array([math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))])
    nodes, tool = hanging(np.array([0.6, 0.1]) + np.linspace(-0.1, 0.0, 7)[:, None] * along, length_m)
    for path in paths_down(nodes, tool):
        x, y, z = path[-1].position_m
        assert TABLE_X_M[0] < x < TABLE_X_M[1]
        assert TABLE_Y_M[0] < y < TABLE_Y_M[1]
        assert z == pytest.approx(REST_M)


def test_the_hand_turns_with_what_it_holds_and_by_a_quarter_turn_at_most() -> None:
    lies = along_y(-0.2, 0.0)
    nodes, tool = hanging(lies, 0.2)
    nodes[-1] += [0.01, 0.0, 0.0]  # in the hand it points along x, on the table along y
    tool = geometry.downward(nodes[-1], 0.0)
    R = geometry.rotation(paths_down(nodes, tool)[0][0])
    assert math.atan2(R[1, 0], R[0, 0]) == pytest.approx(math.pi / 2.0)


def test_a_dlo_that_is_held_in_its_middle_goes_straight_down() -> None:
    s = np.linspace(-0.25, 0.25, 31)
    nodes = np.column_stack((np.full(31, 0.5), s, REST_M + np.maximum(0.0, 0.06 - np.abs(s))))
    tool = geometry.downward(nodes[15], 0.0)
    ((pose,),) = paths_down(nodes, tool)
    assert pose.position_m == pytest.approx([*nodes[15, :2], REST_M], abs=0.005)


def test_a_tool_that_is_not_at_the_dlo_or_holds_it_on_the_table_is_not_moved() -> None:
    nodes, tool = hanging(along_y(-0.25, 0.0), 0.25)
    assert paths_down(nodes, geometry.lifted(tool, 0.05)) == ()
    flat = np.column_stack((along_y(-0.25, 0.25), np.full(30, REST_M)))
    assert paths_down(flat, geometry.downward(flat[-1], 0.0)) == ()
