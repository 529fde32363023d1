"""The geometry of a tool path: straight lines through poses, rounded where two of them meet. Pure."""

import itertools
from dataclasses import dataclass

import numpy as np

from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

ROUNDING_M = 0.05
"""Distance before and after a corner at which its rounding starts and ends [m]."""
TURN_LEVER_M = 0.15
"""Path length that a turn by 1 rad counts as [m], so that turning on the spot takes time."""
SHARPEST_COSINE = -0.5
"""At a corner where the path turns by more than 120°, the tool stops; the corner is not rounded."""
SHORTEST_M = 1e-5
"""Shorter lines are dropped [m]."""
_SAME_PLACE_M, _SAME_DIRECTION_RAD = 1e-4, 1e-3
_LONGEST_TURN_RAD = 2.5  # of one line; after more than half a turn it would turn the opposite way
_DOWN_TOLERANCE_RAD = 1e-4


def half_turned(T: Pose) -> Pose:
    """The pose turned by half a turn about its own z axis."""
    w, x, y, z = T.wxyz
    return Pose(position_m=T.position_m, wxyz=np.array([-z, y, -x, w]))


def points_down(T: Pose) -> bool:
    """Whether the tool's z axis points straight down."""
    w, x, y, z = T.wxyz
    # The z axis of a unit quaternion's rotation, written out: this runs for every pose of every path.
    sideways = 2.0 * float(np.hypot(x * z + w * y, y * z - w * x))
    return sideways < _DOWN_TOLERANCE_RAD and float(w * w + z * z) < float(x * x + y * y)


@dataclass(frozen=True)
class ToolPath:
    """Poses (n, at least 2) joined by lines of `lengths_m` (n - 1,); the corners between are rounded."""

    positions_m: Float64Array  # (n, 3) [m]
    turns_wxyz: Float64Array  # (n, 4) unit quaternions
    lengths_m: Float64Array  # (n - 1,) [m]
    ends_m: Float64Array  # (n - 1,) [m] path parameters at which the lines end
    reaches_m: tuple[float, ...]  # (n - 1,) [m] where rounding starts before a pose and ends after it; 0 at the first
    length_m: float
    """Largest path parameter [m]."""
    points_down: bool
    """Whether the gripper points straight down at all poses, and so along the whole path."""

    def pose(self, sigma_m: float) -> Pose:
        """The tool pose at a path parameter from 0 to `length_m` [m]."""
        ends = self.ends_m
        leg = int(np.clip(np.searchsorted(ends, sigma_m), 0, len(ends) - 1))
        for corner in (leg, leg + 1):
            if 0 < corner < len(self.lengths_m):
                reach = self.reaches_m[corner]
                after = sigma_m - (ends[corner - 1] - reach)
                if 0.0 < after < 2 * reach:
                    return self._rounded(corner, reach, after / (2 * reach))
        fraction = (sigma_m - (ends[leg] - self.lengths_m[leg])) / self.lengths_m[leg]
        position, rotation = self._on_leg(leg, float(np.clip(fraction, 0.0, 1.0)))
        return Pose(position_m=position, wxyz=rotation)

    def _on_leg(self, leg: int, fraction: float) -> tuple[Float64Array, Float64Array]:
        a, b = self.positions_m[leg], self.positions_m[leg + 1]
        return a + fraction * (b - a), _between(self.turns_wxyz[leg], self.turns_wxyz[leg + 1], fraction)

    def _rounded(self, corner: int, reach: float, u: float) -> Pose:
        """A quadratic Bézier curve from `reach` before the corner to `reach` after it (De Casteljau)."""
        before = reach / float(self.lengths_m[corner - 1])
        after = reach / float(self.lengths_m[corner])
        p0, r0 = self._on_leg(corner - 1, 1.0 - before * (1.0 - u))
        p1, r1 = self._on_leg(corner, after * u)
        return Pose(position_m=(1.0 - u) * p0 + u * p1, wxyz=_between(r0, r1, u))


