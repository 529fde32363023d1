"""From the command line to a run: settings of the strategies chosen by name, start, goal and task.

Flags that choose by name are read first, so that other arguments change the settings and `--help` shows them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from dlokit.app.shape.inputs import is_file_name, shape_from_text
from dlokit.communication.strategies import NamedConfig, StrategyKind
from dlokit.decision.records import GoalRequest
from dlokit.description import shapes
from dlokit.description.dlo import preset
from dlokit.errors import ConfigError
from dlokit.functional.cameras.strategies import CAMERAS
from dlokit.functional.cell.config import EVERY_FACTOR, PHYSICS
from dlokit.functional.robots.strategies import DRIVERS
from dlokit.skills.observer.strategies import OBSERVERS
from dlokit.skills.perception.segmentations import SEGMENTATIONS
from dlokit.skills.planning.strategies import PLANNERS
from dlokit.system.config import BY_OPERATOR, SEEN, RunConfig, with_dlo
from dlokit.system.installation_file import with_installation
from dlokit.system.other_hosts import other_hosts
from dlokit.system.results.run_folder import HIDDEN_START
from dlokit.system.shaping import ShapeJob
from dlokit.system.toml_config import read_toml
from dlokit.types.arrays import Float64Array

C = TypeVar("C", bound=NamedConfig)


@dataclass(frozen=True, kw_only=True)
class NamedChoices:
    """What a user chooses by name; None leaves what is configured."""

    dlo: str | None = None
    physics: str | None = None
    randomised: bool = False
    installation: str | Path | None = None
    camera: str | None = None
    driver: str | None = None
    observer: str | None = None
    segmentation: str | None = None
    planner: str | None = None


NOTHING_CHOSEN = NamedChoices()


def chosen_settings(arguments: Sequence[str], config_file: Path | None) -> RunConfig:
    """The defaults of all other arguments. Raises `ConfigError`."""
    names = [field.name for field in fields(NamedChoices) if field.name != "randomised"]
    named: dict[str, Any] = {name: value_of(arguments, f"--{name}") for name in names}
    return configured(config_file, NamedChoices(randomised="--randomised" in arguments, **named), "--")


def configured(config_file: Path | str | None, choices: NamedChoices, prefix: str = "") -> RunConfig:
    """The configuration of a file, or the shipped one, as `with_choices` changes it."""
    run = RunConfig() if config_file is None else read_toml(Path(config_file), RunConfig)
    return with_choices(run, choices, prefix)


def with_choices(run: RunConfig, choices: NamedChoices, prefix: str = "") -> RunConfig:
    """The configuration with what was chosen by name. Raises `ConfigError`, which names `prefix` and the choice."""
    if choices.installation is not None:
        run = with_installation(run, Path(choices.installation))
    if choices.dlo is not None:
        run = with_dlo(run, preset(choices.dlo))
    if choices.physics is not None:
        run = _with_physics(run, choices.physics, f"{prefix}physics")
    if choices.randomised:
        run = replace(run, cell=replace(run.cell, randomised=EVERY_FACTOR))
    if choices.camera is not None:
        run = replace(run, camera=_chosen(CAMERAS, f"{prefix}camera", choices.camera, run.camera))
    if choices.driver is not None:
        run = replace(run, driver=_chosen(DRIVERS, f"{prefix}driver", choices.driver, run.driver))
    if choices.observer is not None:
        observer = _chosen(OBSERVERS, f"{prefix}observer", choices.observer, run.observer.strategy)
        run = replace(run, observer=replace(run.observer, strategy=observer))
    if choices.segmentation is not None:
        segmentation = _chosen(
            SEGMENTATIONS, f"{prefix}segmentation", choices.segmentation, run.perception.segmentation
        )
        run = replace(run, perception=replace(run.perception, segmentation=segmentation))
    if choices.planner is not None:
        planner = _chosen(PLANNERS, f"{prefix}planner", choices.planner, run.planning.strategy)
        run = replace(run, planning=replace(run.planning, strategy=planner))
    return run


def _with_physics(run: RunConfig, name: str, flag: str) -> RunConfig:
    if name not in PHYSICS:
        raise ConfigError(f"{flag} {name!r} is unknown; choose one of {', '.join(PHYSICS)}.")
    return replace(run, cell=replace(run.cell, physics=PHYSICS[name]()))


def file_after(flag: str, arguments: Sequence[str]) -> Path | None:
    """The file after `--config` or another flag."""
    name = value_of(arguments, flag)
    return None if name is None else Path(name)


def value_of(arguments: Sequence[str], flag: str) -> str | None:
    """The last value of a flag, as argument parsers interpret it."""
    value: str | None = None
    for index, argument in enumerate(arguments):
        if argument == flag:
            if index + 1 == len(arguments):
                raise ConfigError(f"{flag} has no value; --help lists the allowed values.")
            value = arguments[index + 1]
        elif argument.startswith(f"{flag}="):
            value = argument.removeprefix(f"{flag}=")
    return value


def _chosen(kind: StrategyKind[C], flag: str, name: str, before: C) -> C:
    """The strategy `name` with its defaults; if `before` is the same strategy, with the settings of `before`."""
    wanted = kind.named(name, flag)
    return before if type(before) is wanted else wanted()


def job_from_config(config: RunConfig) -> ShapeJob:
    """Read, draw or look up start and goal shapes. Raises `ShapeError`.

    The start has the length of the cell's DLO, the goal the length that the system believes. Without a cell there is no
    start: the system only looks.
    """
    name, start = f"to {Path(config.goal).name}", HIDDEN_START
    if config.has_cell:
        name = f"{Path(config.start).name} {name}"
        start = _shape(config, config.start, config.cell.dlo.length_m, config.cell.dlo.radius_m, stream=0)
    if config.goal in BY_OPERATOR:
        return ShapeJob(name=name, start_nodes_world=start, request=None, shown=config.goal == SEEN)
    model = config.model
    goal = _shape(
        config,
        config.goal,
        model.length_m,
        model.radius_m,
        stream=1,
        middle_m=config.goal_at_m,
        # A goal outside the table is rejected at once, unless it is to be moved or tried there.
        on_table=config.task.infeasible == "reject",
    )
    request = GoalRequest(nodes_world=goal, name=config.goal, ends_interchangeable=config.ends_interchangeable)
    return ShapeJob(name=name, start_nodes_world=start, request=request)


def with_absolute_files(config: RunConfig) -> RunConfig:
    """Replace file names by absolute paths, so that the configuration is valid in every folder."""
    elsewhere = other_hosts(config)
    hosts = None if elsewhere is None else elsewhere.absolute()
    calibration = str(Path(config.calibration).expanduser().absolute()) if config.calibration else ""
    return replace(
        config, start=_absolute(config.start), goal=_absolute(config.goal), calibration=calibration, hosts=hosts
    )


def _absolute(text: str) -> str:
    return str(Path(text).expanduser().absolute()) if is_file_name(text) else text


def _shape(
    config: RunConfig,
    text: str,
    length_m: float,
    radius_m: float,
    *,
    stream: int,
    middle_m: tuple[float, float] | None = None,
    on_table: bool = True,
) -> Float64Array:
    # Start and goal use separate random streams, so that one does not change the other.
    rng = np.random.default_rng([config.seed, stream])
    return shape_from_text(
        text,
        length_m=length_m,
        count=shapes.CURVE_POINTS,
        radius_m=radius_m,
        rng=rng,
        fit_length=config.fit_length,
        middle_m=middle_m,
        on_table=on_table,
    )
