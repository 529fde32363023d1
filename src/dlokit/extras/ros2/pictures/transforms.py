"""The transforms of TF (`tf2_msgs/msg/TFMessage`) as a tree, and the pose of one frame in another."""

import logging
from bisect import bisect_left
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import scipy

from dlokit.errors import HardwareError
from dlokit.functional.cameras.base import JUMP_NS
from dlokit.geometry import compose, inverse, pose
from dlokit.types.pose import Pose

log = logging.getLogger(__name__)

TF, TF_STATIC, TF_KIND = "/tf", "/tf_static", "tf2_msgs/msg/TFMessage"
"""The topics of TF, and their type."""
HELD_NS = 500_000_000
"""A transform counts this long before its first and after its last stamp [ns]: drivers of arms publish at 10 Hz and
more, and a busy machine delays some messages."""
_NEWEST = 2000
"""Stamps of a moving frame that are kept: 2 s of the fastest drivers, at 1 kHz; a picture is decoded sooner."""
_MOST_FRAMES = 10_000
"""Frames that are kept: far more than a lab has, so that names that change from message to message fill no memory."""
_NAMED = 12
"""Frames of a tree that an error names."""

_Values = tuple[float, float, float, float, float, float, float]
"""Position x, y, z [m] and quaternion w, x, y, z of a child in its parent."""


class NoChain(HardwareError):
    """TF does not give the pose of one frame in another at the requested time."""


class NotThen(NoChain):
    """A chain of transforms connects the frames, but not at the requested time."""


class TransformTree:
    """The newest transforms of each frame; for a bag, all of them."""

    def __init__(self, *, keep_all: bool = False) -> None:
        """`keep_all` keeps each transform, as of a bag; otherwise only the newest ones are kept."""
        self._keep_all = keep_all
        self._edges: dict[str, dict[str, _Edge]] = {}  # child, parent
        self._flaws: dict[str, str] = {}

    def add(self, message: Any, *, static: bool) -> None:
        """Add the transforms of a decoded TFMessage; `static` ones hold at every time."""
        for one in message.transforms:
            parent, child = _name(one.header.frame_id), _name(one.child_frame_id)
            flaw = self._flaw(parent, child, values := _values(one.transform))
            if flaw is not None:
                if child not in self._flaws and len(self._flaws) < _MOST_FRAMES:
                    self._flaws[child] = flaw
                    log.warning("left out: %s", flaw)
                continue
            edge = self._edges.setdefault(child, {}).setdefault(parent, _Edge())
            edge.add(_stamp_ns(one.header), values, static=static, keep_all=self._keep_all)

    def _flaw(self, parent: str, child: str, values: _Values) -> str | None:
        if not parent or not child or parent == child:
            return f"TF has a transform from {parent!r} to {child!r}; the two must be different names"
        norm = np.linalg.norm(values[3:])
        if not np.isfinite(values).all() or not 1e-6 < norm < np.inf:
            return f"TF has a transform from {parent!r} to {child!r} whose values {values} are no pose"
        known = self._edges.get(child)
        if known is None and len(self._edges) >= _MOST_FRAMES:
            return f"TF has more than {_MOST_FRAMES} frames; {child!r} is left out"
        # Two are enough to name them.
        return f"{child!r} has more than two parents" if known and parent not in known and len(known) > 1 else None

    def lookup(self, frame: str, child: str, stamp_ns: int) -> Pose:
        """T_frame_child at a time [ns] of ROS: ``p_frame = T @ p_child``.

            Transforms that move are interpolated between the stamps around it. Raises `NoChain` where no chain of
        X
        """
        frame, child = _name(frame), _name(child)
        above, below = self._up(frame), self._up(child)
        common = next((one for one in below if one in above), None)
        if common is None:
            raise NoChain(self._two_trees(frame, above[-1], child, below[-1]))
        return compose(
            inverse(self._down(above[: above.index(common) + 1], stamp_ns)),
            self._down(below[: below.index(common) + 1], stamp_ns),
        )

    def _up(self, frame: str) -> list[str]:
        """A frame, its parent, and so on up to its root."""
        chain = [frame]
        while parents := self._edges.get(chain[-1]):
            if len(parents) > 1:
                raise NoChain(
                    f"the frame {chain[-1]!r} has two parents in TF, {' and '.join(map(repr, parents))}; it must have "
                    "one: end one of their publishers, or name a frame below it"
                )
            (parent,) = parents
            if parent in chain:
                circle = " → ".join(map(repr, [*chain[chain.index(parent) :], parent]))
                raise NoChain(f"the frames of TF form a circle, {circle}; end the publisher of one of these transforms")
            chain.append(parent)
        return chain

    def _down(self, chain: Sequence[str], stamp_ns: int) -> Pose:
        """Pose of the first frame of a chain of parents in the last one."""
        result = pose((0.0, 0.0, 0.0))
        for child, parent in pairwise(chain):
            result = compose(self._edges[child][parent].at(stamp_ns, parent, child), result)
        return result

    def _two_trees(self, frame: str, root: str, child: str, other_root: str) -> str:
        flaws = "".join(f"; {self._flaws[one]}" for one in (root, other_root) if one in self._flaws)
        return (
            f"TF has no chain from {frame!r} to {child!r}: {self._tree_of(frame, root)}, and "
            f"{self._tree_of(child, other_root)}; publish the transform between the two, or give the camera's pose "
            f"with --camera.calibration{flaws}"
        )

    def _tree_of(self, frame: str, root: str) -> str:
        if frame not in self._edges and not any(frame in parents for parents in self._edges.values()):
            return f"{frame!r} is in no transform"
        members = sorted(one for one in self._edges if self._root(one) == root and one != root)
        more = f" and {len(members) - _NAMED} more" if len(members) > _NAMED else ""
        return f"{frame!r} is in the tree of {root!r} ({', '.join([root, *members[:_NAMED]])}{more})"

    def _root(self, frame: str) -> str:
        seen = {frame}
        while parents := self._edges.get(frame):
            frame = next(iter(parents))
            if frame in seen:
                break
            seen.add(frame)
        return frame


