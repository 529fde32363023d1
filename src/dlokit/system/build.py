"""Builds components by name, with their drivers, and connects them to a transport and a clock.

Every builder imports only what it builds, so that a process loads only its own components: imports take most of the
time of a start or of a restart after a crash.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, cast

import msgspec

from dlokit.communication.component import Component
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import Compute, InlineCompute, Port
from dlokit.communication.timing.clock import Clock, LoopClock, suspended_too_ns
from dlokit.communication.timing.pulse import Pulse
from dlokit.communication.topics import all_topics
from dlokit.communication.transport import Transport
from dlokit.description.arm.mounts import INSTANCES, ArmMount
from dlokit.errors import ConfigError
from dlokit.functional.robots.base import Robot
from dlokit.recording.disk import Disk
from dlokit.skills.viewer.serving.address import new_key
from dlokit.system.config import RunConfig
from dlokit.system.results.run_folder import HIDDEN_START
from dlokit.system.table import component_table, components_of_run, instances_of_run
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import FIRST_ROBOT

if TYPE_CHECKING:
    from dlokit.decision.component import DecisionComponent
    from dlokit.functional.cameras.base import Camera
    from dlokit.motion.forward_kinematics import PosedArm
    from dlokit.skills.perception.base import SegmentationConfig
    from dlokit.skills.perception.config import PerceptionConfig
    from dlokit.skills.planning.base import SecondArm
    from dlokit.skills.viewer.component import ViewerComponent
    from dlokit.skills.viewer.playback import Player
    from dlokit.skills.viewer.segmentation import SegmentationTools
    from dlokit.types.image import CameraPictures, SegmentedPicture
    from dlokit.types.system import StrategyProposal


@dataclass(frozen=True, kw_only=True)
class Wiring:
    """The context in which a process builds components; by default all run in this process and write no files."""

    transport: Transport = field(default_factory=MemoryTransport)
    clock: Clock = field(default_factory=LoopClock)
    folder: Path | None = None
    """Folder of the run; None: the run writes no files, which only a lockstep run can do."""
    start_nodes_world: Float64Array = field(default_factory=lambda: HIDDEN_START)
    """(K, 3) [m] initial shape in the cell; no other component may read it."""
    page_key: str = field(default_factory=new_key, repr=False)
    """Access key of the viewer's page."""
    disk: Disk = field(default_factory=Disk)
    """Writes the files of the run."""

    @property
    def live_folder(self) -> Path:
        """The folder of a live run."""
        assert self.folder is not None, "a live run has a folder"
        return self.folder


def assemble(
    names: Iterable[str],
    config: RunConfig,
    wiring: Wiring,
    *,
    compute: Compute | None = None,
    build: "Build | None" = None,
) -> Container:
    """The components `names` of a run on one transport and one clock; they run while the container is entered.

    `compute` runs their long computations; None: on the event loop. `build` creates each in place of `build_component`:
    a component that exists already, or one with a part replaced.
    """
    host = Container(wiring.transport, wiring.clock, compute, instances_of_run(config))
    for component in [(build or build_component)(name, config, wiring) for name in names]:
        host.add(component)
    return host


def build_component(name: str, config: RunConfig, wiring: Wiring) -> Component:
    """Build the component `name`, one of `component_table`, with its drivers.

    A component without a builder of its own is built from the settings that its row in the table names. Raises
    `ConfigError` when another package's component cannot be loaded, or publishes topics that the table lacks.
    """
    if (build := _BUILDERS.get(name)) is not None:
        return build(config, wiring)
    row = component_table()[name]
    loaded = row.load()
    if unknown := [topic.name for topic in loaded.publishes if topic not in all_topics()]:
        raise ConfigError(
            f"component {name} publishes {', '.join(unknown)}, which is not in the table of topics: its package must "
            "name the topic as an entry point dlokit.topics, and no other topic may have its name."
        )
    kind = cast(Callable[[object], Component], loaded)
    return kind(getattr(config, row.settings) if row.settings else config)


def _load(*modules: str) -> None:
    """Import parts of SciPy now, which would otherwise be imported during a look or a motion of the arm."""
    for name in modules:
        import_module(name)


