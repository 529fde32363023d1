"""The methods of the bench: all installed observers with default settings, and published peers if installed.

pycpd 2.0 (extra `bench`) and probreg 0.3 implement coherent point drift (Myronenko and Song, TPAMI 2010). They get the
same cloud and the same prior, without pins, cameras and occlusions. Their settings were chosen with
`benchmarks/tuning.py` on other seeds than the reported ones. Lengths are in metres throughout.
"""

import importlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dlokit.errors import ConfigError, MachineError, install_command, pip_command
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategyConfig, nothing_seen
from dlokit.skills.observer.config import OURS, ObserverConfig, strategies
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.observer.som import SomConfig
from dlokit.skills.observer.spr import SprConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation

_FEWEST_POINTS = 3

_INSTALL = {
    "pycpd": install_command("bench"),
    # A source distribution with C++, and open3d, whose wheel wants libusb of the system.
    "probreg": f"sudo apt install g++ python3-dev libusb-1.0-0; {pip_command('probreg')}",
}


@dataclass(frozen=True, kw_only=True)
class PycpdConfig:
    """pycpd's non-rigid registration."""

    name: ClassVar[str] = "pycpd"

    beta_m: float = 0.8
    """Width of the kernel [m]."""
    alpha_per_m2: float = 3000.0
    """Weight of the smoothness of the motion [1/m²]."""
    outlier_weight: float = 0.05
    """w, the expected fraction of outliers."""
    initial_sigma_m: float = 0.03
    """Standard deviation of the Gaussians at the start [m]; 0: the package's own, from all pairs."""
    max_iterations: int = 50
    """Maximum number of iterations per frame."""
    tolerance_m2: float = 1e-8
    """The iteration ends when the variance changes by less than this [m²]."""

    def build(self, dlo: BelievedDlo) -> "Peer":
        """The peer with these settings. Raises `MachineError` when the package is missing."""
        package = imported("pycpd")

        def register(points: Float64Array, nodes: Float64Array) -> Float64Array:
            return package.DeformableRegistration(
                X=points,
                Y=nodes,
                alpha=self.alpha_per_m2,
                beta=self.beta_m,
                w=self.outlier_weight,
                sigma2=self.initial_sigma_m**2 if self.initial_sigma_m > 0.0 else None,
                max_iterations=self.max_iterations,
                tolerance=self.tolerance_m2,
            ).register()[0]

        return Peer(register)


@dataclass(frozen=True, kw_only=True)
class ProbregConfig:
    """probreg's non-rigid CPD; each frame starts from the mean distance of all pairs, which cannot be set."""

    name: ClassVar[str] = "probreg"

    beta_m: float = 1.44
    """Width of the kernel [m]."""
    lambda_per_m2: float = 320.0
    """Weight of the smoothness of the motion [1/m²]."""
    outlier_weight: float = 0.14
    """w, the expected fraction of outliers."""
    max_iterations: int = 50
    """Maximum number of iterations per frame."""
    tolerance_m2: float = 1e-8
    """The iteration ends when the variance changes by less than this [m²]."""

    def build(self, dlo: BelievedDlo) -> "Peer":
        """The peer with these settings. Raises `MachineError` when the package is missing."""
        package = imported("probreg.cpd")

        def register(points: Float64Array, nodes: Float64Array) -> Float64Array:
            # Its kernel is exp(-d² / (2 beta)): beta is the square of the width.
            cpd = package.NonRigidCPD(nodes, beta=self.beta_m**2, lmd=self.lambda_per_m2)
            result = cpd.registration(points, w=self.outlier_weight, maxiter=self.max_iterations, tol=self.tolerance_m2)
            return result.transformation.transform(nodes)

        return Peer(register)


class Peer:
    """Adapts the registration of a package to the observers' protocol."""

    def __init__(self, register: Callable[[Float64Array, Float64Array], Float64Array]) -> None:
        """`register` moves nodes (M, 3) [m] onto a cloud (N, 3) [m]; the cloud is the first argument."""
        self._register = register

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """Register the prior's nodes onto the cloud; all count as visible, as the method states no visibility."""
        points = np.asarray(seen.points_world, dtype=np.float64)
        if len(points) < _FEWEST_POINTS:
            return nothing_seen(seen, prior)
        nodes = np.asarray(self._register(points, prior.nodes_world), dtype=np.float64)
        return TargetPoints(stamp_ns=seen.stamp_ns, nodes_world=nodes, visible=np.ones(len(nodes), dtype=np.bool_))


PEERS: tuple[type[ObserverStrategyConfig], ...] = (PycpdConfig, ProbregConfig)
"""All peers of the bench."""


def missing(peer: type[ObserverStrategyConfig]) -> str | None:
    """Why a peer cannot run on this machine, as one line; None when it can."""
    try:
        peer().build(BelievedDlo())
    except MachineError as error:
        return str(error)
    return None


def imported(package: str) -> Any:
    """The package of a peer. Raises `MachineError` with the installation command if it is missing."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SyntaxWarning)  # pycpd compares numbers by `is`
            return importlib.import_module(package)
    except ImportError as error:
        name = package.partition(".")[0]
        raise MachineError(
            f"The peer {name} is not installed or cannot be loaded ({error}): install it with "
            f"`{_INSTALL.get(name, pip_command(name))}`, or omit it with --methods."
        ) from error


PINNED = ", pinned"
"""Suffix of the name of an observer that uses the grasped nodes as pins."""


PUBLISHED = (*(peer.name for peer in PEERS), CpdConfig.name, SprConfig.name, SomConfig.name)
"""Peer methods: packages, and dlokit's implementations of published methods."""


@dataclass(frozen=True, kw_only=True)
class ObserverMethod:
    """One observer, with or without the pins that a robot knows."""

    config: ObserverStrategyConfig
    pinned: bool = False

    @property
    def states_trust(self) -> bool:
        """Whether the method states its own health; the packages do not."""
        return not isinstance(self.config, PEERS)

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.config.name}{PINNED}" if self.pinned else self.config.name


@dataclass(frozen=True, kw_only=True)
class MethodChoice:
    """The methods to run, and the omitted ones with the reasons."""

    methods: tuple[ObserverMethod, ...]
    omitted: tuple[str, ...]


def default_name() -> str:
    """The name of the observer that the system uses by default."""
    return ObserverConfig().strategy.name


def choose(names: tuple[str, ...] = ()) -> MethodChoice:
    """The methods of these names, or all: observers without and with pins, peers only without.

    Those of the user and of other packages come first, then dlokit's, each in the order of the names. A peer that is
    not installed is omitted, unless it was requested. Raises `ConfigError` for a name that does not exist,
    `MachineError` for a requested peer that is missing.
    """
    observers = strategies()
    peers = {peer.name: peer for peer in PEERS}
    unknown = [name for name in names if name not in observers and name not in peers]
    if unknown:
        raise ConfigError(f"There is no observer {', '.join(unknown)}; choose from {', '.join([*observers, *peers])}.")
    methods: list[ObserverMethod] = []
    wanted = [name for name in names or observers if name in observers]
    for name in sorted(wanted, key=lambda name: observers[name] in OURS):
        config = observers[name]
        methods += [ObserverMethod(config=config()), ObserverMethod(config=config(), pinned=True)]
    omitted: list[str] = []
    for name, config in peers.items():
        if names and name not in names:
            continue
        reason = missing(config)
        if reason is None:
            methods.append(ObserverMethod(config=config()))
        elif names:
            raise MachineError(reason)
        else:
            omitted.append(reason)
    return MethodChoice(methods=tuple(methods), omitted=tuple(omitted))