class _Edge:
    """The transforms of one child in one parent, in the order of their stamps; a static one is alone."""

    def __init__(self) -> None:
        self._static = False
        self._stamps: list[int] = []
        self._values: list[_Values] = []

    def add(self, stamp_ns: int, values: _Values, *, static: bool, keep_all: bool) -> None:
        stamps, all_values = self._stamps, self._values
        # A clock that was set back makes all that is known the future.
        if static or (not keep_all and stamps and stamp_ns < stamps[-1] - JUMP_NS):
            self._static = static
            stamps.clear()
            all_values.clear()
        elif len(stamps) > 1 and stamp_ns > stamps[-1] and values == all_values[-1] == all_values[-2]:
            stamps[-1] = stamp_ns  # it stands still
            return
        at = bisect_left(stamps, stamp_ns)
        if at < len(stamps) and stamps[at] == stamp_ns:
            all_values[at] = values
            return
        stamps.insert(at, stamp_ns)
        all_values.insert(at, values)
        if not keep_all and len(stamps) > _NEWEST:
            del stamps[0], all_values[0]

    def at(self, stamp_ns: int, parent: str, child: str) -> Pose:
        stamps, values = self._stamps, self._values
        if self._static:
            return _pose(values[0])
        if not stamps[0] - HELD_NS <= stamp_ns <= stamps[-1] + HELD_NS:
            side, gap_ns = ("from", stamps[0] - stamp_ns) if stamp_ns < stamps[0] else ("until", stamp_ns - stamps[-1])
            where = "after" if side == "from" else "before"
            raise NotThen(
                f"TF has the pose of {child!r} in {parent!r} only {side} {gap_ns / 1e9:.1f} s {where} the picture, "
                f"allowed are {HELD_NS / 1e9} s: its publisher has ended, or its clock is not the camera's"
            )
        after = bisect_left(stamps, stamp_ns)
        if after == len(stamps) or after == 0 or stamps[after] == stamp_ns:
            return _pose(values[min(after, len(stamps) - 1)])
        part = (stamp_ns - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
        return _between(values[after - 1], values[after], part)


def difference(first: Pose, second: Pose) -> str:
    """The distance and the angle between two poses, e.g. ``12.0 mm and 0.50°``."""
    between = compose(inverse(first), second)
    angle_rad = 2.0 * np.arctan2(np.linalg.norm(between.wxyz[1:]), abs(float(between.wxyz[0])))
    return f"{np.linalg.norm(between.position_m) * 1e3:.1f} mm and {np.degrees(angle_rad):.2f}°"


def _between(first: _Values, second: _Values, part: float) -> Pose:
    positions = (1.0 - part) * np.array(first[:3]) + part * np.array(second[:3])
    turns = scipy.spatial.transform.Rotation.from_quat([first[3:], second[3:]], scalar_first=True)
    turn = scipy.spatial.transform.Slerp([0.0, 1.0], turns)(part)
    return pose(positions, turn.as_quat(scalar_first=True))


def _pose(values: _Values) -> Pose:
    return pose(values[:3], values[3:])


def _values(transform: Any) -> _Values:
    at, turn = transform.translation, transform.rotation
    return at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z


def _stamp_ns(header: Any) -> int:
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def _name(frame: str) -> str:
    """A frame's name without the slash that ROS 1 put before it."""
    return frame.lstrip("/")
