"""An arm from files: a robot description (URDF or MJCF), and a small TOML file with the data that it lacks.

MuJoCo reads the description: the links' frames, inertias and meshes; capsules are fitted to the meshes. The TOML names
the description and adds home, limits of acceleration and jerk, and the gripper (`ur5e.toml` is an example).
"""

import itertools
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import chain
from pathlib import Path
from typing import Any

import msgspec
import mujoco
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from dlokit.description.arm.fitting import capsules_around
from dlokit.description.arm.model import (
    FINGER_LINKS,
    HAND,
    ArmModel,
    Capsule,
    Gripper,
    Inertia,
    Joint,
    Surface,
    Vector,
    package_folder,
)
from dlokit.description.arm.mujoco_model import add_arm
from dlokit.description.arm.urdf import Urdf, read_urdf
from dlokit.errors import ConfigError
from dlokit.geometry import homogeneous
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointLimits

_STIFFNESS_1_RAD = 50.0
"""Stiffness of a simulated joint over its largest torque [1/rad]: at its largest torque a joint deflects by 1.1°."""
_ONE_TURN_RAD = 2.0 * np.pi
_APART = 3
"""Links at least this many joints apart may collide; nearer ones overlap at their joints."""
_BASE_KG = 1.0  # the base does not move
_FAR_M = 1.0  # farther apart, links need not be measured
_PIECE_M = 0.02  # longest edge of the triangles whose corners sample a surface
_LARGEST_M = 3.0  # of a link, and from joint to joint: larger ones are in millimetres
_SMALLEST_M = 0.003  # radius of a link: smaller ones are scaled twice


