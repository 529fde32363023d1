"""The configuration of a run: one value that holds everything the run depends on."""

from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import tyro
from msgspec import Meta

from dlokit.communication.strategies import NamedConfig, StrategyKind
from dlokit.decision.config import TaskConfig
from dlokit.description.arm.model import ArmModel
from dlokit.description.arm.mounts import ArmMount, check_arm_name
from dlokit.description.dlo import DloPreset
from dlokit.description.installation import Installation
from dlokit.description.passing import parse_wish
from dlokit.description.scene import Scene, check_fixtures
from dlokit.errors import ConfigError
from dlokit.functional.cameras.simulated import SimulatedStereoConfig
from dlokit.functional.cameras.strategies import AnyCamera
from dlokit.functional.cell.config import CellConfig, ElasticRod, ElastoplasticChain
from dlokit.functional.robots.gate import GateConfig
from dlokit.functional.robots.simulated import SimulatedRobotConfig
from dlokit.functional.robots.strategies import AnyRobotDriver
from dlokit.ranges import check_ranges
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.robot.config import RobotConfig
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.types.passing import SideWish

CONFIG_FILE = "config.toml"
"""The configuration file in a run's folder."""
INTERACTIVE = "interactive"
"""The goal that the operator sets in the viewer."""
SEEN = "seen"
"""The goal that the operator shows: the shape that the camera sees first."""
BY_OPERATOR = frozenset({INTERACTIVE, SEEN})
"""Goals that need the viewer, where the operator starts the task."""
Runtime = Literal["lockstep", "live"]
HOSTS: StrategyKind[NamedConfig] = StrategyKind("[hosts]", "dlokit.hosts", ())
"""How a live run starts on several machines; the classes of settings are `other_hosts.OtherHosts`."""


def one_of(kind: StrategyKind[Any], default: str) -> Any:
    """A flag that takes the name of an installed strategy; names are looked up when the command line is built."""
    return tyro.conf.arg(constructor_factory=kind.names, help_behavior_hint=f"(default: {default})")