def _driver_port(wiring: Wiring, owner: str) -> Port:
    # The transport through which a driver calls its device; it publishes nothing.
    return Port(wiring.transport, wiring.clock, InlineCompute(), owner=owner, publishes=())


def _cell(config: RunConfig, wiring: Wiring) -> Component:
    from dlokit.communication.timing.urgency import BoundedUrgency, never_urgent
    from dlokit.functional.cell.component import MIRROR_CPU_FRACTION, CellComponent

    urgency = never_urgent
    if config.runtime == "live":
        urgency = BoundedUrgency(largest_fraction=MIRROR_CPU_FRACTION) if config.mirrors_arm else BoundedUrgency()
    return CellComponent(
        config.cell,
        wiring.start_nodes_world,
        seed=config.seed,
        truth_folder=wiring.folder,
        disk=wiring.disk,
        real_time_factor=1.0 if config.runtime == "lockstep" or config.mirrors_arm else config.cell.real_time_factor,
        arms=config.mounts,
        installation=config.installation,
        urgency=urgency,
        mirrors=config.mirrors_arm,
    )


def _robot(number: int) -> "_Builder":
    def build(config: RunConfig, wiring: Wiring) -> Component:
        from dlokit.communication.timing.deadlines import LoopWatchdog, ThreadWatchdog
        from dlokit.communication.timing.pulse import ThreadPulse, loop_pulse
        from dlokit.functional.robots.gate import GatedRobot
        from dlokit.skills.robot.component import DEVICE_RATE_HZ, STATE_RATE_HZ, RobotComponent, no_button
        from dlokit.skills.robot.lease import RobotLease
        from dlokit.system.processes.stop_socket import stop_button, stop_socket

        mount = config.mounts[number]
        live = config.runtime == "live"
        pulse = ThreadPulse() if live else loop_pulse
        watch = ThreadWatchdog() if live else LoopWatchdog()
        lease = RobotLease(suspended_too_ns, needs_operator=config.moves_real_arm)
        robot = GatedRobot(
            _driver(config, wiring, mount, pulse),
            config.gate,
            suspended_too_ns if live else wiring.clock.now_ns,
            T_world_base=mount.T_world_base,
            workspace=mount.workspace,
            may_move=lease.allows,
            watch=watch,
        )
        return RobotComponent(
            config.robot,
            robot,
            suspended_too_ns,
            mount.T_world_base,
            mount.instance,
            watch,
            neighbours=tuple(other for other in config.mounts if other.instance != mount.instance),
            button=partial(stop_button, stop_socket(wiring.live_folder, mount.instance)) if live else no_button,
            lease=lease,
            standing=robot.standing,
            state_rate_hz=STATE_RATE_HZ if config.driver.in_cell else DEVICE_RATE_HZ,
            scene=config.scene,
        )

    return build


def _driver(config: RunConfig, wiring: Wiring, mount: ArmMount, pulse: Pulse) -> Robot:
    """The configured driver; in a dry run an arm in software, which starts at the pose of the configured arm.

    In a twin run, the configured driver with the finger feedback of the cell's arm.
    """
    from dlokit.functional.robots.kinematic import KinematicRobot

    if config.driver.in_cell and not config.has_cell:
        return KinematicRobot(wiring.clock, mount)
    device = config.driver.build(_driver_port(wiring, "robot driver"), mount, pulse)
    if config.mirrors_arm:
        from dlokit.functional.robots.simulated import SimulatedRobot
        from dlokit.functional.robots.twin import TwinRobot

        return TwinRobot(device, SimulatedRobot(_driver_port(wiring, "fingers of the twin"), mount, pulse))
    return KinematicRobot(wiring.clock, mount, device) if config.dry_run else device


def placed_camera(config: RunConfig, camera: "Camera") -> "Camera":
    """The camera of a run, at the pose from its calibration or from the installation. Raises `ConfigError`."""
    if config.calibration:
        from dlokit.functional.cameras.calibration_file import read_calibration
        from dlokit.functional.cameras.corrected import CalibratedCamera

        given = read_calibration(Path(config.calibration))
        placed = msgspec.structs.replace(given, T_world_camera=config.installation.in_world(given.T_world_camera))
        return CalibratedCamera(camera, placed, config.calibration)
    if config.installation.camera is not None and not config.camera.sees_cell:
        from dlokit.functional.cameras.corrected import PlacedCamera

        return PlacedCamera(camera, config.installation.camera_in_world(config.installation.camera.pose))
    return camera


