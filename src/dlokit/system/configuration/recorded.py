"""The configuration in a recording. It needs nothing of the simulated cell, so that any installation can read one."""

import logging
import tomllib
from collections.abc import Collection
from pathlib import Path

from dlokit.errors import InputError
from dlokit.recording.reader import RawRecording, toml_of
from dlokit.system.config import RunConfig
from dlokit.system.configuration.renamed import with_present_names
from dlokit.system.configuration.toml_config import from_plain, known_part

log = logging.getLogger(__name__)

RUN_KEYS = ("runtime", "arm", "arms", "installation", "beside")
"""Settings that determine the processes, arms and fixtures of a run, and how its DLO is to pass them."""


def recorded_toml(path: Path) -> str:
    """The `config.toml` of a recorded run. Raises `InputError`."""
    raw = RawRecording(path=path)
    next(iter(raw), None)  # the metadata is written first
    return toml_of(raw.metadata, path)


def recorded_config(path: Path, parts: Collection[str]) -> RunConfig:
    """The recorded configuration: its `parts`, and those of `RUN_KEYS`.

    The other parts may be of another version. Settings unknown to this version are omitted with a
    warning. Raises `InputError`.
    """
    text = recorded_toml(path)
    source = f"the configuration in {path}"
    try:
        plain = with_present_names(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{source} is not TOML ({error}); give the recording.mcap of a run's folder.") from error
    wanted = {name: value for name, value in plain.items() if name in (*RUN_KEYS, *parts)}
    known, unknown = known_part(wanted, RunConfig)
    if unknown:
        log.warning("%s has settings unknown to this version; they are omitted: %s", source, ", ".join(unknown))
    return from_plain(known, RunConfig, source)
