"""The cell itself: physics of arms, table and DLO. A plain object, without clock, sockets or OpenGL."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from dlokit import geometry
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.description.arm.mujoco_model import add_arm
from dlokit.description.clearance import clearances_m
from dlokit.description.installation import PAPERS_CELL, Installation
from dlokit.description.scene import Fixture
from dlokit.description.shapes import CENTRE_M, LENGTH_TOLERANCE
from dlokit.errors import DlokitError, ShapeError
from dlokit.functional.cell.arm import ArmPosture, CellArm
from dlokit.functional.cell.board import TrueBoard, add_board, draw_board
from dlokit.functional.cell.config import TICK_S, CellConfig, DloBody
from dlokit.functional.cell.depth_rendering import DEPTH_CAMERA, DepthRig
from dlokit.functional.cell.drawn_cell import DrawnCell, apply_drawn, draw_cell
from dlokit.functional.cell.fixtures import FixtureForces, add_fixtures, true_fixtures
from dlokit.functional.cell.rendering import (
    VIEWPOINT,
    StereoRig,
    ViewpointRig,
    add_camera,
    add_stereo_cameras,
    set_picture_quality,
)
from dlokit.functional.cell.setpoints import Mirror
from dlokit.functional.cell.surroundings import add_lights, add_table, table_height_m
from dlokit.rod.elastic import set_rod_physics
from dlokit.types.arrays import Float64Array, RowArray, UInt8Array
from dlokit.types.image import CameraCalibration, DepthImage, StereoImages
from dlokit.types.robot import FIRST_ROBOT, RobotState

NODES = 41
"""Nodes of the cell's DLO, 12.5 mm apart on half a metre; the system's own model has another number."""
TIMESTEP_S = 0.0025
"""Step of the physics [s]; a tick is a whole number of steps. Stiff wires diverge with longer steps."""
_STEPS_A_TICK = round(TICK_S / TIMESTEP_S)
TABLE_FRICTION = 0.5
"""Friction of the table's own surface; of two surfaces that touch the larger friction counts, mostly the DLO's."""
_TOUCHES = 0.5
"""Smallest distance of the DLO's centre line from a fixture at the start, in radii: a DLO that earlier came to rest
against a fixture presses into it a little."""


class TableFriction:
    """Sets the friction of each node of the DLO to the friction of the table's quarter below it."""

    def __init__(self, model: Any, dlo: DloBody, dlo_friction: float, drawn: DrawnCell) -> None:
        """The quarters meet at the centre of the shapes' area."""
        self._dlo = dlo
        self._differs = set(drawn.friction_regions) != {1.0}
        # MuJoCo uses the larger friction of two touching surfaces: the table's must not exceed the nodes'.
        self._nominal = max(TABLE_FRICTION * drawn.friction_factor, dlo_friction)
        self._factors = np.array(drawn.friction_regions).reshape(2, 2)  # near and far, right and left
        if self._differs:
            model.geom_friction[model.geom("table_top").id, 0] = 0.0

    def update(self) -> None:
        """Update the nodes' friction; call after every few millimetres of motion. Kinematics must be up to date."""
        if self._differs:
            self._dlo.set_friction(self.at(self._dlo.nodes_world[:, :2]))

    def at(self, places_world: Float64Array) -> Float64Array:
        """Coefficient of friction (K,) at places (K, 2) [m]."""
        far, left = (places_world[:, axis] >= CENTRE_M[axis] for axis in range(2))
        return self._nominal * self._factors[far.astype(np.int64), left.astype(np.int64)]


_DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


