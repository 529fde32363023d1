"""Valid and adversarial inputs for the gate, and the limits for executed motions.

The property tests and `benchmarks/gate_values.py` draw from the same generators. They are not in the package:
no user needs them, and a benchmark can add this folder to its path, as pytest does.
"""

import itertools
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from unittest.mock import patch

import msgspec
import numpy as np

from dlokit.communication.wire import codec
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import WORKSPACE
from dlokit.functional.cell.arm import CellArm
from dlokit.functional.cell.setpoints import Follow
from dlokit.functional.cell.world import Cell
from dlokit.functional.robots.gate import GateConfig
from dlokit.geometry import downward
from dlokit.motion.forward_kinematics import tcp_matrices
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.limits import scaled
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import JointTrajectory

KINEMATICS = ArmKinematics(PANDA)
PARTS = ("times_s", "q_rad", "dq_rad_s", "ddq_rad_s2")
POISON = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-308, 0.0, 1.0, -3.0)
BETWEEN = 5.0 / 3.0
"""A cubic piece through samples of a motion needs up to this factor of the motion's acceleration between them."""
LAG_RAD = 0.05
"""Largest deviation of measured joints from their set-points [rad]; 0.02 at the largest acceleration."""


def executed_breach(trajectory: JointTrajectory, config: GateConfig, pieces: int = 10) -> str:
    """Limit that the cell's own set-points, `pieces` per sample, exceed by their differences; empty if none.

    The arm is at rest before and after the trajectory, so a jump at the start or end also counts.
    """
    program, samples = Follow(trajectory, 0.0), trajectory.times_s
    samples = np.concatenate(([samples[0] - samples[1]], samples, [2.0 * samples[-1] - samples[-2]]))
    fine = np.concatenate(
        [*(np.linspace(a, b, pieces, endpoint=False) for a, b in itertools.pairwise(samples)), samples[-1:]]
    )
    q = np.array([program.at(float(t)).q_rad for t in fine])
    sampled = q[::pieces]
    velocity, acceleration, jerk = (
        PANDA.limits.velocity_rad_s,
        PANDA.limits.acceleration_rad_s2,
        PANDA.limits.jerk_rad_s3,
    )
    # Higher differences amplify the rounding of the angles.
    rounding = 64.0 * np.finfo(np.float64).eps * np.abs(q).max() / np.diff(samples).min() ** 3
    checks = (
        ("position", PANDA.limits.position_lower_rad - q, 1e-6),
        ("position", q - PANDA.limits.position_upper_rad, 1e-6),
        ("velocity", divided(fine, q, 1), velocity * (1 + 1e-5)),
        ("acceleration", divided(samples, sampled, 2), acceleration * (1 + 1e-4)),
        ("acceleration between samples", divided(fine, q, 2), BETWEEN * acceleration * (1 + 1e-4) + 1e-2),
        ("jerk", divided(samples, sampled, 3), jerk * (1 + 1e-4) + rounding),
    )
    for what, values, allowed in checks:
        if not np.all((values if what == "position" else np.abs(values)) <= allowed):
            return what
    return tool_breach(trajectory.times_s, trajectory.q_rad, config)


def tool_breach(times_s: Float64Array, q_rad: Float64Array, config: GateConfig) -> str:
    """Whether the tool centre point leaves the box or its speed at times (K,) [s] and angles (K, 7) [rad]."""
    places = tcp_matrices(PANDA, q_rad)[:, :3, 3]
    if not np.all((places >= WORKSPACE.lower_m) & (places <= WORKSPACE.upper_m)):
        return "box"
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(times_s)
    return "" if np.all(speeds <= config.largest_tool_speed_m_s) else "tool speed"


def divided(times_s: Float64Array, q_rad: Float64Array, order: int) -> Float64Array:
    """Divided differences of angles (K, J) [rad] times `order`!: velocity, acceleration or jerk, (K - order, J)."""
    values = q_rad
    for n in range(1, order + 1):
        values = n * np.diff(values, axis=0) / (times_s[n:] - times_s[:-n])[:, None]
    return values


def honest(seed: int) -> JointTrajectory:
    """A planned motion over the table, of a kind that skills plan. Raises `SkillFailure` if planning fails."""
    rng = np.random.default_rng(seed)
    start = _angles(rng)
    kind = rng.integers(4)
    if kind == 0:
        return joint_move(start, _angles(rng), PANDA.limits)
    if kind == 1:
        return joint_move(start, start + rng.normal(size=7) * 10 ** rng.uniform(-6.0, -2.0), PANDA.limits)
    poses = tuple(KINEMATICS.forward(_angles(rng)) for _ in range(kind - 1))
    return tool_move(KINEMATICS, start, poses, VelocityProfile(speed_m_s=10 ** rng.uniform(-1.5, 0.3)))


