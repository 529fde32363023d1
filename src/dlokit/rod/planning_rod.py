"""The planning rod: fast enough for hundreds of rollouts, and insensitive to rounding.

Node i has a position x_i and a roll u_i (its angle times the radius). One implicit Euler step of length h solves

    (M + h C + h² K) v' = M v + h f(x),    x' = x + h v',

with the bending energy EI / (2 l³) Σ |x_{i-1} - 2 x_i + x_{i+1}|² (Bergou et al., *A Quadratic Bending Model for
Inextensible Surfaces*, SGP 2006), whose stiffness grows with the angle at a node as in a discrete elastic rod, twist
GJ / (2 l) Σ (φ_{i+1} - φ_i + m_i)², stiff edges, Rayleigh damping, a stiff table, and Coulomb friction with rolling,
regularised by the speed of the previous step. A round rod rolls: sideways motion meets the rolling resistance, motion
along the rod the sliding friction. The matrix has a band of eight, so a step is one Cholesky sweep over the nodes. The
rod does not collide with itself; the smallest distance of its strands is returned instead.

The reference twist m_i of an edge is the twist from bending in space alone, without a turn about the axis. It is
integrated from ∂m/∂x (Bergou et al., *Discrete Viscous Threads*, SIGGRAPH 2010). A tool that turns a hanging rod thus
turns its end on the table. The reaction of the twist on the bends is omitted: it hardly moves a node of a soft rod.

A plastic rod has a rest curvature κ0 about the vertical. Where the curvature differs from κ0 by more than the yield
curvature, κ0 follows (ideal plasticity). Its effect is a force from the rest curvature and the positions at the start
of the step. Bends out of the plane of the table are elastic.

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

from dlokit.description.dlo import GRAVITY_M_S2
from dlokit.description.scene import NO_POSTS
from dlokit.types.arrays import Float64Array

BAND = 8
STRETCH_N_M = 2000.0
"""Stiffness of an edge [N/m]."""
GRIP_N_M = 2000.0
"""Stiffness of the pads under each of their points [N/m]."""
_TABLE_N_M = 40.0  # stiffness of the table under a node
_PUSH_N_M = 800.0  # stiffness of closed fingers at one point of the rod
_POINTS = 4  # points per edge that are tested for contact with them
_POST_N_M = 2000.0  # stiffness of a post under one edge: as stiff as the rod's edges
# Speed at which a post pushes out a rod that overlaps it, because an estimate is off by millimetres: slow enough that
# the rod does not fly on. It bounds no force.
_PUSHED_OUT_M_S = 0.1
_POINT_M = 1e-6  # shorter lines have no direction
_CREEP_M_S = 2e-4  # speed below which friction is viscous
_NEIGHBOURS_M = 0.06  # parts nearer than this along the rod count as one strand
_NEIGHBOUR_RADII = 4.2  # the same in radii, for a thick rod: half a circle as wide as `rollout.score` calls touching
_UPRIGHT = 0.3  # fraction of an edge's length, seen from above, below which its bend does not count as in-plane
_STIFFENS_TO = 0.75  # sin²(φ / 2) of the turning angle above which a bend stiffens no more: 120°
_FOLDED = 0.1  # 1 + cos φ, below which a node is folded, and its twist is not defined
_LOOK_EVERY = 5  # steps between two checks of the distance of the strands


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


@njit(cache=True, nogil=True, error_model="numpy")
def simulate_motion(
    nodes: Float64Array,
    rod: Float64Array,
    step_s: float,
    rest_steps: int,
    contacts: Contacts,
    end: Float64Array,
) -> float:
    """Simulate one motion of the tool on a rod at `nodes` (M, 3) [m] and write its final nodes to `end` (M, 3).

    `rod` (9,): length of an edge [m], mass of a node [kg], bending EI / l³ and twist GJ / (l r²) [N/m], damping [s],
    friction, rolling resistance over radius, radius [m], yield curvature [1/m] (infinite: it always springs back).
    After the last step of the tools in `contacts` the rod is free for `rest_steps`. Returns the smallest distance
    between two strands [m].
    """
    count = len(nodes)
    x, v = np.zeros((count, 5)), np.zeros((count, 4))
    x[:, :3] = nodes
    nearest = advance(x, v, np.zeros(count), rod, step_s, rest_steps, contacts)
    end[:] = x[:, :3]
    return nearest


@njit(cache=True, nogil=True, error_model="numpy")
def advance(
    x: Float64Array,
    v: Float64Array,
    rest: Float64Array,
    rod: Float64Array,
    step_s: float,
    rest_steps: int,
    contacts: Contacts,
) -> float:
    """Continue in place from `x` (M, 5) [m], `v` (M, 4) [m/s] and the rest curvatures `rest` (M,) [1/m].

    `x`: position and roll of each node, and the reference twist of the edge after it; `v`: the rates of the first four.

    The other arguments and the result are as in `simulate_motion`.
    """
    count, tool, fingers = len(x), contacts.tool, contacts.fingers
    plastic, bend = math.isfinite(rod[8]), np.zeros((count, 3))
    band, right, column = np.zeros((4 * count + BAND, BAND + 1)), np.zeros(4 * count + BAND), np.zeros(BAND + 1)
    nearest = np.inf
    for step in range(len(tool) + rest_steps):
        band[:], right[:] = 0.0, 0.0
        _inertia_and_table(x, v, rod, step_s, band, right)
        if plastic:
            _set(x, rod, rest, bend)
        _elasticity(x, rod, bend, step_s, band, right)
        _edges(x, rod[0], step_s, band, right)
        if len(contacts.posts) > 0:
            _add_posts(x, v, contacts.posts, rod, step_s, band, right)
        if step < len(tool):
            _grip(x, tool[step], contacts.pads, step_s, band, right)
            if fingers[1] > 0.0:
                _add_fingers(x, tool[step], fingers, rod[7], step_s, band, right)
        _solve(band, right, column, 4 * count)
        for i in range(count):
            for a in range(4):
                v[i, a] = right[4 * i + a]
                x[i, a] += step_s * v[i, a]
        carry_twist(x, v, rod, step_s)
        if step % _LOOK_EVERY == 0:
            nearest = min(nearest, _nearest(x, rod[0], rod[7]))
    return nearest


@njit(cache=True, nogil=True, error_model="numpy")
def _inertia_and_table(
    x: Float64Array, v: Float64Array, rod: Float64Array, h: float, band: Float64Array, right: Float64Array
) -> None:
    """Add masses, gravity, and the table with its friction: nodes slide along the rod and roll across it."""
    mass, friction, rolling, radius = rod[1], rod[5], rod[6], rod[7]
    last = len(x) - 1
    for i in range(len(x)):
        row = 4 * i
        for a in range(3):
            band[row + a, 0] = mass
            right[row + a] = mass * v[i, a]
        # A solid cylinder: its inertia about the axis is half the inertia of a ring.
        band[row + 3, 0] = 0.5 * mass
        right[row + 3] = 0.5 * mass * v[i, 3]
        right[row + 2] -= h * mass * GRAVITY_M_S2
        normal = _TABLE_N_M * (radius - x[i, 2])
        if normal <= 0.0:
            continue
        right[row + 2] += h * normal
        band[row + 2, 0] += h * h * _TABLE_N_M + h * math.sqrt(_TABLE_N_M * mass)
        tx = x[min(i + 1, last), 0] - x[max(i - 1, 0), 0]
        ty = x[min(i + 1, last), 1] - x[max(i - 1, 0), 1]
        norm = math.sqrt(tx * tx + ty * ty) + 1e-12
        tx, ty = tx / norm, ty / norm
        along, across = v[i, 0] * tx + v[i, 1] * ty, v[i, 1] * tx - v[i, 0] * ty + v[i, 3]
        speed = math.sqrt(friction**2 * (along**2 + across**2) + (rolling * v[i, 3]) ** 2)
        speed = max(speed, _CREEP_M_S * friction)
        slide, roll = h * normal * friction**2 / speed, h * normal * rolling**2 / speed
        band[row, 0] += slide
        band[row + 1, 0] += slide
        band[row + 3, 0] += slide + roll
        band[row, 3] -= slide * ty
        band[row + 1, 2] += slide * tx


@njit(cache=True, nogil=True, error_model="numpy")
def _set(x: Float64Array, rod: Float64Array, rest: Float64Array, bend: Float64Array) -> None:
    """Move the rest curvature `rest` (M,) [1/m] by the excess over yield; `bend` (M, 3) [m] is the current x'' l²."""
    square = rod[0] * rod[0]
    for i in range(1, len(x) - 1):
        tx, ty = x[i + 1, 0] - x[i - 1, 0], x[i + 1, 1] - x[i - 1, 1]
        norm = math.sqrt(tx * tx + ty * ty)
        bend[i, 0] = bend[i, 1] = 0.0
        if norm < _UPRIGHT * 2.0 * rod[0]:
            continue
        nx, ny = -ty / norm, tx / norm
        curvature = nx * (x[i - 1, 0] - 2.0 * x[i, 0] + x[i + 1, 0]) + ny * (x[i - 1, 1] - 2.0 * x[i, 1] + x[i + 1, 1])
        curvature /= square
        rest[i] = min(max(rest[i], curvature - rod[8]), curvature + rod[8])
        bend[i, 0], bend[i, 1] = square * rest[i] * nx, square * rest[i] * ny


@njit(cache=True, nogil=True, error_model="numpy")
def _elasticity(
    x: Float64Array, rod: Float64Array, bend: Float64Array, h: float, band: Float64Array, right: Float64Array
) -> None:
    """Add bending relative to the rest shape, and twist, with damping as a fraction of the stiffness."""
    twist, implicit, square = rod[3], h * h + h * rod[4], rod[0] * rod[0]
    for i in range(len(x) - 1):
        row, force, gain = 4 * i + 3, h * twist * (x[i + 1, 3] - x[i, 3] + x[i, 4]), implicit * twist
        right[row] += force
        right[row + 4] -= force
        band[row, 0] += gain
        band[row + 4, 0] += gain
        band[row, 4] -= gain
    for i in range(1, len(x) - 1):
        bent = 0.0
        for a in range(3):
            bent += (x[i - 1, a] - 2.0 * x[i, a] + x[i + 1, a]) ** 2
        # With the turning angle φ, |x''| l is 2 sin(φ / 2), and the curvature of a discrete rod times l 2 tan(φ / 2):
        # its moment is larger by 1 / cos⁴(φ / 2).
        cosine_square = 1.0 - min(0.25 * bent / square, _STIFFENS_TO)
        bending = rod[2] / (cosine_square * cosine_square)
        gain = implicit * bending
        for a in range(3):
            row = 4 * (i - 1) + a
            force = h * bending * (x[i - 1, a] - 2.0 * x[i, a] + x[i + 1, a] - bend[i, a])
            right[row] -= force
            right[row + 4] += 2.0 * force
            right[row + 8] -= force
            band[row, 0] += gain
            band[row + 4, 0] += 4.0 * gain
            band[row + 8, 0] += gain
            band[row, 4] -= 2.0 * gain
            band[row + 4, 4] -= 2.0 * gain
            band[row, 8] += gain


@njit(cache=True, nogil=True, error_model="numpy")
def carry_twist(x: Float64Array, v: Float64Array, rod: Float64Array, h: float) -> None:
    """Add the twist of the edges by the motion of the bends: the rate κb · (v_{i+1} - v_{i-1}) / (2 l) at each node.

    Each edge of the node takes half of it.
    """
    length, radius = rod[0], rod[7]
    before, after, rate = np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(1, len(x) - 1):
        along = length * length
        for a in range(3):
            before[a], after[a] = x[i, a] - x[i - 1, a], x[i + 1, a] - x[i, a]
            rate[a] = v[i + 1, a] - v[i - 1, a]
            along += before[a] * after[a]
        turning = (
            rate[0] * (before[1] * after[2] - before[2] * after[1])
            + rate[1] * (before[2] * after[0] - before[0] * after[2])
            + rate[2] * (before[0] * after[1] - before[1] * after[0])
        )
        part = 0.5 * h * radius * turning / (length * max(along, _FOLDED * length * length))
        x[i - 1, 4] += part
        x[i, 4] += part


@njit(cache=True, nogil=True, error_model="numpy")
def _edges(x: Float64Array, length: float, h: float, band: Float64Array, right: Float64Array) -> None:
    """Add stiff edges, with geometric stiffness only if it is positive, so that the matrix stays positive definite."""
    t = np.zeros(3)
    for i in range(len(x) - 1):
        for a in range(3):
            t[a] = x[i + 1, a] - x[i, a]
        now = math.sqrt(t[0] ** 2 + t[1] ** 2 + t[2] ** 2)
        force = h * STRETCH_N_M * (now - length)
        sideways = max(0.0, h * force / now)
        for a in range(3):
            t[a] /= now
        for a in range(3):
            right[4 * i + a] += force * t[a]
            right[4 * i + 4 + a] -= force * t[a]
            for b in range(3):
                value = (h * h * STRETCH_N_M - sideways) * t[a] * t[b]
                if a == b:
                    value += sideways
                if b <= a:
                    band[4 * i + b, a - b] += value
                    band[4 * i + 4 + b, a - b] += value
                band[4 * i + b, 4 + a - b] -= value


@njit(cache=True, nogil=True, error_model="numpy")
def _grip(
    x: Float64Array, tool: Float64Array, pads: Float64Array, h: float, band: Float64Array, right: Float64Array
) -> None:
    """Add springs from each tool to the points between its pads, which also keep the rod from rotating."""
    target = np.zeros(4)
    for k in range(len(pads)):
        at = 4 * int(pads[k, 3])
        cosine, sine = math.cos(tool[at + 3]), math.sin(tool[at + 3])
        i = min(int(pads[k, 0]), len(x) - 2)
        fraction = pads[k, 0] - i
        target[0], target[1] = tool[at] + cosine * pads[k, 1], tool[at + 1] + sine * pads[k, 1]
        target[2] = tool[at + 2] + pads[k, 2]
        for a in range(4):
            row = 4 * i + a
            force = h * GRIP_N_M * (target[a] - (1.0 - fraction) * x[i, a] - fraction * x[i + 1, a])
            gain = h * h * GRIP_N_M
            right[row] += (1.0 - fraction) * force
            right[row + 4] += fraction * force
            band[row, 0] += (1.0 - fraction) ** 2 * gain
            band[row + 4, 0] += fraction**2 * gain
            band[row, 4] += (1.0 - fraction) * fraction * gain


@njit(cache=True, nogil=True, error_model="numpy")
def _add_fingers(
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


@njit(cache=True, nogil=True, error_model="numpy")
def _add_posts(
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
    `_add_fingers`.
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
    slide = h * friction * load / max(along, _CREEP_M_S)
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


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(band: Float64Array, right: Float64Array, column: Float64Array, size: int) -> None:
    """Solve in place by Cholesky; `band[c, d]` is element (c + d, c). Both have `BAND` spare rows, so that all loops
    have fixed lengths."""
    for c in range(size):
        inverse = 1.0 / math.sqrt(band[c, 0])
        value = right[c] * inverse
        band[c, 0], right[c] = inverse, value
        for d in range(1, 9):
            column[d] = band[c, d] * inverse
            band[c, d] = column[d]
            right[c + d] -= column[d] * value
        for e in range(1, 9):
            factor = column[e]
            for d in range(9 - e):
                band[c + e, d] -= factor * column[e + d]
    for c in range(size - 1, -1, -1):
        value = right[c]
        for d in range(1, 9):
            value -= band[c, d] * right[c + d]
        right[c] = value * band[c, 0]


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest(x: Float64Array, length: float, radius: float) -> float:
    """Smallest distance [m] between two nodes that are not on one strand."""
    apart = math.ceil(max(_NEIGHBOURS_M, _NEIGHBOUR_RADII * radius) / length)
    nearest = np.inf
    for i in range(len(x) - apart):
        for j in range(i + apart, len(x)):
            square = (x[i, 0] - x[j, 0]) ** 2 + (x[i, 1] - x[j, 1]) ** 2 + (x[i, 2] - x[j, 2]) ** 2
            nearest = min(nearest, square)
    return math.sqrt(nearest)