def split_at_turns(start: Pose, poses: tuple[Pose, ...]) -> list[ToolPath]:
    """Paths from `start` through `poses`, cut where the tool reverses and so must stop.

    All poses are turned by half a turn if that brings the first nearer to `start`: the gripper is symmetric.
    """
    if not poses:
        return []
    if _x_axis(start) @ _x_axis(poses[0]) < 0.0:
        poses = tuple(half_turned(pose) for pose in poses)
    points = [start]
    for pose in poses:
        if _distance(points[-1], pose) <= SHORTEST_M:
            continue
        if len(points) > 1 and _is_between(points[-2], points[-1], pose):
            points.pop()
        points.append(pose)
    if len(points) < 2:
        return []
    cuts = [0]
    for i in range(1, len(points) - 1):
        before = points[i].position_m - points[i - 1].position_m
        after = points[i + 1].position_m - points[i].position_m
        norm = float(np.linalg.norm(before) * np.linalg.norm(after))
        if norm > 0.0 and float(before @ after) / norm < SHARPEST_COSINE:
            cuts.append(i)
    cuts.append(len(points) - 1)
    return [_path(points[a : b + 1]) for a, b in itertools.pairwise(cuts)]


def _path(points: list[Pose]) -> ToolPath:
    lengths_m = np.array([_distance(a, b) for a, b in itertools.pairwise(points)])
    between = itertools.pairwise(lengths_m.tolist())
    return ToolPath(
        positions_m=np.array([pose.position_m for pose in points]),
        turns_wxyz=np.array([pose.wxyz for pose in points]),
        lengths_m=lengths_m,
        ends_m=np.cumsum(lengths_m),
        reaches_m=(0.0, *(min(ROUNDING_M, 0.5 * before, 0.5 * after) for before, after in between)),
        length_m=float(np.sum(lengths_m)),
        points_down=all(points_down(pose) for pose in points),
    )


def _is_between(a: Pose, b: Pose, c: Pose) -> bool:
    """Whether a straight line from `a` to `c` passes `b`; an unnecessary pose would only make corners tighter."""
    if _turn(a, c) > _LONGEST_TURN_RAD:
        return False
    fraction = _distance(a, b) / max(_distance(a, c), SHORTEST_M)
    if fraction >= 1.0:
        return False
    position = a.position_m + fraction * (c.position_m - a.position_m)
    there = Pose(position_m=position, wxyz=_between(a.wxyz, c.wxyz, fraction))
    return float(np.linalg.norm(position - b.position_m)) < _SAME_PLACE_M and _turn(there, b) < _SAME_DIRECTION_RAD


def _turn(a: Pose, b: Pose) -> float:
    # From the sine: near zero the cosine of a small angle is 1 to rounding.
    apart = min(float(np.linalg.norm(a.wxyz - b.wxyz)), float(np.linalg.norm(a.wxyz + b.wxyz)))
    return 4.0 * float(np.arcsin(min(1.0, apart / 2.0)))


def _distance(a: Pose, b: Pose) -> float:
    return max(float(np.linalg.norm(a.position_m - b.position_m)), TURN_LEVER_M * _turn(a, b))


def _between(a: Float64Array, b: Float64Array, fraction: float) -> Float64Array:
    """A unit quaternion (4,) on the shorter turn from `a` to `b`; Shoemake, SIGGRAPH 1985.

    A path is evaluated pose by pose: `scipy.spatial.transform.Slerp` takes 21 times as long for one pose
    (123 instead of 6 µs), and 11 times as long if the object is kept from pose to pose.
    """
    cosine = float(a @ b)
    nearer = b if cosine >= 0.0 else -b
    angle = np.arccos(min(1.0, abs(cosine)))
    if angle < 1e-6:
        return a
    mixed = (np.sin((1.0 - fraction) * angle) * a + np.sin(fraction * angle) * nearer) / np.sin(angle)
    return mixed / np.linalg.norm(mixed)


def _x_axis(T: Pose) -> Float64Array:
    w, x, y, z = T.wxyz
    return np.array([w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)])