def _perception(config: RunConfig, wiring: Wiring) -> Component:
    from dlokit.functional.cameras.corrected import NowPlayedCamera
    from dlokit.functional.cameras.recorded import RecordedCameraConfig
    from dlokit.skills.perception.component import PerceptionComponent

    camera = config.camera.build(wiring.transport)
    if isinstance(config.camera, RecordedCameraConfig):
        camera = NowPlayedCamera(camera, wiring.clock)
    camera = placed_camera(config, camera)
    return PerceptionComponent(config.perception, camera, config.model, config.mounts, config.scene)


def _observer(config: RunConfig, wiring: Wiring) -> Component:
    from dlokit.skills.observer.component import ObserverComponent

    _load("scipy.interpolate", "scipy.sparse.csgraph", "scipy.spatial")
    return ObserverComponent(config.observer, config.model)


def _model(config: RunConfig, wiring: Wiring) -> Component:
    from dlokit.skills.model.component import ModelComponent

    return ModelComponent(config.model, config.mounts[0].model.gripper, config.scene, config.wish)


def _planning(config: RunConfig, wiring: Wiring) -> Component:
    from dlokit.motion.inverse_kinematics import ArmKinematics
    from dlokit.skills.planning.component import PlanningComponent
    from dlokit.skills.planning.executable import refusal

    # In lockstep no result may depend on the speed of the machine.
    stopwatch = time.perf_counter if config.runtime == "live" else None
    mount = config.mounts[0]
    arms = {mount.robot: ArmKinematics(mount.model, mount.T_world_base) for mount in config.mounts}
    first, scene = arms[mount.robot], config.scene
    return PlanningComponent(
        config.planning,
        first.reachable,
        config.model,
        stopwatch,
        _second_arm(config),
        mount,
        scene,
        # Strategies need not know what the installation calls the first arm.
        partial(refusal, {**arms, FIRST_ROBOT: first}, scene.fixtures, config.model.radius_m)
        if scene.fixtures
        else None,
    )


def _second_arm(config: RunConfig) -> "SecondArm | None":
    from dlokit.motion.arm_distance import Apart
    from dlokit.motion.inverse_kinematics import ArmKinematics
    from dlokit.skills.planning.base import SecondArm

    if config.arms == 1:
        return None
    mount = config.mounts[1]
    first, kinematics = (ArmKinematics(each.model, each.T_world_base) for each in config.mounts)
    return SecondArm(
        robot=mount.robot,
        arm=mount.model,
        reachable=kinematics.reachable,
        place_m=mount.place_m,
        apart_m=Apart(first, kinematics).of_pair_m,
    )


def _decision(config: RunConfig, wiring: Wiring) -> Component:
    from dlokit.decision.component import DecisionComponent
    from dlokit.system.results.run_folder import JournalFile

    _load("scipy.spatial")
    return DecisionComponent(
        config.task,
        time.perf_counter,
        dlo=config.model,
        fixtures=config.installation.fixtures,
        dry_run=config.dry_run,
        robots=config.installation.robots[: config.arms],
        # A lockstep run can instead be repeated bit by bit.
        keep=JournalFile(wiring.live_folder, wiring.disk).keep if config.runtime == "live" else lambda journal: None,
    )