class Cell:
    """The simulated reality. Its time starts at 0 and advances by `step` only."""

    def __init__(
        self,
        config: CellConfig,
        *,
        seed: int,
        arms: tuple[ArmMount, ...] = FIRST_ALONE,
        installation: Installation = PAPERS_CELL,
        drawn: DrawnCell | None = None,
        viewpoint: CameraCalibration | None = None,
    ) -> None:
        """Build the cell with its arms at home and the DLO straight in the middle of the table.

        The properties in `config.randomised` are drawn from the seed, unless `drawn` gives them. `viewpoint` is a
        camera for people, which no component of a run has. Raises `ConfigError` or `MachineError` on what cannot be
        built.
        """
        self.drawn = draw_cell(config, seed, installation) if drawn is None else drawn
        config = apply_drawn(config, self.drawn)
        self.config = config
        self.table = installation.table
        self.fixtures = true_fixtures(config, installation, self.drawn)
        """The fixtures as they truly are. For the evaluator and for tests, never for the bus."""
        self.rig = StereoRig(config, seed=seed, installation=installation)
        self.depth_rig = DepthRig(config, seed=seed, installation=installation)
        self.board = None if config.board is None else draw_board(config.board, seed, arms[0].model)
        self._viewpoint_rig = None if viewpoint is None else ViewpointRig(viewpoint, shadows=config.shadows)
        cameras = self.rig.true_calibration, self.depth_rig.true_calibration
        self._model = _build(config, self.drawn, cameras, arms, installation, self.fixtures, self.board, viewpoint)
        self._data: Any = mujoco.MjData(self._model)
        self._dlo = config.physics.take_over(self._model, self._data, config.dlo)
        self._friction = TableFriction(self._model, self._dlo, config.dlo.friction, self.drawn)
        self._start_ns = 0
        self._steps = 0
        self._mirrors: list[Mirror] = []
        offsets = None if self.board is None else self.board.joint_offsets_rad
        self.arms = {
            mount.robot: CellArm(self._model, self._data, mount, None if number else offsets)
            for number, mount in enumerate(arms)
        }
        self._forces = FixtureForces(self._model, self._data, self.arms, self.fixtures) if self.fixtures else None
        half_m = config.dlo.length_m / 2
        self._dlo.place(self._nodes_along(np.array([[0.5, -half_m], [0.5, half_m]])))
        self._refresh()

    @property
    def arm(self) -> CellArm:
        """The first arm."""
        return next(iter(self.arms.values()))

    def arm_of(self, robot: str) -> CellArm:
        """The arm of a name; the default name of the first arm is valid even if the installation renames it."""
        return self.arm if robot == FIRST_ROBOT else self.arms[robot]

    @property
    def time_ns(self) -> int:
        """The cell's time [ns]."""
        return self._start_ns + self._steps * round(TIMESTEP_S * 1e9)

    @property
    def time_s(self) -> float:
        """Seconds since the cell's start."""
        return self._steps * TIMESTEP_S

    def begin_at(self, stamp_ns: int) -> None:
        """Count stamps from `stamp_ns` on. Call before the first step."""
        self.skip(stamp_ns - self._start_ns)

    def skip(self, duration_ns: int) -> None:
        """Advance the stamps without physics, for a cell that is too slow for the clock that it follows."""
        self._start_ns += duration_ns
        for mirror in self._mirrors:
            mirror.start_ns = self._start_ns

    def mirror(self, robot: str = FIRST_ROBOT) -> Mirror:
        """Let an arm follow the states of another arm, which the caller passes to the returned mirror."""
        self._mirrors.append(self.arm_of(robot).begin_mirror(self._start_ns))
        return self._mirrors[-1]

    def place_dlo(self, curve_world: ArrayLike, *, settle: bool = True) -> None:
        """Place the DLO along a curve (K, 2) or (K, 3) [m] on the table, and simulate until it is at rest.

        No time passes on the cell's clock. Raises `ShapeError` when the curve has another length than the DLO, leaves
        the table, or overlaps a fixture.
        """
        nodes_world = self._nodes_along(np.asarray(curve_world, dtype=np.float64))
        self._require_clear(nodes_world)
        self._dlo.place(nodes_world)
        self._refresh()
        for _ in range(round(self.config.settle_s / TICK_S) if settle else 0):
            for _ in range(_STEPS_A_TICK):
                self._before_step()
                mujoco.mj_step(self._model, self._data)
            self._refresh()

    def show(self, nodes_world: ArrayLike, arms: Mapping[str, ArmPosture]) -> None:
        """Set the DLO's nodes (Mc, 3) [m] and the arms, by name, to a past state, at rest, only to take pictures.

        The call simulates nothing and takes no time: a step from here would not continue the previous motion.
        """
        self._dlo.place(nodes_world)
        for robot, posture in arms.items():
            self.arm_of(robot).place(posture)
        self._refresh()

    def step(self, duration_s: float) -> None:
        """Advance time by a whole number of physics steps."""
        for _ in range(round(duration_s / TIMESTEP_S)):
            self._steps += 1
            self._before_step()
            mujoco.mj_step(self._model, self._data)
            if self._forces is not None:
                self._forces.note(self.time_ns)
        self._require_sane()
        self._refresh()

    def arm_state(self, robot: str = FIRST_ROBOT) -> RobotState:
        """The present state of an arm's sensors."""
        return self.arm_of(robot).state(self.time_s, self.time_ns)

    def capture(self) -> StereoImages:
        """Expose both cameras now. Raises `MachineError` without OpenGL. All calls must come from one thread."""
        return self.rig.capture(self._model, self._data, self.time_ns)

    def capture_depth(self) -> DepthImage:
        """Expose the depth camera now. Raises `MachineError` without OpenGL. All calls must come from one thread."""
        return self.depth_rig.capture(self._model, self._data, self.time_ns)

    def view(self) -> UInt8Array:
        """A picture (height, width, 3) from the viewpoint that the cell was built with. All calls from one thread."""
        assert self._viewpoint_rig is not None, "the caller gave a viewpoint"
        return self._viewpoint_rig.capture(self._model, self._data)

    def camera_view(self) -> UInt8Array:
        """The scene (height, width, 3) from the first camera, for display, without side effects.

        Raises `MachineError` without OpenGL. All calls must come from the thread of the captures.
        """
        return self.rig.view(self._model, self._data)

    def true_nodes_world(self) -> Float64Array:
        """True nodes (Mc, 3) [m]. For the record of truth and for tests, never for the bus."""
        return self._dlo.nodes_world

    @property
    def fixture_forces(self) -> RowArray | None:
        """The largest forces between arms and fixtures so far; None without fixtures. As `true_nodes_world`."""
        return None if self._forces is None else self._forces.rows

    def close(self) -> None:
        """Release the OpenGL context."""
        self.rig.close()
        self.depth_rig.close()
        if self._viewpoint_rig is not None:
            self._viewpoint_rig.close()

    def _before_step(self) -> None:
        for arm in self.arms.values():
            arm.before_step(self.time_s)

    def _require_sane(self) -> None:
        """Raise if the physics diverged: MuJoCo resets the state and only counts the event."""
        if any(self._data.warning[kind].number for kind in _DIVERGED):
            raise DlokitError(
                f"The cell's physics diverged at {self.time_s:.2f} s: it cannot simulate this. Use a softer or "
                "thicker DLO, and report how it came about."
            )

    def _refresh(self) -> None:
        """Bring poses up to date with the joints; a step leaves them one step behind."""
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        mujoco.mj_flex(self._model, self._data)
        self._friction.update()

    def _require_clear(self, nodes_world: Float64Array) -> None:
        least_m = _TOUCHES * self.config.dlo.radius_m
        for fixture, distance_m in zip(self.fixtures, clearances_m(nodes_world, self.fixtures), strict=True):
            if distance_m < least_m:
                raise ShapeError(
                    f"The start shape overlaps the fixture {fixture.name} at "
                    f"{np.round(fixture.position_m[:2], 3).tolist()} m: move the shape or the fixture."
                )

    def _nodes_along(self, curve_world: Float64Array) -> Float64Array:
        dlo = self.config.dlo
        if curve_world.ndim != 2 or curve_world.shape[0] < 2 or curve_world.shape[1] not in (2, 3):
            raise ShapeError(
                f"A start shape is (K, 2) or (K, 3) points in metres with K >= 2, not {curve_world.shape}."
            )
        length_m = float(geometry.arc_lengths(curve_world)[-1])
        if not abs(length_m - dlo.length_m) <= LENGTH_TOLERANCE * dlo.length_m:
            raise ShapeError(
                f"The start shape is {length_m:.3f} m long and the {dlo.name} {dlo.length_m:.3f} m: "
                "give a curve of that length."
            )
        xy = geometry.resample(curve_world[:, :2], NODES)
        off = np.abs(xy - self.table.centre_m) > np.array(self.table.half_size_m) - dlo.radius_m
        if off.any():
            raise ShapeError(f"The start shape leaves the table at {xy[off.any(axis=1)][0].round(3)} m: move it.")
        lowest_m = table_height_m(xy, self.table, self.drawn.table_tilt_deg) + dlo.radius_m
        if curve_world.shape[1] == 2:
            return np.column_stack([xy, lowest_m])
        return np.column_stack([xy, np.maximum(geometry.resample(curve_world, NODES)[:, 2], lowest_m)])


