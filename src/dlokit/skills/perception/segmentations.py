"""The segmentation strategies there are, and how one travels over the bus: by name, with its settings.

Ours are members of a union, so that the command line shows them. Other packages add theirs by an entry point of the
group ``dlokit.segmentations`` that names a frozen dataclass with a method ``build() -> Segmentation``.
"""

import dataclasses
from importlib.metadata import entry_points
from typing import Any

import msgspec

from dlokit.errors import ConfigError
from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.colour import ColourConfig
from dlokit.types.strategy import StrategySpec

ENTRY_POINT_GROUP = "dlokit.segmentations"

OurSegmentation = BrightnessConfig | ColourConfig
"""Ours, as a choice on the command line and in configuration files."""

OURS: dict[str, type[Any]] = {"brightness": BrightnessConfig, "colour": ColourConfig}


def segmentation_configs() -> dict[str, type[Any]]:
    """Every installed strategy's settings, by name; ours cannot be replaced."""
    installed = {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP) if point.name not in OURS}
    return {**{name: installed[name].load() for name in sorted(installed)}, **OURS}


def encode_segmentation(config: SegmentationConfig) -> StrategySpec:
    """A strategy's name and settings. Raises `ConfigError` when it is not an installed one."""
    known = segmentation_configs()
    for name, wanted in known.items():
        if type(config) is wanted:
            return StrategySpec(name=name, settings=msgspec.json.encode(config))
    raise ConfigError(
        f"{type(config).__name__} is no installed segmentation; installed: {', '.join(known)}; "
        f"add it by an entry point in the group {ENTRY_POINT_GROUP!r}"
    )


def decode_segmentation(spec: StrategySpec) -> SegmentationConfig:
    """The settings that `spec` names. Raises `ConfigError` when the name or a setting is unknown or out of range."""
    known = segmentation_configs()
    if spec.name not in known:
        raise ConfigError(f"unknown segmentation {spec.name!r}; installed: {', '.join(known)}")
    wanted = known[spec.name]
    fields = [field.name for field in dataclasses.fields(wanted)]
    try:
        settings = msgspec.json.decode(spec.settings, type=dict[str, msgspec.Raw])
        unknown = sorted(set(settings) - set(fields))
        if unknown:
            raise ConfigError(
                f"segmentation {spec.name!r} has no setting {', '.join(unknown)}; it has: {', '.join(fields)}"
            )
        return msgspec.json.decode(spec.settings, type=wanted)
    except (msgspec.MsgspecError, ValueError) as error:
        raise ConfigError(f"settings of segmentation {spec.name!r}: {error}") from error