class _GripperPart(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """The fields of `Gripper`, its mass [kg], and its shape."""

    title: str
    finger_m: float
    tcp_m: float
    tip_below_tcp_m: float
    pad_half_length_m: float
    pad_half_thickness_m: float
    open_width_m: float
    force_n: float
    finger_speed_m_s: float
    mass_kg: float
    closed_half_width_m: float | None = None
    tip_drop: list[tuple[float, float]] = []
    body: list[tuple[float, float, float, float, float, float, float]]
    """Capsules around the body in the hand's frame: both ends and the radius [m]."""
    finger: list[tuple[float, float, float, float, float, float, float]]
    """Capsules around a finger in its own frame."""


class _FlangePart(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    position_m: Vector = (0.0, 0.0, 0.0)
    rpy_rad: Vector = (0.0, 0.0, 0.0)


class _ArmPart(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    title: str
    description: str
    home_q_rad: list[float]
    acceleration_rad_s2: list[float]
    jerk_rad_s3: list[float]
    gripper: _GripperPart
    package: str = ""
    wheel: str = ""
    position_lower_rad: list[float] | None = None
    position_upper_rad: list[float] | None = None
    velocity_rad_s: list[float] | None = None
    torque_nm: list[float] | None = None
    flange: _FlangePart = msgspec.field(default_factory=_FlangePart)


@dataclass(frozen=True)
class _Link:
    """A link of the description, its frame turned so that z is the joint's axis."""

    name: str
    body: int
    T_body_link: Float64Array  # (4, 4)


def read_arm(path: Path, name: str) -> ArmModel:
    """The arm of a TOML file. Raises `ConfigError` on an invalid file, `MachineError` when a package is missing."""
    part = _read_toml(path)
    description = _description(part, path)
    urdf = read_urdf(description)
    model = _compiled(description, urdf)
    links = _links(model, path)
    _check_sizes(model, links, description)
    names = [model.joint(joint).name for joint in range(len(links) - 1)]
    _check_tool(part, path)
    torque = _torques(model, urdf, names, path) if part.torque_nm is None else part.torque_nm
    T_last_hand = homogeneous(Rotation.from_euler("xyz", part.flange.rpy_rad).as_matrix(), part.flange.position_m)
    arm = ArmModel(
        name=name,
        title=part.title,
        base=links[0].name,
        joints=tuple(
            Joint(
                name=joint,
                link=link.name,
                T_parent_link=np.linalg.inv(before.T_body_link) @ _T_parent_body(model, link.body) @ link.T_body_link,
                torque_nm=float(most),
                stiffness_nm_rad=_STIFFNESS_1_RAD * float(most),
            )
            for before, link, joint, most in zip(
                links, links[1:], names, _row(torque, "torque_nm", len(names), path), strict=False
            )
        ),
        limits=_limits(part, model, urdf, names, path),
        home_q_rad=_row(part.home_q_rad, "home_q_rad", len(names), path),
        T_last_hand=np.linalg.inv(links[-1].T_body_link) @ T_last_hand,
        gripper=_gripper(part.gripper, path),
        inertias=_inertias(model, links, part.gripper),
        capsules=(
            *(capsule for link in links for capsule in capsules_around(link.name, _surface_points(model, link))),
            *(_capsule(HAND, numbers) for numbers in part.gripper.body),
            *(_capsule(finger, numbers) for finger in FINGER_LINKS for numbers in part.gripper.finger),
        ),
        may_meet=_apart(links),
        above_table=frozenset((*(link.name for link in links[2:]), HAND, *FINGER_LINKS)),
        roomiest_yaw_rad=0.0,
        surfaces=_surfaces(model, links, description, part),
    )
    if wrong := next(chain(arm.limit_errors(names), arm.gripper.errors()), None):
        raise ConfigError(f"{wrong}; correct it in {path} or its description.")
    return _finished(arm)


def _read_toml(path: Path) -> _ArmPart:
    try:
        return msgspec.toml.decode(path.read_bytes(), type=_ArmPart)
    except UnicodeDecodeError as error:
        raise ConfigError(f"the arm in {path} cannot be read: {error}; save the file as UTF-8.") from error
    except (OSError, msgspec.MsgspecError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(
            f"the arm in {path} cannot be read: {error}; docs/how-to/add-an-arm.md lists what such a file says."
        ) from error


def _description(part: _ArmPart, path: Path) -> Path:
    """The URDF or MJCF file: in the package that carries it, else beside the TOML."""
    missing = f"The description of the arm {part.title} is missing: it comes"
    folder = package_folder(part.package, part.wheel or part.package, missing) if part.package else path.parent
    description = folder / part.description
    if not description.is_file():
        raise ConfigError(f"the arm in {path} names {description} as its description, and there is no such file.")
    return description


def _compiled(description: Path, urdf: Urdf | None) -> Any:
    try:
        if urdf is None:
            return mujoco.MjModel.from_xml_path(str(description))
        spec = mujoco.MjSpec.from_string(urdf.text)
        spec.modelfiledir = str(description.parent)
        return spec.compile()
    except ValueError as error:
        raise ConfigError(f"{description} cannot be read as URDF or MJCF: {error}") from error


def _links(model: Any, path: Path) -> list[_Link]:
    """The base and the links of the joints, in order. Raises `ConfigError` unless they are one chain of hinges."""
    bodies: list[int] = []
    for joint in range(model.njnt):
        body = int(model.jnt_bodyid[joint])
        is_hinge = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE and not np.any(model.jnt_pos[joint])
        if not is_hinge or int(model.body_parentid[body]) != (bodies[-1] if bodies else int(model.body_parentid[body])):
            raise ConfigError(
                f"the arm in {path} must be one row of revolute joints through their links' origins, and joint "
                f"{model.joint(joint).name!r} is not; take grippers and further joints out of its description."
            )
        bodies.append(body)
    if not bodies:
        raise ConfigError(f"the arm in {path} has no joints; name the description of an arm.")
    base = int(model.body_parentid[bodies[0]])
    return [
        _Link(model.body(base).name if base else "base", base, np.eye(4)),
        *(_Link(model.body(body).name, body, _axis_up(model.jnt_axis[joint])) for joint, body in enumerate(bodies)),
    ]


def _axis_up(axis: Float64Array) -> Float64Array:
    """The transform (4, 4) to a frame whose z axis is `axis` (3,)."""
    turn = Rotation.align_vectors(axis[None, :], np.array([[0.0, 0.0, 1.0]]))[0]
    return np.eye(4) if np.allclose(axis, [0.0, 0.0, 1.0]) else homogeneous(turn.as_matrix(), np.zeros(3))


def _T(position_m: Sequence[float], wxyz: Sequence[float]) -> Float64Array:
    return homogeneous(Rotation.from_quat(wxyz, scalar_first=True).as_matrix(), position_m)


def _T_parent_body(model: Any, body: int) -> Float64Array:
    return _T(model.body_pos[body], model.body_quat[body])


def _check_sizes(model: Any, links: list[_Link], description: Path) -> None:
    """Refuse lengths in millimetres, and meshes that are scaled twice."""
    for link in links:
        radius_m = max((float(model.geom_rbound[geom]) for geom in _shapes(model, link)), default=_SMALLEST_M)
        away_m = float(np.linalg.norm(model.body_pos[link.body]))
        if max(away_m, radius_m) > _LARGEST_M or radius_m < _SMALLEST_M:
            raise ConfigError(
                f"{link.name} has a radius of {radius_m:.3g} m, {away_m:.3g} m from the link before; give metres in "
                f'{description}, and scale="0.001 0.001 0.001" to a mesh in millimetres alone.'
            )


def _limits(part: _ArmPart, model: Any, urdf: Urdf | None, names: list[str], path: Path) -> JointLimits:
    lower, upper = _ranges(model, urdf, names).T.tolist()

    def row(name: str, described: Sequence[float]) -> Float64Array:
        own = getattr(part, name)
        return _row(described if own is None else own, name, len(names), path)

    return JointLimits(
        position_lower_rad=row("position_lower_rad", lower),
        position_upper_rad=row("position_upper_rad", upper),
        velocity_rad_s=row("velocity_rad_s", [] if part.velocity_rad_s else _velocities(urdf, names, path)),
        acceleration_rad_s2=row("acceleration_rad_s2", []),
        jerk_rad_s3=row("jerk_rad_s3", []),
    )


def _ranges(model: Any, urdf: Urdf | None, names: list[str]) -> Float64Array:
    """Position limits (joints, 2) [rad] as described; joints that turn without limit, or many times, get ±1 turn."""
    half_turns = np.abs(model.jnt_range).max(axis=1) / np.pi
    # A limit in degrees would be at most 720, and almost never a whole number of half turns in radians.
    many = (half_turns > 720.0 / np.pi) | ((half_turns > 4.0) & (np.abs(half_turns - half_turns.round()) < 1e-3))
    ranges = np.where(many[:, None], model.jnt_range.clip(-_ONE_TURN_RAD, _ONE_TURN_RAD), model.jnt_range)
    ranges[[urdf is not None and name in urdf.continuous for name in names]] = -_ONE_TURN_RAD, _ONE_TURN_RAD
    return ranges


def _velocities(urdf: Urdf | None, names: list[str], path: Path) -> list[float]:
    """Velocity limits [rad/s] of a URDF; MuJoCo has none."""
    found = {} if urdf is None else urdf.velocity_rad_s
    if missing := [name for name in names if name not in found]:
        raise ConfigError(
            f"the description of the arm in {path} gives no velocity limit of {', '.join(missing)}; set velocity_rad_s."
        )
    return [found[name] for name in names]


def _torques(model: Any, urdf: Urdf | None, names: list[str], path: Path) -> list[float]:
    most = np.abs(model.jnt_actfrcrange[: len(names)]).max(axis=1).tolist()
    if urdf is not None:  # MuJoCo has the absolute values of its limits
        most = [urdf.effort_nm.get(name, 0.0) for name in names]
    if not any(most):
        raise ConfigError(f"the description of the arm in {path} gives no torque limits; set torque_nm.")
    return most


def _row(values: Sequence[float], name: str, joints: int, path: Path) -> Float64Array:
    row = np.array(values, dtype=np.float64)
    if row.shape != (joints,):
        raise ConfigError(f"{name} in {path} has {len(row)} numbers; the arm has {joints} joints, give one of each.")
    return row


def _check_tool(part: _ArmPart, path: Path) -> None:
    """Refuse a flange and capsules in other units, and a gripper without mass."""
    rows: list[tuple[str, Sequence[float], float, str]] = [
        ("position_m of the flange", part.flange.position_m, 1.0, "metres"),
        ("rpy_rad of the flange", part.flange.rpy_rad, 2.0 * np.pi, "radians"),
        ("mass_kg", (part.gripper.mass_kg,), 100.0, "kilograms, above 0"),
        *(("a capsule of body", each, 1.0, "metres, with a radius above 0") for each in part.gripper.body),
        *(("a capsule of finger", each, 1.0, "metres, with a radius above 0") for each in part.gripper.finger),
    ]
    for name, values, most, unit in rows:
        if not np.all(np.abs(values) <= most) or ("above 0" in unit and values[-1] <= 0.0):
            raise ConfigError(f"{name} is {values}; give {unit}, at most {most:.4g}: correct it in {path}.")


def _gripper(part: _GripperPart, path: Path) -> Gripper:
    widths_m, drops_m = [pair[0] for pair in part.tip_drop], [pair[1] for pair in part.tip_drop]
    grow = all(a < b for a, b in itertools.pairwise(widths_m))
    if not grow or any(not 0.0 <= w <= part.open_width_m for w in widths_m) or any(not d >= 0.0 for d in drops_m):
        raise ConfigError(
            f"the gripper in {path} has tip_drop = {part.tip_drop}; give pairs of width and drop in metres, with "
            f"growing widths from 0 to open_width_m, {part.open_width_m}, and drops of 0 or more."
        )
    gripper = Gripper(**{each.name: getattr(part, each.name) for each in fields(Gripper)})
    return replace(gripper, tip_drop=tuple(part.tip_drop))


def _inertias(model: Any, links: list[_Link], gripper: _GripperPart) -> dict[str, Inertia]:
    """The inertia of every link; the gripper's are approximated by balls of its mass, for lack of data."""
    found = {links[0].name: _ball(_BASE_KG, 0.1)}
    for link in links[1:]:
        T = np.linalg.inv(link.T_body_link) @ _T(model.body_ipos[link.body], model.body_iquat[link.body])
        moment = T[:3, :3] @ np.diag(model.body_inertia[link.body]) @ T[:3, :3].T
        x, y, z = (float(value) for value in T[:3, 3])
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = moment.tolist()
        found[link.name] = Inertia(
            mass_kg=float(model.body_mass[link.body]),
            center_m=(x, y, z),
            inertia_kg_m2=(xx, yy, zz, xy, xz, yz),
        )
    fingers = dict.fromkeys(FINGER_LINKS, _ball(0.02 * gripper.mass_kg, 0.01))
    return {**found, HAND: _ball(0.96 * gripper.mass_kg, 0.04), **fingers}


def _ball(mass_kg: float, radius_m: float) -> Inertia:
    moment = 0.4 * mass_kg * radius_m**2
    return Inertia(mass_kg=mass_kg, center_m=(0.0, 0.0, 0.0), inertia_kg_m2=(moment, moment, moment, 0.0, 0.0, 0.0))


def _shapes(model: Any, link: _Link) -> list[int]:
    """The geoms of a link that collide, or all its geoms if none does."""
    own = [geom for geom in range(model.ngeom) if int(model.geom_bodyid[geom]) == link.body]
    solid = [geom for geom in own if model.geom_contype[geom] or model.geom_conaffinity[geom]]
    return solid or own


def _surface_points(model: Any, link: _Link) -> Float64Array:
    """Points (N, 3) [m] on the surface of a link, in its frame."""
    T_link_body = np.linalg.inv(link.T_body_link)
    clouds = [np.zeros((0, 3))]
    for geom in _shapes(model, link):
        T = T_link_body @ _T(model.geom_pos[geom], model.geom_quat[geom])
        clouds.append(trimesh.transform_points(_corners_of(model, geom), T))
    return np.concatenate(clouds)


def _corners_of(model: Any, geom: int) -> Float64Array:
    """Points (N, 3) [m] on a geom's surface, in its own frame."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    match kind:
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
            face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
            shape = trimesh.Trimesh(
                model.mesh_vert[first : first + count], model.mesh_face[face : face + faces], process=False
            )
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            shape = trimesh.creation.icosphere(radius=size[0])
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            shape = trimesh.creation.capsule(height=2.0 * size[1], radius=size[0])
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            shape = trimesh.creation.cylinder(radius=size[0], height=2.0 * size[1])
        case _:
            shape = trimesh.creation.box(extents=2.0 * size)
    # Corners alone would leave the middle of a long tube out of its slab.
    return np.asarray(trimesh.remesh.subdivide_to_size(shape.vertices, shape.faces, _PIECE_M)[0], dtype=np.float64)


def _surfaces(model: Any, links: list[_Link], description: Path, part: _ArmPart) -> dict[str, tuple[Surface, ...]]:
    """The meshes of each link that has any."""
    folder = description.parent
    found: dict[str, tuple[Surface, ...]] = {}
    for link in links:
        meshes: list[Surface] = []
        for geom in _shapes(model, link):
            mesh = int(model.geom_dataid[geom])
            if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH or np.any(model.mesh_scale[mesh] != 1.0):
                continue
            # MuJoCo moves a mesh to its centre of mass; the file is as it was.
            T_geom_file = np.linalg.inv(_T(model.mesh_pos[mesh], model.mesh_quat[mesh]))
            T = np.linalg.inv(link.T_body_link) @ _T(model.geom_pos[geom], model.geom_quat[geom]) @ T_geom_file
            meshes.append(Surface(file=str(folder / _mesh_file(model, mesh)), T_link_mesh=T))
        if meshes:
            found[link.name] = tuple(meshes)
    return found


def _mesh_file(model: Any, mesh: int) -> str:
    start = int(model.mesh_pathadr[mesh])
    return model.paths[start : model.paths.index(b"\0", start)].decode()


def _capsule(link: str, numbers: Sequence[float]) -> Capsule:
    x0, y0, z0, x1, y1, z1, radius_m = numbers
    return Capsule(link=link, start_m=(x0, y0, z0), end_m=(x1, y1, z1), radius_m=radius_m)


def _apart(links: list[_Link]) -> tuple[tuple[str, str], ...]:
    names = [(index, link.name) for index, link in enumerate(links)]
    every = [*names, *((len(links), name) for name in (HAND, *FINGER_LINKS))]
    return tuple((a, b) for i, a in every for j, b in every if j - i >= _APART and i < len(links))


def _finished(arm: ArmModel) -> ArmModel:
    """The arm with properties derived from its home: pairs of links that may collide, and the wrist's best yaw."""
    spec = mujoco.MjSpec()
    add_arm(spec, arm, visual=False)
    model: Any = spec.compile()
    data: Any = mujoco.MjData(model)
    joints, last = len(arm.joints), -1
    data.qpos[:joints] = arm.home_q_rad
    data.qpos[joints:] = arm.gripper.open_width_m / 2.0
    mujoco.mj_kinematics(model, data)
    # Pairs that overlap at home are held apart by their joints, or their capsules are too wide.
    free = tuple(pair for pair in arm.may_meet if _gap_m(model, data, pair) > 0.0)
    data.qpos[joints + last] = 0.5 * (arm.limits.position_lower_rad[last] + arm.limits.position_upper_rad[last])
    mujoco.mj_kinematics(model, data)
    x_axis, place = data.site("arm/tcp").xmat[[0, 3]], data.site("arm/tcp").xpos
    turn = np.arctan2(x_axis[1], x_axis[0]) - np.arctan2(place[1], place[0])
    return replace(arm, may_meet=free, roomiest_yaw_rad=float(np.arctan2(np.sin(turn), np.cos(turn))))


def _gap_m(model: Any, data: Any, pair: tuple[str, str]) -> float:
    """Distance [m] of two links by their capsules; 0 if they overlap or have no capsules."""
    first, second = (
        [
            geom
            for geom in range(model.ngeom)
            if model.geom_bodyid[geom] == model.body(f"arm/{link}").id
            and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
        ]
        for link in pair
    )
    gaps = [mujoco.mj_geomDistance(model, data, i, j, _FAR_M, None) for i in first for j in second]
    return float(min(gaps, default=0.0))
