"""A sweep: every case once, on this machine or a cluster; an interrupted sweep continues from its folder."""

import importlib
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky.backend import resource_tracker

from dlokit import __version__
from dlokit.communication.zenoh.session import check_shared_memory
from dlokit.errors import ConfigError, InputError, MachineError, lacks_extra, pip_command
from dlokit.extras.bench.shaping.cases import CaseResult, ShapingCase
from dlokit.extras.bench.shaping.experiments import Experiment
from dlokit.extras.bench.shaping.runner import attempt_case, finished_case, runtime_of
from dlokit.extras.bench.shaping.suites import VERSION, fingerprint
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import to_plain
from dlokit.system.request import NOTHING_OWN, OwnStrategies
from dlokit.system.results.run_folder import claim_run_folder
from dlokit.system.shaping import Watcher
from dlokit.system.signals import terminal_signals_blocked
from dlokit.types.flow import RunOutcome

DASK, RAY = ("tcp://", "tls://"), "ray://"


def check_address(address: str) -> None:
    """Raise `ConfigError` for an address of neither Dask nor Ray; an empty one is this machine."""
    if address and not address.startswith((*DASK, RAY)):
        raise ConfigError(
            f"--cluster {address} is no address: tcp://HOST:PORT is Dask's scheduler, ray://HOST:PORT is Ray."
        )


@contextmanager
def cluster_backend(address: str, jobs: int) -> Generator[int]:
    """A context in which joblib runs at `address`; yields the number of processes to request, -1: all.

    `address` is empty for `jobs` processes of this machine, ``tcp://HOST:PORT`` for Dask's scheduler, or
    ``ray://HOST:PORT`` for Ray. Raises `ConfigError` for another address, `MachineError` if the package or the
    cluster is missing.
    """
    check_address(address)
    if not address:
        check_shared_memory()
        with terminal_signals_blocked():  # the pool's cleanup
            resource_tracker.ensure_running()
        # Fresh processes, not forked ones, whose OpenGL context would not be usable.
        with parallel_config(backend="loky"):
            yield jobs
    elif address.startswith(DASK):
        client = _dask(address)
        try:
            with parallel_config(backend="dask", client=client):
                yield -1
        finally:
            client.close()
    else:
        ray = _ray(address)
        try:
            with parallel_config(backend="ray"):
                yield -1
        finally:
            ray.shutdown()


def _dask(address: str) -> Any:
    distributed = _package("distributed", address)
    try:
        return distributed.Client(address, timeout="10s")
    except OSError as error:
        raise MachineError(
            f"No Dask scheduler answers at {address} ({error}); start one with `dask scheduler`."
        ) from error


def _ray(address: str) -> Any:
    ray = _package("ray", address)
    try:
        ray.init(address, log_to_driver=False)
    except ConnectionError as error:
        raise MachineError(f"No Ray cluster answers at {address} ({error}); see `ray start --head`.") from error
    _package("ray.util.joblib", address).register_ray()
    return ray


def _package(name: str, address: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        asked_by = f"--cluster {address}"
        if name.startswith("distributed"):
            raise lacks_extra(asked_by, "sweeps") from error
        raise MachineError(f"{asked_by} needs Ray, which is not installed: {pip_command('ray[client]')}") from error


SWEEP_FILE = "sweep.json"


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Processes or cluster that run the cases."""

    jobs: int = 1
    """Processes on this machine."""
    cluster: str = ""
    """Address of a Dask or Ray cluster whose workers run them instead."""
    watch: Watcher | None = None
    """Confirms the start of each run with a real arm and acknowledges Ctrl-C, where this process runs the cases."""


def claim_sweep_folder(
    folder: Path, config: RunConfig, suite: str, experiments: Sequence[Experiment], *, oracle: bool
) -> None:
    """Take a folder for a sweep, or the folder of one that was interrupted.

    Raises `InputError` if it contains a sweep with other settings, or other files. Seeds, planners and observers may
    differ: they make further cases of the same sweep.
    """
    described = describe(config, suite, experiments, oracle=oracle)
    path = folder / SWEEP_FILE
    if not path.is_file():
        claim_run_folder(folder)
        path.write_bytes(msgspec.json.format(msgspec.json.encode(described), indent=2) + b"\n")
        return
    try:
        before: dict[str, Any] = msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
    except msgspec.DecodeError as error:
        raise InputError(f"{path} is damaged ({error}); name another folder with --out.") from error
    now: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(described))
    if differing := [name for name in _leaves(now, before) if _at(now, name) != _at(before, name)]:
        name = differing[0]
        raise InputError(
            f"--out {folder} holds a sweep of other settings: there {'.'.join(name)} is {_at(before, name)}, here "
            f"{_at(now, name)}. Repeat the sweep with the settings it was begun with, or name another folder."
        )


def describe(config: RunConfig, suite: str, experiments: Sequence[Experiment], *, oracle: bool) -> dict[str, Any]:
    """Common settings of all cases of a sweep."""
    common = replace(config, start="I", goal="S", seed=0, runtime=runtime_of(config), headless=True)
    return {
        "bench": "shaping",
        "version": __version__,
        "suite": suite,
        "suite_version": VERSION,
        "experiments": fingerprint(experiments),
        "oracle": oracle,
        "config": to_plain(common),
    }


def run_sweep(
    todo: Sequence[ShapingCase],
    config: RunConfig,
    folder: Path,
    workers: Workers,
    own: OwnStrategies = NOTHING_OWN,
) -> Iterator[CaseResult]:
    """Every case when it ends, beginning with the finished ones; `own` are strategies of this program.

    Ctrl-C, also in the middle of a case, ends it with `KeyboardInterrupt`; finished cases stay. Raises
    `MachineError` when a process of this machine died.
    """
    left: list[ShapingCase] = []
    for case in todo:
        done = finished_case(case, folder / case.folder_name)
        if done is None:
            left.append(case)
        else:
            yield done
    for done in _run(left, config, folder.absolute(), workers, own):
        if done.result.outcome is RunOutcome.CANCELLED:
            raise KeyboardInterrupt
        yield done


def _run(
    todo: Sequence[ShapingCase], config: RunConfig, folder: Path, workers: Workers, own: OwnStrategies
) -> Iterator[CaseResult]:
    if workers.jobs == 1 and not workers.cluster:
        for case in todo:
            yield attempt_case(case, config, folder / case.folder_name, own, workers.watch)
        return
    calls = [delayed(attempt_case)(case, config, folder / case.folder_name, own) for case in todo]
    with cluster_backend(workers.cluster, workers.jobs) as jobs:
        parallel: Any = Parallel(n_jobs=jobs, return_as="generator_unordered")
        try:
            yield from parallel(calls)
        except BrokenExecutor as error:
            raise MachineError(
                f"A process of the sweep died, perhaps out of memory ({error}). Finished cases are kept: repeat "
                f"the command with --out {folder} and fewer --jobs."
            ) from error


def _leaves(*trees: dict[str, Any]) -> list[tuple[str, ...]]:
    """The paths of all values of nested dictionaries, each once."""
    paths: dict[tuple[str, ...], None] = {}
    for tree in trees:
        for key, value in tree.items():
            below = _leaves(value) if isinstance(value, dict) and value else [()]
            paths.update(dict.fromkeys((key, *rest) for rest in below))
    return list(paths)


def _at(tree: dict[str, Any], path: tuple[str, ...]) -> Any:
    value: Any = tree
    for key in path:
        value = value.get(key) if isinstance(value, dict) else None
    return value
