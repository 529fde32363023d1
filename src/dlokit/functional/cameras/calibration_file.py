"""A camera's calibration as a TOML file that people can read and edit."""

import tomllib
from pathlib import Path
from typing import Any, get_args

import msgspec
import numpy as np
import tomli_w

from dlokit.errors import ConfigError
from dlokit.types.image import CameraCalibration


def read_calibration(path: Path) -> CameraCalibration:
    """The calibration in a file. Raises `ConfigError` when there is none, or it lacks something."""
    try:
        plain = tomllib.loads(path.read_text(encoding="utf-8"))
        return msgspec.convert(plain, CameraCalibration, dec_hook=_array)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
        raise ConfigError(
            f"calibration {path} cannot be used: {error}; it needs width_px, height_px, fx_px, fy_px, cx_px, cy_px, "
            "for a stereo pair baseline_m, and a table T_world_camera with position_m (3) and wxyz (4)"
        ) from error


def write_calibration(path: Path, calibration: CameraCalibration) -> None:
    """Write a file that `read_calibration` reads."""
    plain = msgspec.to_builtins(calibration, enc_hook=lambda value: np.asarray(value).tolist())
    path.write_text(tomli_w.dumps(_without_none(plain)), encoding="utf-8")


def _array(wanted: Any, value: Any) -> Any:
    dtype = get_args(get_args(wanted)[1])[0]
    return np.array(value, dtype=dtype)


def _without_none(table: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if value is not None}
