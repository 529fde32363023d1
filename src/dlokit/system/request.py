"""A user's request for a run, by names and paths of settings, and its conversion to a configuration.

The command line, the Python API, the environments and the benches make the same request.
"""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import Annotated, Any, TypedDict, cast, get_type_hints

import tyro

from dlokit.communication.strategies import StrategyKind
from dlokit.description.dlo import preset
from dlokit.errors import ConfigError
from dlokit.functional.cameras.strategies import CAMERAS
from dlokit.functional.cell.config import EVERY_FACTOR, PHYSICS, Factor
from dlokit.functional.robots.strategies import DRIVERS
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.config import OBSERVERS, OwnObserver, own_observer
from dlokit.skills.perception.config import SEGMENTATIONS
from dlokit.skills.planning.base import StrategyConfig
from dlokit.skills.planning.config import PLANNERS
from dlokit.skills.planning.own import OwnPlanner, own_planner
from dlokit.system.config import RunConfig, one_of, with_dlo
from dlokit.system.configuration.installation_file import with_fixtures, with_installation
from dlokit.system.configuration.renamed import check_path
from dlokit.system.configuration.toml_config import from_plain, read_toml, to_plain

AS_SHIPPED = RunConfig()


@dataclass(frozen=True)
class _Applied:
    """How a choice changes the configuration."""

    change: Callable[[RunConfig, Any, str], RunConfig]
    """(configuration, choice, the argument's name in messages) → configuration. Raises `ConfigError`."""


def _strategy(kind: StrategyKind[Any], *path: str) -> _Applied:
    """The strategy at a path of the configuration: by name with its defaults, or as given settings.

    A strategy that is configured already keeps its settings.
    """

    def change(run: RunConfig, choice: Any, argument: str) -> RunConfig:
        if isinstance(choice, str):
            wanted, before = kind.named(choice, argument), reduce(getattr, path, cast(Any, run))
            choice = before if type(before) is wanted else wanted()
        elif type(choice) not in kind.installed().values():
            raise ConfigError(
                f"{argument} is an object of type {type(choice).__name__}; give the name or the settings of an "
                f"installed {kind.purpose}. dlokit.shape and dlokit.bench also take planners and observers of your own."
            )
        return cast(RunConfig, _replaced(run, path, choice))

    return _Applied(change)


def _replaced(whole: Any, path: tuple[str, ...], value: object) -> Any:
    name, *below = path
    return replace(whole, **{name: _replaced(getattr(whole, name), tuple(below), value) if below else value})


def _installed(run: RunConfig, file: Path | str, argument: str) -> RunConfig:
    return with_installation(run, Path(file))


def _furnished(run: RunConfig, file: Path | str, argument: str) -> RunConfig:
    return with_fixtures(run, Path(file))


def _laid(run: RunConfig, name: str, argument: str) -> RunConfig:
    return with_dlo(run, preset(name))


def _simulated_by(run: RunConfig, name: str, argument: str) -> RunConfig:
    if name not in PHYSICS:
        raise ConfigError(f"{argument} {name!r} is unknown; choose one of {', '.join(PHYSICS)}.")
    return replace(run, cell=replace(run.cell, physics=PHYSICS[name]()))


def _randomised(run: RunConfig, wanted: bool | Sequence[Factor], argument: str) -> RunConfig:
    factors = EVERY_FACTOR if wanted is True else tuple(wanted or ())
    if unknown := sorted(set(factors) - set(EVERY_FACTOR)):
        raise ConfigError(f"{argument} has {', '.join(unknown)}; allowed are {', '.join(EVERY_FACTOR)}.")
    return replace(run, cell=replace(run.cell, randomised=factors or run.cell.randomised))


def _in_ros2(run: RunConfig, wanted: bool, argument: str) -> RunConfig:
    return replace(run, ros2=replace(run.ros2, publish=wanted or run.ros2.publish))