def _angles(rng: np.random.Generator) -> Float64Array:
    return KINEMATICS.inverse(honest_pose(rng))


def honest_pose(rng: np.random.Generator) -> Pose:
    """A pose over the table, mostly within the arm's reach."""
    place = [rng.uniform(0.35, 0.65), rng.uniform(-0.3, 0.3), rng.uniform(0.011, 0.4)]
    return downward(place, rng.uniform(-0.7, 0.7))


def poisoned(base: JointTrajectory, rng: np.random.Generator) -> JointTrajectory:
    """One to three entries of one array replaced by values that are not finite, or wrong."""
    part = str(rng.choice(PARTS))
    values = getattr(base, part).copy()
    values.reshape(-1)[rng.integers(0, values.size, rng.integers(1, 4))] = rng.choice(POISON)
    return msgspec.structs.replace(base, **{part: values})


def disagreeing(
    base: JointTrajectory, rng: np.random.Generator, part: str = "", size: float = 0.0, how: str = ""
) -> JointTrajectory:
    """One array changed, so that angles, velocities, accelerations and times disagree; random unless given."""
    part = part or str(rng.choice(PARTS))
    size = size or float(10 ** rng.uniform(-6.0, 0.5))
    how = how or str(rng.choice(DISAGREEMENTS))
    values = getattr(base, part)
    half = (np.arange(len(values)) > len(values) // 2).reshape(-1, *(1,) * (values.ndim - 1))
    changed = {
        "factor": values * (1.0 + size),
        "sign": -values,
        "noise": values + size * rng.normal(size=values.shape),
        "shift": values + size,
        "step": values + size * half,
        "zero": np.zeros_like(values),
        "pace": values,
    }[how]
    if how == "pace":
        return scaled(base, 1.0 + size)
    return msgspec.structs.replace(base, **{part: changed})


DISAGREEMENTS = ("factor", "sign", "noise", "shift", "step", "zero", "pace")


def warped(base: JointTrajectory, rng: np.random.Generator) -> JointTrajectory:
    """Valid angles at other times: each step is stretched by its own factor, with or without matching velocities."""
    factors = 10 ** rng.uniform(-1.0, 1.0, len(base.times_s) - 1) ** rng.choice([0.05, 0.3, 1.0])
    times = np.concatenate(([0.0], np.cumsum(np.diff(base.times_s) * factors)))
    dq = base.dq_rad_s
    if rng.random() < 0.5:
        dq = np.gradient(base.q_rad, times, axis=0)
        dq[[0, -1]] = 0.0
    return msgspec.structs.replace(base, times_s=times, dq_rad_s=dq)


def shuffled(base: JointTrajectory, rng: np.random.Generator) -> JointTrajectory:
    """Rows of one array, or of all, in another order, dropped or repeated; or the joints in another order."""
    count = len(base.times_s)
    how = rng.integers(4)
    if how == 0:
        order = rng.permutation(count)
        part = str(rng.choice(PARTS))
        return msgspec.structs.replace(base, **{part: getattr(base, part)[order]})
    if how == 1:
        joints = rng.permutation(7)
        part = str(rng.choice(PARTS[1:]))
        return msgspec.structs.replace(base, **{part: getattr(base, part)[:, joints]})
    # Missing rows make a coarser motion; repeated rows make steps of zero duration.
    order = np.sort(rng.choice(count, max(2, count // int(rng.integers(2, 9))), replace=how == 3))
    chosen = {part: getattr(base, part)[order] for part in PARTS}
    return JointTrajectory(**{**chosen, "times_s": chosen["times_s"] - chosen["times_s"][0]})


def jumping(base: JointTrajectory, rng: np.random.Generator) -> JointTrajectory:
    """A jump of one joint between two samples, or between the start and the first of them."""
    q, row, joint = base.q_rad.copy(), int(rng.integers(0, len(base.times_s))), int(rng.integers(0, 7))
    q[row:, joint] += rng.choice([-1.0, 1.0]) * 10 ** rng.uniform(-7.0, 1.0)
    return msgspec.structs.replace(base, q_rad=q)


def zigzag(base: JointTrajectory, rng: np.random.Generator) -> JointTrajectory:
    """A joint that oscillates between samples, with velocities that hide or show it."""
    times, q = base.times_s, base.q_rad.copy()
    joint, size_rad = int(rng.integers(0, 7)), float(10 ** rng.uniform(-8.0, -1.0))
    sign = np.where(np.arange(len(times)) // int(rng.integers(1, 5)) % 2 == 0, 0.0, 1.0)
    q[:, joint] += size_rad * sign
    dq = base.dq_rad_s if rng.random() < 0.5 else np.gradient(q, times, axis=0)
    return msgspec.structs.replace(base, q_rad=q, dq_rad_s=dq)


def random_numbers(base: JointTrajectory, rng: np.random.Generator) -> JointTrajectory:
    """A few random samples around the home pose."""
    samples = int(rng.integers(2, 13))
    size, step_s = 10 ** rng.uniform(-9.0, 2.0), 10 ** rng.uniform(-6.0, 2.0)
    q, dq, ddq = size * rng.normal(size=(3, samples, 7)) * np.array([1.0, 10.0, 100.0])[:, None, None]
    times = np.concatenate(([0.0], np.cumsum(step_s * rng.uniform(0.1, 1.0, samples - 1))))
    return JointTrajectory(times_s=times, q_rad=PANDA.home_q_rad + q - q[:1], dq_rad_s=dq, ddq_rad_s2=ddq)


def smooth(base: JointTrajectory, rng: np.random.Generator) -> JointTrajectory:
    """A minimum-jerk motion of random joints from anywhere in the range: too fast, outside the box, or neither."""
    lower, upper = PANDA.limits.position_lower_rad, PANDA.limits.position_upper_rad
    start = np.where(rng.random() < 0.5, base.q_rad[0], rng.uniform(lower, upper))
    way = rng.normal(size=7) * 10 ** rng.uniform(-3.0, 0.5) * (rng.random(7) < 0.5)
    duration_s, count = 10 ** rng.uniform(-1.5, 1.0), int(rng.integers(5, 200))
    u = np.linspace(0.0, 1.0, count)[:, None]
    return JointTrajectory(
        times_s=duration_s * u[:, 0],
        q_rad=start + way * u**3 * (10.0 - 15.0 * u + 6.0 * u**2),
        dq_rad_s=way * 30.0 * u**2 * (1.0 - u) ** 2 / duration_s,
        ddq_rad_s2=way * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / duration_s**2,
    )


def wrong_lengths(base: JointTrajectory, rng: np.random.Generator) -> JointTrajectory:
    """One array with rows, joints or axes that the others do not have."""
    part = str(rng.choice(PARTS))
    values = getattr(base, part)
    wrong = (values[:-1], values[:0], values[..., None], values.reshape(-1)[:3], np.float64(0.5) + values[:1].sum())
    return msgspec.structs.replace(base, **{part: np.asarray(wrong[int(rng.integers(len(wrong)))])})


def other_arm(base: JointTrajectory, rng: np.random.Generator) -> JointTrajectory:
    """A well-formed motion of an arm with another number of joints."""
    joints = int(rng.choice([1, 2, 6, 8, 14]))
    return JointTrajectory(
        times_s=base.times_s,
        **{part: np.resize(getattr(base, part), (len(base.times_s), joints)) for part in PARTS[1:]},
    )


def decoded(base: JointTrajectory, rng: np.random.Generator) -> JointTrajectory:
    """Result of decoding values of wrong types or shapes. Raises `CommunicationError` if they are refused."""
    plain: dict[str, Any] = {part: getattr(base, part) for part in PARTS}
    part = str(rng.choice(PARTS))
    wrong: tuple[Any, ...] = (
        *(None, "fast", 7.0, True, [], {}, [[0.0] * 7] * 2, plain[part].tolist()),
        *(plain[part].astype(kind) for kind in (np.float32, np.int64, np.uint8, np.bool_)),
        *(plain[part][None], np.zeros((2, 2, 2, 2, 2)), plain[part][::-1]),
    )
    plain[part] = wrong[int(rng.integers(len(wrong)))]
    if rng.random() < 0.1:
        plain.pop(str(rng.choice(PARTS)))
    return codec.decode(codec.encode(plain), JointTrajectory)


Mutation = Callable[[JointTrajectory, np.random.Generator], JointTrajectory]
MUTATIONS: dict[str, Mutation] = {
    "as planned": lambda base, rng: base,
    "poisoned entries": poisoned,
    "parts that disagree": disagreeing,
    "times warped": warped,
    "rows or joints shuffled": shuffled,
    "jump": jumping,
    "zigzag": zigzag,
    "random numbers": random_numbers,
    "fast, far or outside": smooth,
    "wrong lengths": wrong_lengths,
    "other joints": other_arm,
    "decoded": decoded,
}
"""Modifications of a valid motion, by name. Raises `BadValue` or `CommunicationError` if the value is refused."""


def spoilt_pose(rng: np.random.Generator) -> Pose:
    """A pose as a program without checks would send it: made invalid after its construction."""
    made = downward([0.5, 0.1, 0.1], 0.3)
    values = made.position_m if rng.random() < 0.4 else made.wxyz
    if values is made.wxyz and rng.random() < 0.5:
        values *= rng.choice([0.0, 0.5, 0.99, 1.01, -2.0, 1e-200, 1e200])
    else:
        values[rng.integers(len(values))] = rng.choice([np.nan, np.inf, -np.inf, 1e308, -1e308])
    return made


def remade(value: Any) -> Any:
    """The same Struct, constructed again from its fields. Raises `BadValue` if they are invalid."""
    return type(value)(**msgspec.structs.asdict(value))


def spoilt_profile(rng: np.random.Generator) -> VelocityProfile:
    """A velocity profile of which one value is zero, negative or not finite; set after its construction."""
    profile = VelocityProfile()
    name = str(rng.choice(["speed_m_s", "acceleration_m_s2", "jerk_m_s3"]))
    msgspec.structs.force_setattr(profile, name, float(rng.choice([0.0, -0.25, -1e9, np.nan, np.inf, -np.inf])))
    return profile


@dataclass
class Executed:
    """Set-points and measured joints of every physics step, and the machine's time that the physics took."""

    times_s: list[float] = field(default_factory=list[float])
    commanded: list[Float64Array] = field(default_factory=list[Float64Array])
    measured: list[Float64Array] = field(default_factory=list[Float64Array])
    physics_s: float = 0.0
    used: dict[str, float] = field(default_factory=dict[str, float])
    """Largest fraction of each limit that was used, over all motions."""

    @contextmanager
    def noted(self) -> Generator[None, None, None]:
        """Record the motion of every cell's arm."""
        before_step, step = CellArm.before_step, Cell.step

        def noting(arm: CellArm, time_s: float) -> None:
            before_step(arm, time_s)
            self.times_s.append(time_s)
            self.commanded.append(arm.setpoint(time_s).q_rad)
            self.measured.append(arm.q_rad)

        def timing(cell: Cell, duration_s: float) -> None:
            began_s = time.perf_counter()
            step(cell, duration_s)
            self.physics_s += time.perf_counter() - began_s

        with patch.object(CellArm, "before_step", noting), patch.object(Cell, "step", timing):
            yield

    def forget(self) -> None:
        """Keep only the last steps, so that the next differences continue from them."""
        for rows in (self.times_s, self.commanded, self.measured):
            del rows[:-8]

    def moved(self) -> bool:
        """Whether the set-points changed."""
        return len(self.commanded) > 1 and bool(np.any(np.ptp(np.array(self.commanded), axis=0) > 0.0))

    def breaches(self, config: GateConfig) -> list[str]:
        """Names of the limits that differences of the set-points exceed."""
        if len(self.times_s) < 20:
            return []
        times, q = np.array(self.times_s), np.array(self.commanded)
        limits, measured = PANDA.limits, np.array(self.measured)
        found: list[str] = []
        for what, values, allowed in (
            ("position", np.maximum(limits.position_lower_rad - q, q - limits.position_upper_rad), np.full(7, 1e-6)),
            ("velocity", divided(times, q, 1), limits.velocity_rad_s * (1 + 1e-5)),
            ("acceleration", divided(times, q, 2), BETWEEN * limits.acceleration_rad_s2 * (1 + 1e-4) + 1e-2),
            ("jerk", divided(times, q, 3), limits.jerk_rad_s3 * (1 + 1e-3)),
            ("acceleration at ticks", divided(times[::4], q[::4], 2), limits.acceleration_rad_s2 * (1 + 1e-4)),
            ("jerk at ticks", divided(times[::4], q[::4], 3), limits.jerk_rad_s3 * (1 + 1e-4)),
            ("lag", measured - q, np.full(7, LAG_RAD)),
        ):
            used = (values if what == "position" else np.abs(values)) / allowed
            self.used[what] = max(self.used.get(what, 0.0), float(used.max()))
            if not used.max() <= 1.0:
                row, joint = np.unravel_index(int(np.argmax(used)), used.shape)
                found.append(f"{what} of joint {joint + 1} {used.max():.3f} of its limit, {times[row]:.3f} s")
        ticks = slice(None, None, 4)
        found += [tool] if (tool := tool_breach(times[ticks], q[ticks], config)) else []
        return found
