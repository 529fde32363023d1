"""Arguments of the Python API as parts of the configuration of a run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from dlokit.errors import ConfigError
from dlokit.system.config import RunConfig
from dlokit.system.renamed import check_path
from dlokit.system.toml_config import from_plain, to_plain
from dlokit.types.arrays import as_numbers


def with_settings(config: RunConfig, settings: Mapping[str, Any]) -> RunConfig:
    """The configuration with some settings changed, e.g. ``{"task.threshold_m": 0.008}``; None unsets one.

    Raises `ConfigError` for a path or a value that is not allowed.
    """
    if not settings:
        return config
    plain = cast(dict[str, Any], to_plain(config))
    for path, value in settings.items():
        check_path(path)
        *parts, last = path.split(".")
        table = plain
        for part in parts:
            below = table.get(part)
            if not isinstance(below, dict):
                raise ConfigError(
                    f"there is no part {part!r} of the configuration in {path!r}; see `dlokit shape --help all`."
                )
            table = cast(dict[str, Any], below)
        if value is None:
            table.pop(last, None)
        else:
            table[last] = to_plain(value)
    return cast(RunConfig, from_plain(plain, RunConfig, "settings"))


def named_or_saved(shape: str | Path | ArrayLike, name: str, folder: Path) -> str:
    """A shape as the configuration takes it: a name, or a file; points are saved in `folder`. Raises `BadValue`."""
    if isinstance(shape, str | Path):
        return str(shape)
    path = (folder / f"{name}.npy").absolute()
    np.save(path, as_numbers(shape, name))
    return str(path)
