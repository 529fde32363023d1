"""TF as a tree: chains are products, moving transforms are interpolated, and flaws of the tree are named."""

import numpy as np
import pytest
import ros2_messages as ros
from hypothesis import given, settings
from hypothesis import strategies as st

from dlokit.errors import HardwareError
from dlokit.extras.ros2.pictures.transforms import HELD_NS, NoChain, NotThen, TransformTree, difference
from dlokit.geometry import compose, inverse, matrix, pose
from dlokit.types.pose import Pose

few = settings(max_examples=30, deadline=None, derandomize=True, database=None)
MS = 1_000_000
numbers = st.floats(-3.0, 3.0)
poses = st.builds(
    pose,
    st.tuples(numbers, numbers, numbers),
    st.tuples(numbers, numbers, numbers, numbers).filter(lambda wxyz: np.linalg.norm(wxyz) > 0.1),
)
HERE = pose((0.0, 0.0, 0.0))
AHEAD = pose((1.0, 0.0, 0.0))


def assert_same(one: Pose, other: Pose) -> None:
    np.testing.assert_allclose(matrix(one), matrix(other), atol=1e-9)


def tree_of(*edges: tuple[str, str, Pose]) -> TransformTree:
    tree = TransformTree()
    tree.add(ros.tf(*edges), static=True)
    return tree


@few
@given(chain=st.lists(poses, min_size=1, max_size=5), split=st.integers(0, 5))
def test_a_chain_of_transforms_is_their_product(chain: list[Pose], split: int) -> None:
    tree = tree_of(*((f"f{number}", f"f{number + 1}", T) for number, T in enumerate(chain)))
    begin = min(split, len(chain))
    product = HERE
    for T in chain[begin:]:
        product = compose(product, T)
    assert_same(tree.lookup(f"f{begin}", f"f{len(chain)}", 0), product)
    assert_same(tree.lookup(f"f{len(chain)}", f"f{begin}", 0), inverse(product))


@few
@given(left=poses, right=poses)
def test_two_branches_meet_at_their_common_parent(left: Pose, right: Pose) -> None:
    tree = tree_of(("root", "left", left), ("root", "right", right))
    assert_same(tree.lookup("left", "right", 7), compose(inverse(left), right))


@few
@given(first=poses, second=poses, part=st.floats(0.0, 1.0))
def test_a_moving_transform_is_interpolated_between_its_stamps(first: Pose, second: Pose, part: float) -> None:
    tree = TransformTree()
    for stamp_ns, T in ((100 * MS, second), (0, first)):  # they may arrive in any order
        tree.add(ros.tf(("a", "b", T), stamp_ns=stamp_ns), static=False)
    at_ns = round(part * 100 * MS)
    found = tree.lookup("a", "b", at_ns)
    np.testing.assert_allclose(
        found.position_m, (1 - at_ns / 1e8) * first.position_m + at_ns / 1e8 * second.position_m, atol=1e-9
    )
    # The rotation is a part of the whole one, on the shortest way.
    turned = [2.0 * np.arccos(min(1.0, abs(float(first.wxyz @ other.wxyz)))) for other in (found, second)]
    assert turned[0] == pytest.approx(at_ns / 1e8 * turned[1], abs=1e-6)


def test_a_transform_holds_for_a_while_around_its_stamps() -> None:
    tree = TransformTree()
    for stamp_ns in (10_000 * MS, 10_100 * MS):
        tree.add(ros.tf(("a", "b", AHEAD), stamp_ns=stamp_ns), static=False)
    for at_ns in (10_000 * MS - HELD_NS, 10_100 * MS + HELD_NS):
        assert_same(tree.lookup("a", "b", at_ns), AHEAD)
    with pytest.raises(NotThen, match=r"'b' in 'a' only until 0\.6 s before the picture, allowed are 0\.5 s"):
        tree.lookup("a", "b", 10_700 * MS)
    with pytest.raises(NotThen, match=r"only from 9\.0 s after the picture"):
        tree.lookup("a", "b", 1_000 * MS)


def test_static_transforms_hold_at_every_time() -> None:
    assert_same(tree_of(("a", "b", AHEAD)).lookup("a", "b", 10**18), AHEAD)


def test_the_newest_static_transform_counts() -> None:
    tree = tree_of(("a", "b", HERE))
    tree.add(ros.tf(("a", "b", AHEAD)), static=True)
    assert_same(tree.lookup("a", "b", 0), AHEAD)


def test_slashes_before_names_do_not_count() -> None:
    assert_same(tree_of(("/a", "b", AHEAD)).lookup("a", "/b", 0), AHEAD)