def build_viewer(
    config: RunConfig,
    *,
    operated: bool,
    player: "Player | None" = None,
    key: str | None = None,
    folder: Path | None = None,
    segmentation: "SegmentationTools | None" = None,
) -> "ViewerComponent":
    """The viewer of a run; not `operated` if no component receives the operator's commands.

    `player` moves through a recorded run. `key` is the access key of the page; None: a new one. The page serves the
    reports in `folder`; None: none. With `segmentation` its settings can be changed on the page.
    """
    from dlokit.decision.shape_flow import task_chart
    from dlokit.skills.model import api as model
    from dlokit.skills.planning import api as planning
    from dlokit.skills.robot import api as robot
    from dlokit.skills.viewer.component import ViewerComponent
    from dlokit.skills.viewer.goal.editor import GoalSkills, RodOutline
    from dlokit.skills.viewer.operator_input import ArmButtons
    from dlokit.skills.viewer.panel.health import WatchedComponent
    from dlokit.skills.viewer.serving.address import RunFiles

    return ViewerComponent(
        config.viewer,
        flow=task_chart(dry_run=config.dry_run, fixtures=bool(config.installation.fixtures)).edges(),
        rod=RodOutline(nodes=config.model.nodes, length_m=config.model.length_m, radius_m=config.model.radius_m),
        scene=config.scene,
        threshold_m=config.task.threshold_m,
        T_world_installation=config.installation.T_world_installation,
        operated=operated,
        player=player,
        buttons=tuple(
            ArmButtons(stop=robot.STOP.at(mount.instance), enable=robot.ENABLE.at(mount.instance))
            for mount in config.mounts
        ),
        goals=GoalSkills(set_goal=model.SET_GOAL, build_goal=model.BUILD_GOAL, judge_goal=planning.JUDGE_GOAL)
        if operated
        else None,
        watched=tuple(
            WatchedComponent(name=name, process=component_table()[name].process_name)
            for name in components_of_run(config)
            if operated and name != "viewer"
        ),
        files=None if folder is None else RunFiles(folder),
        rejects_infeasible=config.task.infeasible == "reject",
        segmentation=segmentation,
        key=key,
    )


def segmentation_tools(
    config: "PerceptionConfig", *, look: bool = True, group: str = "perception.segmentation", has_file: bool = True
) -> "SegmentationTools":
    """What the page needs to change the segmentation of a perception with these settings.

    `look`: the page asks for pictures while the run waits. The command line has the settings as `group`, and a
    configuration file (`has_file`) as the table of that name.
    """
    from dlokit.skills.perception import api as perception
    from dlokit.skills.perception.config import SEGMENTATIONS
    from dlokit.skills.viewer.segmentation import SegmentationTools

    return SegmentationTools(
        kind=SEGMENTATIONS,
        configured=config.segmentation,
        set_segmentation=perception.SET_SEGMENTATION,
        look=perception.LOOK if look else None,
        preview=partial(_preview, config),
        propose=_proposed,
        group=group,
        has_file=has_file,
    )


# The viewer's worker imports perception for these, where they are used; the viewer does not.
def _preview(
    config: "PerceptionConfig",
    images: "CameraPictures",
    robots: "tuple[PosedArm, ...]",
    segmentation: "SegmentationConfig",
    width_px: int,
) -> "SegmentedPicture":
    from dlokit.skills.perception.pipeline import segmentation_preview

    return segmentation_preview(images, robots, segmentation, config, width_px)


def _proposed(
    images: "CameraPictures", pixel: tuple[int, int], segmentation: "SegmentationConfig"
) -> "StrategyProposal":
    from dlokit.skills.perception.proposal import proposed

    return proposed(images, pixel, segmentation)


def _viewer(config: RunConfig, wiring: Wiring) -> Component:
    tools = segmentation_tools(config.perception)
    return build_viewer(config, operated=True, key=wiring.page_key, folder=wiring.folder, segmentation=tools)


def decision_of(host: Container) -> "DecisionComponent":
    """The component that runs tasks, in a container that holds it."""
    from dlokit.decision.component import DecisionComponent

    (decision,) = (component for component in host.components if isinstance(component, DecisionComponent))
    return decision


_Builder = Callable[[RunConfig, Wiring], Component]

# For components that need more than their settings.
_BUILDERS: dict[str, _Builder] = {
    "cell": _cell,
    "robot": _robot(0),
    f"robot.{INSTANCES[1]}": _robot(1),
    "perception": _perception,
    "observer": _observer,
    "model": _model,
    "planning": _planning,
    "viewer": _viewer,
    "decision": _decision,
}

Build = Callable[[str, RunConfig, Wiring], Component]
"""Builds a component by its name, as `build_component` does."""
