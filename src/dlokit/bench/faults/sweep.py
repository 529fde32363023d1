"""Runs that something happens to, one after the other, in a folder from which an interrupted sweep goes on."""

import asyncio
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from dlokit import __version__
from dlokit.bench.faults.judging import RunFinding
from dlokit.bench.faults.trial import FaultCase, finished, try_case
from dlokit.errors import InputError
from dlokit.system.config import RunConfig
from dlokit.system.results.run_folder import claim_run_folder
from dlokit.system.toml_config import to_plain

SWEEP_FILE = "faults.json"


def describe(config: RunConfig) -> dict[str, Any]:
    """What all runs of a sweep have in common."""
    common = replace(config, start="I", goal="S", runtime="live", headless=True)
    return {"bench": "faults", "version": __version__, "config": to_plain(common)}


def claim_faults_folder(folder: Path, config: RunConfig) -> None:
    """Take a folder for a sweep, or that of an interrupted one.

    Raises `InputError` when it holds something else, or runs of other settings.
    """
    described = msgspec.json.format(msgspec.json.encode(describe(config)), indent=2) + b"\n"
    path = folder / SWEEP_FILE
    if not path.is_file():
        claim_run_folder(folder)
        path.write_bytes(described)
    elif path.read_bytes() != described:
        raise InputError(
            f"--out {folder} holds runs of other settings, or of another version ({path}): repeat the command as it "
            "was, or name another folder."
        )


def run_faults(todo: Sequence[FaultCase], config: RunConfig, folder: Path) -> Iterator[tuple[FaultCase, RunFinding]]:
    """Every case as it is done, those that were finished before first; Ctrl-C ends the run that goes on."""
    left: list[FaultCase] = []
    for case in todo:
        done = finished(folder / case.folder_name)
        if done is None:
            left.append(case)
        else:
            yield case, done
    for case in left:
        yield case, asyncio.run(try_case(case, config, folder / case.folder_name))
