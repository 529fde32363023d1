"""The defaults of `dlokit shape`: those of a `--config` file, a DLO preset, and the chosen strategies.

They are read before the rest, so that the other arguments change them and `--help` shows them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from dlokit.app.shape import ShapeArgs, ShapeChoices
from dlokit.description.dlo import preset
from dlokit.errors import ConfigError
from dlokit.skills.observer.anchored import AnchoredConfig
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.observer.map_observer import MapConfig
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.colour import ColourConfig
from dlokit.system.config import RunConfig
from dlokit.system.toml_config import read_toml

T = TypeVar("T")

OBSERVERS: Mapping[str, type[AnchoredConfig | CpdConfig | MapConfig]] = {
    "anchored": AnchoredConfig,
    "cpd": CpdConfig,
    "map": MapConfig,
}
SEGMENTATIONS: Mapping[str, type[BrightnessConfig | ColourConfig]] = {
    "brightness": BrightnessConfig,
    "colour": ColourConfig,
}


def shape_defaults(arguments: Sequence[str]) -> ShapeArgs:
    """What holds where the other arguments say nothing. Raises `ConfigError`."""
    config_file = _value(arguments, "--config")
    run = RunConfig() if config_file is None else read_toml(Path(config_file), RunConfig)
    if (name := _value(arguments, "--dlo")) is not None:
        run = _with_dlo(run, name)
    if (name := _value(arguments, "--observer")) is not None:
        chosen = _one_of(OBSERVERS, "--observer", name)
        if type(run.observer.strategy) is not chosen:  # settings of the same strategy in the file stay
            run = replace(run, observer=replace(run.observer, strategy=chosen()))
    if (name := _value(arguments, "--segmentation")) is not None:
        wanted = _one_of(SEGMENTATIONS, "--segmentation", name)
        if type(run.perception.segmentation) is not wanted:
            run = replace(run, perception=replace(run.perception, segmentation=wanted()))
    return ShapeArgs(run=run, choices=ShapeChoices(config=None if config_file is None else Path(config_file)))


def _with_dlo(run: RunConfig, name: str) -> RunConfig:
    """Lay another DLO on the table; the system is told what a ruler tells, and no more."""
    dlo = preset(name)
    model = replace(run.model, length_m=dlo.length_m, radius_m=dlo.radius_m)
    return replace(run, cell=replace(run.cell, dlo=dlo), model=model)


def _value(arguments: Sequence[str], flag: str) -> str | None:
    """The last value of a flag, as argument parsers have it."""
    value: str | None = None
    for index, argument in enumerate(arguments):
        if argument == flag:
            if index + 1 == len(arguments):
                raise ConfigError(f"{flag} lacks its value; `dlokit shape --help` says what it takes.")
            value = arguments[index + 1]
        elif argument.startswith(f"{flag}="):
            value = argument.removeprefix(f"{flag}=")
    return value


def _one_of(table: Mapping[str, T], flag: str, name: str) -> T:
    if name not in table:
        raise ConfigError(f"{flag} {name!r} is not known; choose one of {', '.join(table)}.")
    return table[name]
