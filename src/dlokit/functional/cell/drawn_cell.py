"""The random properties of the cell in one run.

Each factor has its own random stream, so that omitting one leaves the rest unchanged. The drawn values are ground
truth: they are in the result of a run, and never on the bus.
"""

import zlib
from dataclasses import dataclass, replace

import numpy as np

from dlokit.description.installation import PAPERS_CELL, Installation
from dlokit.description.scene import Fixture
from dlokit.functional.cell.config import CellConfig, Factor

_STREAM = 0xE9  # separates these draws from all other draws of the same seed
_FRICTION, _REGIONS, _STIFFNESS, _WEIGHT, _CURL, _HAND_EYE, _TILT, _LIGHT, _COLOR, _FIXTURES = range(10)

FRICTION = 0.25
"""Fraction by which the table's friction varies; 0.25 draws a factor from 1/1.25 to 1.25. The friction and stiffness of
two ropes of one kind vary as much."""
REGIONS = 0.15
"""Fraction by which the friction differs between the quarters of the table."""
STIFFNESS = 0.5
"""Fraction by which the DLO's bending stiffness varies."""
WEIGHT = 0.2
"""Fraction by which the DLO's mass per length varies."""
CURL_1_M = 0.5
"""Largest curvature without load [1/m], to either side."""
HAND_EYE_M = (0.002, 0.005)
"""Smallest and largest distance of the believed camera position from the true one [m]."""
TILT_DEG = 0.2
"""Largest tilt of the table about each of its axes [°]: a frame levelled with a spirit level."""
LIGHT = 0.15
"""Fraction by which the light varies."""
COLOR = 0.1
"""Largest difference of each colour channel of the DLO, of 1."""
FIXTURE_M, FIXTURE_DEG = 0.002, 1.0
"""Largest error of a fixture's position along x and y [m], and of its rotation about each axis [°]: a ruler's. Its
friction varies as much as the table's."""
FIXTURE_FRICTION = 0.35
"""Friction of the cell's fixtures against the DLO, of rope on hardwood. The installation's is the system's guess."""


@dataclass(frozen=True, kw_only=True)
class DrawnFixture:
    """The drawn values of one fixture."""

    name: str
    offset_m: tuple[float, float] = (0.0, 0.0)
    """Along x and y of the world; its foot stays on the table."""
    turned_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """About the x, the y, then the z axis of the world, around its foot."""
    friction_factor: float = 1.0


@dataclass(frozen=True, kw_only=True)
class DrawnCell:
    """The drawn values of one run; None and 1 keep the configured value."""

    friction_factor: float = 1.0
    friction_regions: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """Factors of the table's quarters: near right, near left, far right, far left of the robot."""
    stiffness_factor: float = 1.0
    weight_factor: float = 1.0
    curl_1_m: float | None = None
    hand_eye_m: float | None = None
    table_tilt_deg: tuple[float, float] = (0.0, 0.0)
    """Rotation about x and y."""
    light_factor: float = 1.0
    color_rgb: tuple[float, float, float] | None = None
    fixtures: tuple[DrawnFixture, ...] = ()


def draw_cell(config: CellConfig, seed: int, installation: Installation = PAPERS_CELL) -> DrawnCell:
    """Draw the properties in `config.randomised`, from the seed alone."""

    def only(factor: Factor, most: float) -> float:
        return most if factor in config.randomised else 0.0

    drawn_fixtures = installed_fixtures(config, installation) if "fixtures" in config.randomised else ()
    color = np.clip(_around(seed, _COLOR, COLOR, 3) + config.dlo.color_rgb, 0, 1)
    r, g, b = (float(channel) for channel in color)
    near_right, near_left, far_right, far_left = _factors(seed, _REGIONS, only("friction_regions", REGIONS), 4)
    tilt_x, tilt_y = (float(angle) for angle in _around(seed, _TILT, only("table_tilt", TILT_DEG), 2))
    return DrawnCell(
        friction_factor=_factors(seed, _FRICTION, only("friction", FRICTION), 1)[0],
        friction_regions=(near_right, near_left, far_right, far_left),
        stiffness_factor=_factors(seed, _STIFFNESS, only("stiffness", STIFFNESS), 1)[0],
        weight_factor=_factors(seed, _WEIGHT, only("weight", WEIGHT), 1)[0],
        curl_1_m=float(_around(seed, _CURL, CURL_1_M, 1)[0]) if "curl" in config.randomised else None,
        hand_eye_m=float(_rng(seed, _HAND_EYE).uniform(*HAND_EYE_M)) if "hand_eye" in config.randomised else None,
        table_tilt_deg=(tilt_x, tilt_y),
        light_factor=_factors(seed, _LIGHT, only("light", LIGHT), 1)[0],
        color_rgb=(r, g, b) if "color" in config.randomised else None,
        fixtures=tuple(_draw_fixture(seed, fixture.name) for fixture in drawn_fixtures),
    )


def installed_fixtures(config: CellConfig, installation: Installation) -> tuple[Fixture, ...]:
    """The cell's fixtures before anything is drawn: those of its settings, or the installation's as a ruler finds
    them, which does not measure friction."""
    if config.fixtures is not None:
        return config.fixtures
    return tuple(replace(fixture, friction=FIXTURE_FRICTION) for fixture in installation.fixtures)


def apply_drawn(config: CellConfig, drawn: DrawnCell) -> CellConfig:
    """The settings with the drawn DLO and camera error; friction, tilt and light of the table stay in the draw."""
    nominal = config.dlo
    dlo = replace(
        nominal,
        bending_stiffness_n_m2=nominal.bending_stiffness_n_m2 * drawn.stiffness_factor,
        mass_per_length_kg_m=nominal.mass_per_length_kg_m * drawn.weight_factor,
        friction=nominal.friction * drawn.friction_factor,
        curl_1_m=nominal.curl_1_m if drawn.curl_1_m is None else drawn.curl_1_m,
        color_rgb=nominal.color_rgb if drawn.color_rgb is None else drawn.color_rgb,
    )
    return replace(
        config,
        dlo=dlo,
        camera_error_m=config.camera_error_m if drawn.hand_eye_m is None else drawn.hand_eye_m,
        randomised=(),
    )


def _draw_fixture(seed: int, name: str) -> DrawnFixture:
    """From a stream of its name: other fixtures do not change it."""
    rng = np.random.default_rng([seed, _STREAM, _FIXTURES, zlib.crc32(name.encode())])
    x_m, y_m = (FIXTURE_M * float(part) for part in rng.uniform(-1.0, 1.0, 2))
    roll, pitch, yaw = (FIXTURE_DEG * float(part) for part in rng.uniform(-1.0, 1.0, 3))
    factor = (1.0 + FRICTION) ** float(rng.uniform(-1.0, 1.0))
    return DrawnFixture(name=name, offset_m=(x_m, y_m), turned_deg=(roll, pitch, yaw), friction_factor=factor)


def _rng(seed: int, stream: int) -> np.random.Generator:
    return np.random.default_rng([seed, _STREAM, stream])


def _around(seed: int, stream: int, most: float, count: int) -> np.ndarray:
    return most * _rng(seed, stream).uniform(-1.0, 1.0, count)


def _factors(seed: int, stream: int, fraction: float, count: int) -> list[float]:
    return [float(factor) for factor in np.exp(_around(seed, stream, float(np.log1p(fraction)), count))]
