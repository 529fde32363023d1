"""`dlokit.bench`: compare your planners and observers with dlokit's on the same cases."""

from __future__ import annotations  # or `help` spells out every member of `ArrayLike`

import re
import tempfile
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlokit.app.console import progress_console
from dlokit.app.library.shape import outside_any_loop
from dlokit.communication.strategies import StrategyKind
from dlokit.errors import InputError, require_cell
from dlokit.extras.bench.commands.observers import ObserverComparison, ObserversArgs, compare_observers
from dlokit.extras.bench.commands.shaping import ShapingArgs, ShapingComparison, compare, shaping_defaults
from dlokit.skills.observer.config import OBSERVERS
from dlokit.skills.planning.config import PLANNERS
from dlokit.system.request import Choices, OwnStrategies, RunRequest

Choice = str | Sequence[str] | Mapping[str, Any]
"""Names of installed strategies; or your names for objects, settings of strategies, or installed strategies."""

_NAME = re.compile(r"[\w.+-]+")


def shaping(
    planners: Choice = (),
    observers: Choice = (),
    *,
    suite: str = "paper",
    goals: str | PathLike[str] | ArrayLike | None = None,
    seeds: int | None = None,
    first_seed: int = 0,
    randomised: bool = False,
    oracle: bool = False,
    quick: bool = False,
    jobs: int = 1,
    installation: str | PathLike[str] | None = None,
    settings: Mapping[str, Any] | None = None,
    json: str | PathLike[str] | None = None,
    out: str | PathLike[str] | None = None,
    progress: bool = True,
) -> ShapingComparison:
    """Compare planners and observers on the same starts, goals and cells, judged by the ground truth.

    With a camera and a driver in `settings` other than the cell, the arm moves, and the system's own estimate judges;
    objects of this program are then refused, because the processes of a live run do not have them.

    `planners` and `observers` are names of installed ones (``["rollout", "farthest"]``), or map your names to
    objects: a planner has ``propose(shape, goal, marks, tools)``, an observer ``estimate(seen, prior)``; the settings
    of an installed strategy, and its name, are allowed as well. Each run gets its own copies. `suite` is
    ``"paper"``, ``"stiffness"`` or ``"wires"``; `goals`, curves (G, K, 3) [m] or a .npy file of them, is your own
    suite. `seeds` is their number for each experiment, 5 if not given, from `first_seed` on. `randomised` draws
    the cell from each seed; `oracle` gives planners the true state; `quick` takes fewer seeds and experiments. `jobs`
    runs are executed in parallel, each in its own process. `installation` and `settings` are those of `dlokit.shape`,
    for every run. `json` is a file for all figures, `out` the folder of the runs; with the folder of an interrupted
    comparison, that comparison continues.

    Works in a running event loop, which it blocks. Ctrl-C keeps the finished runs. A run that fails with an error is
    a result with a `fault`. Raises `InputError` before the first run for an argument that cannot work.
    """
    require_cell("dlokit.bench.shaping")
    with tempfile.TemporaryDirectory() as temporary:
        own = OwnStrategies(planners=_own(planners, PLANNERS), observers=_own(observers, OBSERVERS))
        args = ShapingArgs(
            suite=(suite,) if goals is None else ("goals", str(_file(goals, Path(temporary)))),
            seeds=seeds,
            first_seed=first_seed,
            planner=",".join(_names(planners)),
            observer=",".join(_names(observers)),
            randomised=randomised,
            oracle=oracle,
            quick=quick,
            jobs=jobs,
            json=None if json is None else Path(json),
            out=None if out is None else Path(out),
            run=shaping_defaults(
                RunRequest(
                    choices=Choices(installation=None if installation is None else Path(installation)),
                    settings=settings or {},
                )
            ),
        )
        interrupted = Event()
        with own.known():
            return outside_any_loop(
                lambda: compare(args, progress_console(progress), own, interrupted.is_set), interrupted.set
            )


def observers(
    observers: Choice = (),
    *,
    cases: Sequence[str] = (),
    sequences: Sequence[str | PathLike[str]] = (),
    seeds: int | None = None,
    frames: int | None = None,
    quick: bool = False,
    jobs: int = 1,
    json: str | PathLike[str] | None = None,
    out: str | PathLike[str] | None = None,
    progress: bool = True,
) -> ObserverComparison:
    """Compare observers on the same clouds, whose nodes are known.

    `observers` are names of installed ones and of published peers (``["map", "pycpd"]``), all by default; or map your
    names to objects with ``estimate(seen, prior)``, settings of an observer, or installed names. An object may
    keep a state: each trial gets a copy. Yours come first in the tables. `cases` are the simulated ones to run, e.g.
    ``["base", "hidden 50 %"]``, all by default. `sequences` are .npz files to use instead of the simulated ones.
    `seeds` is their number for each case, 10 if not given, `frames` the largest length of a sequence; `quick` takes
    fewer of both. With more than one of `jobs` the times are not comparable. `json` is a file for all figures, `out` a
    folder for the plots. The result shows the tables where it is printed.

    Works in a running event loop. Ctrl-C gives the figures of the finished trials. Raises `InputError` before the first
    trial for an argument that cannot work.
    """
    require_cell("dlokit.bench.observers")
    own = OwnStrategies(observers=_own(observers, OBSERVERS))
    args = ObserversArgs(
        quick=quick,
        seeds=seeds,
        frames=frames,
        cases=(cases,) if isinstance(cases, str) else tuple(cases),
        sequence=(tuple(Path(path) for path in sequences),) if sequences else (),
        methods=",".join(_names(observers)),
        jobs=jobs,
        json=None if json is None else Path(json),
        out=None if out is None else Path(out),
    )
    with own.known():
        found, _ = compare_observers(args, progress_console(progress))
    return found


def _names(choice: Choice) -> tuple[str, ...]:
    names = (choice,) if isinstance(choice, str) else tuple(choice)
    for name in names:
        if not _NAME.fullmatch(str(name)):
            raise InputError(f"{name!r} is not a name; give letters, digits, and any of . _ + -")
    return names


def _own(choice: Choice, kind: StrategyKind[Any]) -> dict[str, Any]:
    """The objects among the chosen strategies, and the settings of installed ones under another name."""
    if not isinstance(choice, Mapping):
        return {}
    _names(choice)
    return {
        name: kind.named(chosen, kind.purpose)() if isinstance(chosen, str) else chosen
        for name, chosen in choice.items()
        if name != chosen
    }


def _file(goals: str | PathLike[str] | ArrayLike, folder: Path) -> Path:
    if isinstance(goals, str | PathLike):
        return Path(goals)
    path = folder / "goals.npy"
    np.save(path, np.asarray(goals, dtype=np.float64))
    return path