class Choices(TypedDict, total=False):
    """The choices that a user makes by name; None and omitted choices keep the configured value."""

    installation: Annotated[
        Path | str | None,
        tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: the paper's cell)"),
        _Applied(_installed),
    ]
    """File with the poses of table, arms and camera; docs/how-to/describe-an-installation.md describes it."""
    fixtures: Annotated[
        Path | str | None,
        tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: as installed)"),
        _Applied(_furnished),
    ]
    """File with posts and boxes on the table; docs/how-to/describe-fixtures.md."""
    dlo: Annotated[
        str | None, tyro.conf.arg(metavar="PRESET", help_behavior_hint="(default: soft_rope)"), _Applied(_laid)
    ]
    """DLO on the table, e.g. silicone_hose or wire_a. All are soft_rope, silicone_hose, wire_a, wire_b, wire_c,
    thin_wire and stiff_wire. The system's own model gets only its length and radius, as measured by a ruler."""
    physics: Annotated[
        str | None,
        tyro.conf.arg(metavar="NAME", help_behavior_hint="(default: chain for wires, else rod)"),
        _Applied(_simulated_by),
    ]
    """Simulated DLO: elastic rod or plastic chain. The system's own model is always a rod."""
    randomised: Annotated[
        bool | Sequence[Factor],
        tyro.conf.arg(constructor_factory=lambda: bool, help_behavior_hint=""),
        _Applied(_randomised),
    ]
    """Draw friction, light and more from the seed; also stiffness, weight, curl, hand-eye error, table tilt and
    colour. `--cell.randomised friction light` draws these alone."""
    camera: Annotated[str | None, one_of(CAMERAS, AS_SHIPPED.camera.name), _strategy(CAMERAS, "camera")]
    """Camera: simulated (stereo) or simulated-d435 (depth). The first is as in the paper; the second has
    the errors of a RealSense D435. `dlokit track --camera` also takes recorded pictures and real cameras."""
    driver: Annotated[str | None, one_of(DRIVERS, AS_SHIPPED.driver.name), _strategy(DRIVERS, "driver")]
    """Arm driver: simulated, kinematic or franka. The second is an arm in software, for use without a cell, the third a
    Franka Research 3; an installed package may add drivers."""
    observer: Annotated[
        str | OwnObserver | ObserverStrategyConfig | None,
        one_of(OBSERVERS, AS_SHIPPED.observer.strategy.name),
        _strategy(OBSERVERS, "observer", "strategy"),
    ]
    """How nodes are estimated: map, anchored, cpd, spr or som. The last three are the paper's;
    an installed package may add others. `--observer cpd --help observer` shows the settings of cpd."""
    segmentation: Annotated[
        str | None,
        one_of(SEGMENTATIONS, AS_SHIPPED.perception.segmentation.name),
        _strategy(SEGMENTATIONS, "perception", "segmentation"),
    ]
    """How DLO pixels are found: brightness or colour; brightness is the paper's, and an installed package may add
    others."""
    planner: Annotated[
        str | OwnPlanner | StrategyConfig | None,
        one_of(PLANNERS, AS_SHIPPED.planning.strategy.name),
        _strategy(PLANNERS, "planning", "strategy"),
    ]
    """How actions are chosen: rollout, farthest or farthest-tangent. The second is the paper's; an installed package
    may add others."""
    ros2: Annotated[
        bool,
        tyro.conf.arg(constructor_factory=lambda: bool, help_behavior_hint=""),
        _Applied(_in_ros2),
    ]
    """Publish the run in ROS 2; docs/how-to/use-from-ros2.md."""


SWITCHES = ("randomised", "ros2")
"""The choices that are yes or no."""


@dataclass(frozen=True, kw_only=True)
class RunRequest:
    """A user's request for a run."""

    config: Path | str | None = None
    """The config.toml of an earlier run, or a file with a part of one; the other fields take precedence. None: the
    default settings."""
    choices: Choices = field(default_factory=Choices)
    """The choices by name."""
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Further settings by their path, e.g. ``{"task.threshold_m": 0.008}``; None unsets one."""
    prefix: str = ""
    """Prefix of a choice's name in messages: ``--`` when it is a flag."""

    def configured(self) -> RunConfig:
        """The configuration. Raises `InputError` when the request cannot work."""
        return self.on(AS_SHIPPED if self.config is None else read_toml(Path(self.config), RunConfig))

    def on(self, run: RunConfig) -> RunConfig:
        """The configuration `run` with the request's choices and settings. Raises `InputError`."""
        choices = get_type_hints(Choices, include_extras=True)
        if unknown := sorted(set(self.choices) - set(choices)):
            raise ConfigError(f"nothing is chosen by the name {unknown[0]!r}; the choices are {', '.join(choices)}.")
        for name, choice in choices.items():
            if (value := self.choices.get(name)) is not None:
                (applied,) = (one for one in choice.__metadata__ if isinstance(one, _Applied))
                run = applied.change(run, value, f"{self.prefix}{name}")
        return with_settings(run, self.settings)


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


@dataclass(frozen=True, kw_only=True)
class OwnStrategies:
    """Objects by the names under which this process can look them up."""

    planners: Mapping[str, object] = field(default_factory=dict[str, object])
    observers: Mapping[str, object] = field(default_factory=dict[str, object])

    @contextmanager
    def known(self) -> Generator[None]:
        """Register them like installed ones while the context is open. Raises `ConfigError` for an unusable object."""
        planners = [own_planner(name, planner) for name, planner in self.planners.items()]
        observers = [own_observer(name, observer) for name, observer in self.observers.items()]
        with PLANNERS.given(planners), OBSERVERS.given(observers):
            yield


NOTHING_OWN = OwnStrategies()


def apart(choices: Choices) -> tuple[Choices, OwnStrategies]:
    """The choices, with the caller's objects replaced by the names of their classes; and these objects by name.

    Names and the settings of installed strategies stay as they are.
    """
    planner, observer = choices.get("planner"), choices.get("observer")
    own = OwnStrategies(planners=_by_class(planner, PLANNERS), observers=_by_class(observer, OBSERVERS))
    named: Choices = {
        **choices,
        "planner": next(iter(own.planners), planner),
        "observer": next(iter(own.observers), observer),
    }
    return named, own


def _by_class(choice: object, kind: StrategyKind[Any]) -> dict[str, object]:
    """The caller's object by the name of its class; empty for the name or the settings of an installed strategy."""
    installed = isinstance(choice, str | None) or type(choice) in kind.installed().values()
    return {} if installed else {type(choice).__name__: choice}
