"""What touches the planning rod beside the table: fingers that hold it, closed fingers that push it, and posts.

Closed fingers are a moving wall with round ends on the table. If a point of the rod is nearer to the middle line of the
wall than the sum of both radii, a stiff one-sided spring pushes it out. The spring is implicit in the rod's step and
so stable. The rod slides freely along the wall: this fits the effect of closed fingers on the simulated cell's rod
better than any friction does.

A post is a capsule about an axis. Each edge of the rod has at most one contact with it, where the two are nearest: a
stiff one-sided spring with critical damping along the line between them, and Coulomb friction across it, regularised by
the speed of the previous step as on the table. Over the head the line points upwards, so a lifted rod passes, and one
that is laid on the head slips off or stays by friction. A post resists no roll of the rod about its axis.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dlokit.description.scene import NO_POSTS
from dlokit.types.arrays import Float64Array


class Contacts(NamedTuple):
    """What touches the rod during a motion; without arguments, nothing does."""

    tool: Float64Array = np.zeros((0, 4))
    """(T, 4 K): x, y, z [m] and yaw [rad] of K tools at every step."""
    pads: Float64Array = np.zeros((0, 4))
    """(n, 4): for each point of the rod between pads, its position in nodes from the first, its offset from its tool
    (along, up) [m], and the number of that tool."""
    fingers: Float64Array = np.zeros(3)
    """(3,): from `rollout.closed_fingers` if the fingers of the first tool push; zeros if they hold."""
    posts: Float64Array = NO_POSTS
    """(P, 8): from `Scene.posts_world`."""


_PUSH_N_M = 800.0  # stiffness of the spring at one point of the rod
_POINTS = 4  # points per edge that are tested for contact


@njit(cache=True, nogil=True, error_model="numpy")
def add_fingers(
    x: Float64Array,
    tool: Float64Array,
    fingers: Float64Array,
    radius: float,
    h: float,
    band: Float64Array,
    right: Float64Array,
) -> None:
    """Add the fingers at `tool` (4,): x, y, z [m], yaw [rad] to one implicit step of length `h` [s].

    `x` (M, 5): the rod as in `advance`; `fingers` (3,) from `rollout.closed_fingers`; `band` and `right`: the matrix
    and the right-hand side of the rod's step.
    """
    reach = fingers[1] + radius
    edge = math.sqrt((x[1, 0] - x[0, 0]) ** 2 + (x[1, 1] - x[0, 1]) ** 2 + (x[1, 2] - x[0, 2]) ** 2)
    far = fingers[0] + reach + 2.0 * edge
    # The middle line is along the tool's y axis, which is on its right-hand side, because the tool points down.
    ax, ay = math.sin(tool[3]), -math.cos(tool[3])
    for i in range(len(x) - 1):
        if (x[i, 0] - tool[0]) ** 2 + (x[i, 1] - tool[1]) ** 2 > far * far:
            continue
        for k in range(_POINTS):
            fraction = (k + 0.5) / _POINTS
            px = (1.0 - fraction) * x[i, 0] + fraction * x[i + 1, 0] - tool[0]
            py = (1.0 - fraction) * x[i, 1] + fraction * x[i + 1, 1] - tool[1]
            pz = (1.0 - fraction) * x[i, 2] + fraction * x[i + 1, 2]
            along = min(max(px * ax + py * ay, -fingers[0]), fingers[0])
            mx, my = px - along * ax, py - along * ay
            distance = math.sqrt(mx * mx + my * my)
            # The fingers do not touch a rod below the tips; exactly on the middle line the direction is undefined.
            if distance < reach and distance > 1e-6 and pz + 0.5 * radius > tool[2] - fingers[2]:
                normal = (mx / distance, my / distance, 0.0)
                stiff, force = h * h * _PUSH_N_M, h * _PUSH_N_M * (reach - distance)
                _add(i, fraction, normal, force, stiff, 0.0, band, right)


CREEP_M_S = 2e-4
"""Speed below which friction is viscous [m/s]."""
_POST_N_M = 2000.0  # stiffness of a post under one edge: as stiff as the rod's edges
# Speed at which a post pushes out a rod that overlaps it, because an estimate is off by millimetres: slow enough that
# the rod does not fly on. It bounds no force.
_PUSHED_OUT_M_S = 0.1
_POINT_M = 1e-6  # shorter lines have no direction


@njit(cache=True, nogil=True, error_model="numpy")
def add_posts(
    x: Float64Array,
    v: Float64Array,
    posts: Float64Array,
    rod: Float64Array,
    h: float,
    band: Float64Array,
    right: Float64Array,
) -> None:
    """Add `posts` (P, 8) from `Scene.posts_world` to one implicit step of length `h` [s].

    `x` (M, 5), `v` (M, 4): the rod as in `advance`; `rod` (9,) as in `simulate_motion`; `band` and `right` as in
    `add_fingers`.
    """
    mass, radius, longest = rod[1], rod[7], 1.5 * rod[0]
    for p in range(len(posts)):
        reach, leans = posts[p, 6] + radius, abs(posts[p, 3] - posts[p, 0]) + abs(posts[p, 4] - posts[p, 1])
        far = reach + leans + 0.5 * longest
        for i in range(len(x) - 1):
            mx = 0.5 * (x[i, 0] + x[i + 1, 0]) - posts[p, 0]
            if abs(mx) > far:
                continue
            my = 0.5 * (x[i, 1] + x[i + 1, 1]) - posts[p, 1]
            if mx * mx + my * my > far * far:
                continue
            fraction, dx, dy, dz = _between(x, i, posts, p)
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            if distance >= reach:
                continue
            depth = reach - distance
            if distance < _POINT_M:  # on the axis both sides are as good
                dx, dy, dz = x[i, 1] - x[i + 1, 1], x[i + 1, 0] - x[i, 0], 0.0
                distance = math.sqrt(dx * dx + dy * dy) + 1e-12
            normal = (dx / distance, dy / distance, dz / distance)
            _add_post(v, i, fraction, normal, depth, posts[p, 7], mass, h, band, right)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_post(
    v: Float64Array,
    i: int,
    fraction: float,
    normal: tuple[float, float, float],
    depth: float,
    friction: float,
    mass: float,
    h: float,
    band: Float64Array,
    right: Float64Array,
) -> None:
    """Add the contact of edge `i` at `fraction` of it with a post that it overlaps by `depth` [m] along `normal`."""
    first, load = 1.0 - fraction, _POST_N_M * depth
    outwards = square = 0.0
    for a in range(3):
        speed = first * v[i, a] + fraction * v[i + 1, a]
        outwards += speed * normal[a]
        square += speed * speed
    along = math.sqrt(max(square - outwards * outwards, 0.0))
    taking_part = mass / (first * first + fraction * fraction)
    damping = max(2.0 * math.sqrt(_POST_N_M * taking_part), load / _PUSHED_OUT_M_S)
    slide = h * friction * load / max(along, CREEP_M_S)
    _add(i, fraction, normal, h * load, h * h * _POST_N_M + h * damping, slide, band, right)


@njit(cache=True, nogil=True, error_model="numpy")
def _between(x: Float64Array, i: int, posts: Float64Array, p: int) -> tuple[float, float, float, float]:
    """Where edge `i` is nearest to a post's axis, as a fraction of the edge, and the vector from the axis to there [m].

    The nearest points of two segments: Ericson, *Real-Time Collision Detection*, 2005, section 5.1.9.
    """
    ex, ey, ez = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1], x[i + 1, 2] - x[i, 2]
    ax, ay, az = posts[p, 3] - posts[p, 0], posts[p, 4] - posts[p, 1], posts[p, 5] - posts[p, 2]
    rx, ry, rz = x[i, 0] - posts[p, 0], x[i, 1] - posts[p, 1], x[i, 2] - posts[p, 2]
    ee, aa, ea = ex * ex + ey * ey + ez * ez, ax * ax + ay * ay + az * az, ex * ax + ey * ay + ez * az
    er, ar = ex * rx + ey * ry + ez * rz, ax * rx + ay * ry + az * rz
    parallel = ee * aa - ea * ea
    fraction = 0.5
    if parallel > _POINT_M * ee * aa:
        fraction = min(max((ea * ar - er * aa) / parallel, 0.0), 1.0)
    height = (ea * fraction + ar) / aa if aa > _POINT_M * _POINT_M else 0.0
    if height < 0.0 or height > 1.0:
        height = min(max(height, 0.0), 1.0)
        fraction = min(max((ea * height - er) / ee, 0.0), 1.0)
    return (
        fraction,
        rx + fraction * ex - height * ax,
        ry + fraction * ey - height * ay,
        rz + fraction * ez - height * az,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _add(
    i: int,
    fraction: float,
    normal: tuple[float, float, float],
    force: float,
    stiff: float,
    slide: float,
    band: Float64Array,
    right: Float64Array,
) -> None:
    """Add a force along `normal` at one point of edge `i` to both of its nodes.

    The matrix gets `stiff` along the normal and `slide` across it.
    """
    row, first, along = 4 * i, 1.0 - fraction, stiff - slide
    mixed = first * fraction
    for a in range(3):
        right[row + a] += first * force * normal[a]
        right[row + 4 + a] += fraction * force * normal[a]
        band[row + a, 0] += first * first * slide
        band[row + 4 + a, 0] += fraction * fraction * slide
        band[row + a, 4] += mixed * slide
        for b in range(a + 1):
            band[row + b, a - b] += first * first * along * normal[b] * normal[a]
            band[row + 4 + b, a - b] += fraction * fraction * along * normal[b] * normal[a]
            band[row + b, 4 + a - b] += mixed * along * normal[b] * normal[a]
            if b < a:
                band[row + a, 4 + b - a] += mixed * along * normal[b] * normal[a]
