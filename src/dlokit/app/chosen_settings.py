"""The settings of a run that its flags choose by name: a `--config` file, a DLO preset, the strategies.

They are read before the rest, so that the other arguments change them and `--help` shows them.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from dlokit.communication.strategies import NamedConfig, StrategyKind
from dlokit.description.dlo import preset
from dlokit.errors import ConfigError
from dlokit.functional.cell.dlo_physics import PHYSICS
from dlokit.functional.cell.randomisation import RANDOMISED
from dlokit.skills.observer.strategies import OBSERVERS
from dlokit.skills.perception.segmentations import SEGMENTATIONS
from dlokit.skills.planning.strategies import PLANNERS
from dlokit.system.config import RunConfig, with_dlo
from dlokit.system.toml_config import read_toml

C = TypeVar("C", bound=NamedConfig)


def chosen_settings(arguments: Sequence[str], config_file: Path | None) -> RunConfig:
    """What holds where the other arguments say nothing. Raises `ConfigError`."""
    run = RunConfig() if config_file is None else read_toml(config_file, RunConfig)
    if (name := value_of(arguments, "--dlo")) is not None:
        run = with_dlo(run, preset(name))
    if (name := value_of(arguments, "--physics")) is not None:
        run = _with_physics(run, name)
    if "--randomised" in arguments:
        run = replace(run, cell=replace(run.cell, randomisation=RANDOMISED))
    if (name := value_of(arguments, "--observer")) is not None:
        observer = _chosen(OBSERVERS, "--observer", name, run.observer.strategy)
        run = replace(run, observer=replace(run.observer, strategy=observer))
    if (name := value_of(arguments, "--segmentation")) is not None:
        segmentation = _chosen(SEGMENTATIONS, "--segmentation", name, run.perception.segmentation)
        run = replace(run, perception=replace(run.perception, segmentation=segmentation))
    if (name := value_of(arguments, "--planner")) is not None:
        planner = _chosen(PLANNERS, "--planner", name, run.planning.strategy)
        run = replace(run, planning=replace(run.planning, strategy=planner))
    return run


def _with_physics(run: RunConfig, name: str) -> RunConfig:
    if name not in PHYSICS:
        raise ConfigError(f"--physics {name!r} is not known; choose one of {', '.join(PHYSICS)}.")
    return replace(run, cell=replace(run.cell, physics=PHYSICS[name]()))


def config_file_of(arguments: Sequence[str]) -> Path | None:
    """The file after `--config`."""
    name = value_of(arguments, "--config")
    return None if name is None else Path(name)


def value_of(arguments: Sequence[str], flag: str) -> str | None:
    """The last value of a flag, as argument parsers have it."""
    value: str | None = None
    for index, argument in enumerate(arguments):
        if argument == flag:
            if index + 1 == len(arguments):
                raise ConfigError(f"{flag} lacks its value; --help says what it takes.")
            value = arguments[index + 1]
        elif argument.startswith(f"{flag}="):
            value = argument.removeprefix(f"{flag}=")
    return value


def _chosen(kind: StrategyKind[C], flag: str, name: str, before: C) -> C:
    """The strategy of that name with its defaults; where it is the one of `before`, with its settings."""
    wanted = kind.named(name, flag)
    return before if type(before) is wanted else wanted()
