"""The cases: a base case, and one case for each changed factor."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from dlokit.errors import ConfigError
from dlokit.extras.bench.observers.conditions import Conditions
from dlokit.extras.bench.observers.pictures import PictureSettings, picture_sequence
from dlokit.extras.bench.observers.sequence import Sequence, read_sequence
from dlokit.extras.bench.observers.simulated import Motion, simulate

TUNING_SEED = 1000
"""First seed for tuning; reported results use the seeds from 0."""

SLOW = 0.25


@dataclass(frozen=True, kw_only=True)
class ObserverCase:
    """One row of the table: the motion, its speed, and the quality of the clouds."""

    name: str
    motion: Literal["base", "swing", "crossing"] = "base"
    """The base motions: two hands for even seeds, pick and place for odd ones."""
    pace: float = 1.0
    """Fraction of the full speed."""
    conditions: Conditions = field(default_factory=Conditions)
    extra: bool = False
    """Whether no bar applies, because no observer can detect this error."""
    pins: bool = True
    """Whether the places are known where grippers hold the DLO."""
    file: Path | None = None
    """An external sequence, which replaces the motion; it has one seed."""
    pictures: PictureSettings | None = None
    """How the DLO is found in the pictures of `file`, a recording; None: it is a .npz file."""

    def motion_of(self, seed: int) -> Motion:
        """The motion for a seed."""
        if self.motion == "base":
            return "two hands" if seed % 2 == 0 else "pick and place"
        return self.motion

    def sequence(self, seed: int, frames: int | None) -> Sequence:
        """The ground truth, at most `frames` long; only an external sequence has a length of its own (None)."""
        if self.file is not None and self.pictures is not None:
            return picture_sequence(self.file, self.pictures, frames)
        if self.file is not None:
            return read_sequence(self.file, frames)
        if frames is None:
            raise ConfigError(f"The case {self.name!r} is simulated: give its number of frames.")
        return simulate(self.motion_of(seed), seed, frames=frames, pace=self.pace)


BASE = ObserverCase(name="base")


def _with(name: str, conditions: Conditions) -> ObserverCase:
    return replace(BASE, name=name, conditions=conditions)


CASES: tuple[ObserverCase, ...] = (
    BASE,
    _with("hidden 0 %", Conditions(hidden=0.0)),
    _with("hidden 50 %", Conditions(hidden=0.5)),
    _with("hidden 70 %", Conditions(hidden=0.7)),
    _with("tip hidden", Conditions(place="tip")),
    _with("hidden, moving", Conditions(place="moving")),
    _with("noise 0.5 mm", Conditions(noise_m=0.0005)),
    _with("noise 4 mm", Conditions(noise_m=0.004)),
    _with("outliers 0 %", Conditions(outliers=0.0)),
    _with("outliers 20 %", Conditions(outliers=0.2)),
    replace(BASE, name="speed 1/4", pace=SLOW),
    replace(BASE, name="swing 1 m/s", motion="swing"),
    replace(BASE, name="crossing", motion="crossing"),
    _with("2000 points", Conditions(points=2000)),
    _with("dark for 1 s", Conditions(dark_s=1.0)),
    replace(
        _with("camera error", Conditions(camera_error_m=0.003, camera_error_rad=float(np.deg2rad(0.3)))), extra=True
    ),
)
"""Base: 30 % hidden in the middle, 2 mm, 5 % outliers, full speed, 1000 points."""


def external_cases(files: tuple[Path, ...], pictures: PictureSettings | None = None) -> tuple[ObserverCase, ...]:
    """One case per file with its own clouds or pictures, or one per hidden fraction with simulated clouds."""
    cases: list[ObserverCase] = []
    for file in files:
        if file.suffix != ".npz":
            pictures = pictures or PictureSettings()
            picture_sequence(file, pictures, 2)  # what cannot be read is refused before the first trial
            cases.append(ObserverCase(name=file.stem, file=file, pictures=pictures, pins=False))
            continue
        sequence = read_sequence(file)
        pins = sequence.pins_world is not None
        if sequence.clouds_world is not None:
            cases.append(ObserverCase(name=file.stem, file=file, pins=pins))
            continue
        cases += [
            ObserverCase(
                name=f"{file.stem}, hidden {100 * fraction:.0f} %",
                file=file,
                conditions=Conditions(hidden=fraction),
                pins=pins,
            )
            for fraction in (0.0, 0.3, 0.5, 0.7)
        ]
    return tuple(cases)