def test_frames_without_a_chain_are_named_with_both_trees() -> None:
    tree = tree_of(("world", "base_link", HERE), ("base_link", "tool", HERE), ("camera_link", "optical", HERE))
    with pytest.raises(HardwareError) as error:
        tree.lookup("base_link", "optical", 0)
    assert "'base_link' is in the tree of 'world' (world, base_link, tool)" in str(error.value)
    assert "'optical' is in the tree of 'camera_link' (camera_link, optical)" in str(error.value)
    with pytest.raises(NoChain, match="'nowhere' is in no transform"):
        tree.lookup("base_link", "nowhere", 0)


def test_a_large_tree_is_named_by_its_first_frames() -> None:
    tree = tree_of(*(("root", f"f{number:02}", HERE) for number in range(30)))
    with pytest.raises(NoChain, match=r"f11 and 18 more\)"):
        tree.lookup("f00", "camera", 0)


def test_a_frame_with_two_parents_is_refused() -> None:
    tree = tree_of(("a", "b", HERE), ("other", "b", HERE), ("b", "c", HERE))
    with pytest.raises(NoChain, match="'b' has two parents in TF, 'a' and 'other'"):
        tree.lookup("a", "c", 0)
    tree.add(ros.tf(("third", "b", HERE)), static=True)  # named as two, and no more are kept
    with pytest.raises(NoChain, match="'a' and 'other';"):
        tree.lookup("a", "c", 0)


def test_a_circle_is_refused() -> None:
    with pytest.raises(NoChain, match="form a circle, 'b' → 'a' → 'c' → 'b'"):
        tree_of(("a", "b", HERE), ("c", "a", HERE), ("b", "c", HERE)).lookup("b", "elsewhere", 0)


def test_a_quaternion_is_normalised() -> None:
    tree = TransformTree()
    tree.add(ros.raw(0.0, 0.0, 0.0, 0.5), static=True)
    assert_same(tree.lookup("a", "b", 0), HERE)


@pytest.mark.parametrize("values", [(0.0, 0.0, 0.0, 0.0), (np.nan, 0.0, 0.0, 1.0), (np.inf, 0.0, 0.0, 1.0)])
def test_a_transform_that_is_no_pose_is_left_out_and_named(values: tuple[float, float, float, float]) -> None:
    tree = TransformTree()
    tree.add(ros.raw(*values), static=True)
    with pytest.raises(NoChain, match=r"'a' to 'b' whose values .* are no pose"):
        tree.lookup("a", "b", 0)


def test_a_transform_to_itself_is_left_out() -> None:
    tree = tree_of(("a", "a", AHEAD), ("a", "b", HERE))
    assert_same(tree.lookup("a", "b", 0), HERE)


def test_memory_is_bounded_but_for_a_bag() -> None:
    live, bag = TransformTree(), TransformTree(keep_all=True)
    for number in range(2100):
        message = ros.tf(("a", "b", pose((float(number), 0.0, 0.0))), stamp_ns=number * MS)
        live.add(message, static=False)
        bag.add(message, static=False)
    begin_ns = 10 * MS
    assert bag.lookup("a", "b", begin_ns).position_m[0] == 10.0
    assert live.lookup("a", "b", begin_ns).position_m[0] == 100.0  # the oldest that is kept, held


def test_a_frame_that_stands_still_keeps_its_first_and_last_stamp() -> None:
    tree = TransformTree()
    for number in range(5000):
        tree.add(ros.tf(("a", "b", AHEAD), stamp_ns=number * MS), static=False)
    for at_ns in (0, 2500 * MS, 4999 * MS):
        assert_same(tree.lookup("a", "b", at_ns), AHEAD)


def test_a_clock_that_is_set_back_replaces_what_is_known() -> None:
    tree = TransformTree()
    tree.add(ros.tf(("a", "b", AHEAD), stamp_ns=10_000 * MS), static=False)
    tree.add(ros.tf(("a", "b", HERE), stamp_ns=9_000 * MS), static=False)
    assert_same(tree.lookup("a", "b", 9_400 * MS), HERE)


def test_too_many_frames_are_left_out() -> None:
    tree = TransformTree()
    tree.add(ros.tf(*(("a", f"f{number}", HERE) for number in range(10_001))), static=True)
    tree.lookup("a", "f9999", 0)
    with pytest.raises(NoChain, match="more than 10000 frames"):
        tree.lookup("a", "f10000", 0)


@few
@given(T=poses, shift=st.floats(0.0, 0.5), angle=st.floats(0.0, 3.0))
def test_the_difference_of_two_poses_is_a_distance_and_an_angle(T: Pose, shift: float, angle: float) -> None:
    other = compose(T, pose((shift, 0.0, 0.0), (np.cos(angle / 2.0), 0.0, np.sin(angle / 2.0), 0.0)))
    distance, turn = difference(T, other).replace("°", "").split(" mm and ")
    assert float(distance) == pytest.approx(shift * 1000.0, abs=0.051)
    assert float(turn) == pytest.approx(np.degrees(angle), abs=0.0051)