@dataclass(frozen=True, kw_only=True)
class Ros2Config:
    """The connection to ROS 2, through a node in the lab's own workspace."""

    publish: tyro.conf.Suppress[bool] = False
    """Publish the shape, the goal, the points and the status in ROS 2; set by --ros2."""
    frame: Annotated[str, Meta(min_length=1)] = "base_link"
    """TF frame of the first arm's base."""
    link: Annotated[str, Meta(min_length=1)] = "dlokit"
    """Name of the link to the node, whose parameter `link` has the same value; two systems need two."""


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """Everything that a run depends on; written to `config.toml`, read again with `--config`."""

    start: str = "I"
    """Start: I, L, U, S, W, spiral, random, or a file. A file is .npy or .csv [m]. The cell's DLO starts in this shape;
    the system does not receive it: it looks."""
    goal: str = "S"
    """Goal: as for --start, `interactive` or `seen`. `interactive` is set in the viewer. `seen` is the shape that the
    camera sees first: move the DLO, then start in the viewer. FILE.npy:3 is curve 3 of a (G, K, 3) file."""
    runtime: Runtime = "lockstep"
    """lockstep: one process on virtual time, repeatable to the bit. live: all processes, each at its own rate."""
    seed: Annotated[int, Meta(ge=0)] = 0
    """Seed of everything random. The start shape, camera noise and the error of the believed camera pose are drawn from
    it."""
    headless: bool = False
    """Run without the browser viewer."""
    arm: Annotated[str, tyro.conf.arg(help_behavior_hint="(default: panda, or as installed)")] = ""
    """Arm with gripper: panda, fr3, ur5e, or a file. docs/how-to/add-an-arm.md says what is in the .toml file."""
    arms: Literal[1, 2] = 1
    """Number of arms; the cell's second faces the first. With two, planner `rollout` considers pairs of grasps."""
    dry_run: bool = False
    """Look, plan, and move the arm in software only. The motions of the first action pass all checks and are shown in
    the viewer; no arm moves. Ends as `dry_run`, exit code 0."""
    twin: bool = False
    """Rehearse: the cell's arm mirrors the arm of a driver. The cell's camera looks, and the feedback of the fingers
    comes from the cell's arm. `result.json` marks the run as a twin."""
    record: bool = True
    """Write all messages to `recording.mcap`; `dlokit info` reads it."""
    goal_at_m: tuple[float, float] | None = None
    """Move the middle of the goal to this place on the table, x and y [m]; e.g. 0.52 0 for a file whose curves are
    elsewhere. Without it, the goal is not moved."""
    fit_length: bool = False
    """Scale a goal or start to the rope's length; without it, a shape of another length is rejected."""
    ends_interchangeable: bool = False
    """Accept the goal with its ends exchanged."""
    beside: Annotated[str, tyro.conf.arg(metavar="SIDES", help_behavior_hint="(default: any)")] = ""
    """Posts to pass, and their sides, e.g. "-A +B". In the order along the DLO: + passes a post clockwise, seen from
    above, - counterclockwise, no sign within 13 mm on either side; docs/reference/beside.md."""
    calibration: Annotated[str, tyro.conf.arg(metavar="FILE")] = ""
    """Calibration that `dlokit calibrate` wrote for this camera; a file of another camera is refused. Without it, the
    camera's own is used."""
    task: TaskConfig = field(default_factory=TaskConfig)
    """When a task ends, and which optional steps it includes."""
    cell: CellConfig = field(default_factory=CellConfig)
    """The simulated cell, which replaces real hardware."""
    camera: AnyCamera = field(default_factory=SimulatedStereoConfig)
    """The camera."""
    driver: AnyRobotDriver = field(default_factory=SimulatedRobotConfig)
    """The driver that moves the arm."""
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)
    """Perception: from pictures to the DLO's points."""
    observer: ObserverConfig = field(default_factory=ObserverConfig)
    """The observer: from points to target points."""
    model: BelievedDlo = field(default_factory=BelievedDlo)
    """The system's model of the DLO."""
    planning: PlanningConfig = field(default_factory=PlanningConfig)
    """The planner, which chooses the next grasp."""
    robot: RobotConfig = field(default_factory=RobotConfig)
    """Heartbeats and clearances of the arms."""
    gate: GateConfig = field(default_factory=GateConfig)
    """Limits that every motion is checked against before it reaches an arm: workspace, tool speed, speed scale."""
    viewer: ViewerConfig = field(default_factory=ViewerConfig)
    """The browser viewer."""
    ros2: Ros2Config = field(default_factory=Ros2Config)
    """The connection to ROS 2."""
    installation: tyro.conf.Suppress[tyro.conf.Fixed[Installation]] = field(default_factory=Installation)
    """Poses of table, arms, camera and fixtures, from the files of `--installation` and `--fixtures`."""
    hosts: Annotated[tyro.conf.Suppress[tyro.conf.Fixed[NamedConfig | None]], HOSTS] = None
    """The machines of a live run on several, from the part [hosts] of a `--config` file; None: this machine alone."""

    def __post_init__(self) -> None:
        check_ranges(self)
        for arm in (self.arm,) if self.arm else {installed.model for installed in self.installation.arms}:
            check_arm_name(arm)
        if self.goal in BY_OPERATOR and self.headless:
            raise ConfigError(
                f"--goal {self.goal} needs the viewer, where the operator starts the task; omit --headless, or name a "
                "goal."
            )
        try:
            check_fixtures(self.cell.fixtures or (), self.installation.table)
        except ConfigError as error:
            raise ConfigError(f"cell.fixtures: {error}") from error
        parse_wish(self.beside, self.installation.fixtures)

    @property
    def arm_model(self) -> ArmModel:
        """The arm. Raises `ConfigError` or `MachineError` as `arm_model` does."""
        return self.mounts[0].model

    @property
    def has_cell(self) -> bool:
        """Whether the simulated cell is part of the run: its camera looks, or its arm moves."""
        return self.camera.sees_cell or (self.driver.in_cell and not self.dry_run)

    @property
    def moves_real_arm(self) -> bool:
        """Whether an arm outside the simulated cell moves."""
        return self.driver.is_real and not self.dry_run

    @property
    def mirrors_arm(self) -> bool:
        """Whether the cell's arm mirrors the arm of the driver, whose finger feedback then comes from the cell.

        Never with a camera that sees another world: finger feedback then comes from the real arm.
        """
        return self.twin and self.camera.sees_cell and not self.driver.in_cell and not self.dry_run

    @property
    def scene(self) -> Scene:
        """What the system believes to be around the DLO. Raises as `mounts` and `Scene`."""
        return Scene(table=self.installation.table, arms=self.mounts, fixtures=self.installation.fixtures)

    @property
    def wish(self) -> tuple[SideWish, ...]:
        """How the DLO is to pass posts."""
        return parse_wish(self.beside, self.installation.fixtures)

    @property
    def mounts(self) -> tuple[ArmMount, ...]:
        """The arms and their base poses. Raises `ConfigError` or `MachineError` as `Installation.mounts` does."""
        return self.installation.mounts(self.arms, self.arm)


UNKNOWN_STIFFNESS_LOG_SD = 2.3
"""Uncertainty of the default stiffness for a DLO of which only length and radius are known: two of these cover ropes
and the stiffest published wires, a hundred times as stiff."""


def with_dlo(run: RunConfig, dlo: DloPreset) -> RunConfig:
    """Put another DLO on the table, a chain if it bends plastically; the system's model gets only length and radius.

    A stiffness, or its uncertainty, that the run itself configures is kept.
    """
    if dlo == run.cell.dlo:
        return run
    physics = ElasticRod() if dlo.yield_curvature_1_m is None else ElastoplasticChain()
    belief, shipped = run.model.belief, BelievedDlo()
    if (run.model.bending_stiffness_n_m2, belief.stiffness_log_sd) == (
        shipped.bending_stiffness_n_m2,
        shipped.belief.stiffness_log_sd,
    ):
        belief = replace(belief, stiffness_log_sd=UNKNOWN_STIFFNESS_LOG_SD)
    model = replace(run.model, length_m=dlo.length_m, radius_m=dlo.radius_m, belief=belief)
    return replace(run, cell=replace(run.cell, dlo=dlo, physics=physics), model=model)
