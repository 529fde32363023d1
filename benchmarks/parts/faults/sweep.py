"""A sweep of runs with faults, in a folder from which an interrupted sweep is continued."""

import asyncio
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from dlokit import __version__
from dlokit.errors import InputError
from dlokit.system.config import RunConfig
from dlokit.system.results.run_folder import claim_run_folder
from dlokit.system.toml_config import to_plain
from parts.faults.judging import RunFinding
from parts.faults.trial import FaultCase, finished, try_case

SWEEP_FILE = "faults.json"


def describe(config: RunConfig) -> dict[str, Any]:
    """Settings common to all runs of a sweep."""
    common = replace(config, start="I", goal="S", runtime="live", headless=True)
    return {"bench": "faults", "version": __version__, "config": to_plain(common)}


def claim_faults_folder(folder: Path, config: RunConfig) -> None:
    """Claim a folder for a new or an interrupted sweep.

    Raises `InputError` when it contains other files, or runs with other settings.
    """
    described = msgspec.json.format(msgspec.json.encode(describe(config)), indent=2) + b"\n"
    path = folder / SWEEP_FILE
    if not path.is_file():
        claim_run_folder(folder)
        path.write_bytes(described)
    elif path.read_bytes() != described:
        raise InputError(
            f"--out {folder} has runs with other settings, or of another version ({path}): repeat the original "
            "command, or name another folder."
        )


def run_faults(todo: Sequence[FaultCase], config: RunConfig, folder: Path) -> Iterator[tuple[FaultCase, RunFinding]]:
    """Yield every case when it is finished, earlier ones first; Ctrl-C ends the current run."""
    left: list[FaultCase] = []
    for case in todo:
        done = finished(folder / case.folder_name)
        if done is None:
            left.append(case)
        else:
            yield case, done
    for case in left:
        yield case, asyncio.run(try_case(case, config, folder / case.folder_name))
