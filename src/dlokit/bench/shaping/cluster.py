"""Where a sweep's processes run: on this machine, or on a Dask or Ray cluster, by its address."""

import importlib
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from joblib import parallel_config

from dlokit.errors import ConfigError, MachineError

DASK, RAY = ("tcp://", "tls://"), "ray://"
_INSTALL = {"distributed": "pip install 'dlokit[sweeps]'", "ray": "pip install 'ray[client]'"}


def check_address(address: str) -> None:
    """Raise `ConfigError` where an address names neither Dask nor Ray; an empty one is this machine."""
    if address and not address.startswith((*DASK, RAY)):
        raise ConfigError(
            f"--cluster {address} is no address: tcp://HOST:PORT is Dask's scheduler, ray://HOST:PORT is Ray."
        )


@contextmanager
def cluster_backend(address: str, jobs: int) -> Generator[int]:
    """Have joblib run there meanwhile; gives the number of processes to ask it for, -1: as many as there are.

    `address` is empty for `jobs` processes of this machine, ``tcp://HOST:PORT`` for Dask's scheduler, or
    ``ray://HOST:PORT`` for Ray. Raises `ConfigError` for another, `MachineError` where the package or the cluster is
    missing.
    """
    check_address(address)
    if not address:
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
        package = name.split(".")[0]
        raise MachineError(f"--cluster {address} needs the package {package}: {_INSTALL[package]}.") from error
