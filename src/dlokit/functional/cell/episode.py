"""What was drawn for one run, and the cell that follows from it.

Each factor has a random stream of its own, so that switching one off leaves the others as they were. What was drawn is
truth: it goes to the result of a run and on no bus.
"""

from dataclasses import dataclass, replace

import numpy as np

from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.randomisation import Randomisation

_STREAM = 0xE9  # keeps these draws apart from all others of the same seed
_FRICTION, _REGIONS, _STIFFNESS, _WEIGHT, _CURL, _HAND_EYE, _TILT, _LIGHT, _COLOR = range(9)


@dataclass(frozen=True, kw_only=True)
class Episode:
    """The values of one run; None and 1 leave what the configuration says."""

    friction_factor: float = 1.0
    friction_regions: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """Of the table's quarters: near right, near left, far right, far left of the robot."""
    stiffness_factor: float = 1.0
    weight_factor: float = 1.0
    curl_1_m: float | None = None
    hand_eye_m: float | None = None
    table_tilt_deg: tuple[float, float] = (0.0, 0.0)
    """About x and y."""
    light_factor: float = 1.0
    color_rgb: tuple[float, float, float] | None = None


def draw_episode(config: CellConfig, seed: int) -> Episode:
    """Draw what `config.randomisation` lets differ, from the seed alone."""
    wanted = config.randomisation
    r, g, b = (
        float(channel) for channel in np.clip(_around(seed, _COLOR, wanted.color, 3) + config.dlo.color_rgb, 0, 1)
    )
    near_right, near_left, far_right, far_left = _factors(seed, _REGIONS, wanted.friction_regions, 4)
    tilt_x, tilt_y = (float(angle) for angle in _around(seed, _TILT, wanted.table_tilt_deg, 2))
    hand_eye = _rng(seed, _HAND_EYE).uniform(wanted.hand_eye_from_m, wanted.hand_eye_to_m)
    return Episode(
        friction_factor=_factors(seed, _FRICTION, wanted.friction, 1)[0],
        friction_regions=(near_right, near_left, far_right, far_left),
        stiffness_factor=_factors(seed, _STIFFNESS, wanted.stiffness, 1)[0],
        weight_factor=_factors(seed, _WEIGHT, wanted.weight, 1)[0],
        curl_1_m=float(_around(seed, _CURL, wanted.curl_1_m, 1)[0]) if wanted.curl_1_m else None,
        hand_eye_m=float(hand_eye) if wanted.hand_eye_to_m else None,
        table_tilt_deg=(tilt_x, tilt_y),
        light_factor=_factors(seed, _LIGHT, wanted.light, 1)[0],
        color_rgb=(r, g, b) if wanted.color else None,
    )


def apply_episode(config: CellConfig, episode: Episode) -> CellConfig:
    """The cell of an episode: nothing is left to draw."""
    nominal = config.dlo
    near_right, near_left, far_right, far_left = np.multiply(config.table_regions, episode.friction_regions).tolist()
    tilt_x, tilt_y = np.add(config.table_tilt_deg, episode.table_tilt_deg).tolist()
    dlo = replace(
        nominal,
        bending_stiffness_n_m2=nominal.bending_stiffness_n_m2 * episode.stiffness_factor,
        mass_per_length_kg_m=nominal.mass_per_length_kg_m * episode.weight_factor,
        friction=nominal.friction * episode.friction_factor,
        curl_1_m=nominal.curl_1_m if episode.curl_1_m is None else episode.curl_1_m,
        color_rgb=nominal.color_rgb if episode.color_rgb is None else episode.color_rgb,
    )
    return replace(
        config,
        dlo=dlo,
        table_friction=config.table_friction * episode.friction_factor,
        table_regions=(near_right, near_left, far_right, far_left),
        table_tilt_deg=(tilt_x, tilt_y),
        light=config.light * episode.light_factor,
        camera_error_m=config.camera_error_m if episode.hand_eye_m is None else episode.hand_eye_m,
        randomisation=Randomisation(),
    )


def _rng(seed: int, stream: int) -> np.random.Generator:
    return np.random.default_rng([seed, _STREAM, stream])


def _around(seed: int, stream: int, most: float, count: int) -> np.ndarray:
    return most * _rng(seed, stream).uniform(-1.0, 1.0, count)


def _factors(seed: int, stream: int, share: float, count: int) -> list[float]:
    return [float(factor) for factor in np.exp(_around(seed, stream, float(np.log1p(share)), count))]