def _build(
    config: CellConfig,
    drawn: DrawnCell,
    cameras: tuple[CameraCalibration, CameraCalibration],
    arms: tuple[ArmMount, ...],
    installation: Installation,
    fixtures: tuple[Fixture, ...],
    board: TrueBoard | None,
    viewpoint: CameraCalibration | None,
) -> Any:
    stereo, depth = cameras
    table = installation.table
    spec: Any = mujoco.MjSpec()
    set_rod_physics(spec, TIMESTEP_S)
    spec.option.gravity = installation.gravity_world
    add_table(spec, table, friction=TABLE_FRICTION * drawn.friction_factor, tilt_deg=drawn.table_tilt_deg)
    add_fixtures(spec, fixtures)
    add_lights(spec, table, shadows=config.shadows, light=drawn.light_factor)
    add_stereo_cameras(spec, stereo)
    add_camera(spec, DEPTH_CAMERA, depth)
    others = [] if viewpoint is None else [viewpoint]
    for camera in others:
        add_camera(spec, VIEWPOINT, camera)
    sizes_px = [(camera.width_px, camera.height_px) for camera in (stereo, depth, *others)]
    set_picture_quality(spec, sizes_px, shadows=config.shadows, light=drawn.light_factor)
    for mount in arms:
        add_arm(spec, mount.model, name=mount.robot, T_world_base=mount.T_world_base)
    if board is not None:
        add_board(spec, board, arms[0].robot)
    config.physics.add(spec, config.dlo, NODES)
    return spec.compile()
