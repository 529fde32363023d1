"""How often the expert succeeds in the environments to learn in, and how many steps a second they make.

    python benchmarks/environments.py
    python benchmarks/environments.py --parts expert --episodes 20
    python benchmarks/environments.py --parts rates --envs 4 --json rates.json

expert: the planner `rollout` acts in `dlokit/Shape-v0` from random starts to an S, in randomised cells: the task
`random to S` of `dlokit bench shaping --randomised` with the same seeds. rates: steps a second of both environments,
alone and as vectors of environments in one process (sync) and in processes of their own (async), without the time in
which actions are chosen; the time of a reset; and of restoring a saved state, as a multiple of the steps' time. Times
of the processor do not depend on what else the machine does, others do.
"""

from dlokit.app.environment import prepare_environment

prepare_environment()  # before anything below imports MuJoCo or NumPy's linear algebra

import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import gymnasium
import numpy as np
from rich.console import Console
from rich.table import Table

import dlokit.gym
from dlokit.errors import ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import Interval, bootstrap, success_rate
from dlokit.extras.gym.shape import ShapeEnv
from parts.command import check_json, run_study, write_figures

Part = Literal["expert", "rates"]
_NAMES = (dlokit.gym.SHAPE, dlokit.gym.SHAPE_SERVO)


@dataclass(frozen=True, kw_only=True)
class Args:
    """Measure success of the expert and steps a second of the environments."""

    parts: tuple[Part, ...] = ("expert", "rates")
    """What to measure."""
    episodes: int = 100
    """Episodes of the expert."""
    first_seed: int = 0
    """Seed of the first episode."""
    path: Literal["carry", "poses"] = "poses"
    """How an action gives its path. The numbers of a carry give no lay-downs, so the expert then makes none."""
    steps: int = 12
    """Steps of each environment whose time is measured."""
    envs: int = 2
    """Environments of a vector."""
    json: Path | None = None
    """Also write every figure to this file."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    if min(args.episodes, args.steps, args.envs) < 1:
        raise ConfigError("--episodes, --steps and --envs must be at least 1.")
    check_json(args.json)
    console, rows = Console(), list[BenchFigure]()
    if "expert" in args.parts:
        rows += _expert(args, console)
    if "rates" in args.parts:
        rows += _rates(args, console)
    table = Table(title="environments")
    for heading in ("case", "method", "metric", "value", "95 %", "unit", "n"):
        table.add_column(heading)
    for row in rows:
        interval = "-" if row.low is None or row.high is None else f"{row.low:.3g} to {row.high:.3g}"
        table.add_row(row.case, row.method, row.metric, f"{row.value:.3g}", interval, row.unit, str(row.n))
    console.print(table)
    config = {"path": args.path, "episodes": args.episodes, "first_seed": args.first_seed, "envs": args.envs}
    write_figures(args.json, "environments", rows, config, console)
    return 0


def _expert(args: Args, console: Console) -> list[BenchFigure]:
    """Success and actions of the expert."""
    env = gymnasium.make(dlokit.gym.SHAPE, start="random", goal="S", path=args.path, randomised=True)
    successes, actions = list[bool](), list[int]()
    try:
        for seed in range(args.first_seed, args.first_seed + args.episodes):
            info = _by_expert(env, seed)
            successes.append(bool(info["is_success"]))
            actions.append(int(info["steps"]))
            console.print(
                f"seed {seed}: {info['outcome'] or 'no valid action'}, {info['steps']} actions, "
                f"{info['rmse_m'] * 1000:.1f} mm; so far {sum(successes)} of {len(successes)}",
                highlight=False,
            )
    finally:
        env.close()
    case, rng = f"random to S, {args.path}", np.random.default_rng(0)
    return [
        figure(case, "expert", "success", success_rate(sum(successes), len(successes)), ""),
        figure(case, "expert", "mean actions", bootstrap(actions, rng), ""),
    ]


def _by_expert(env: "gymnasium.Env[Any, Any]", seed: int) -> dict[str, Any]:
    """The info of the last step of an episode."""
    planner = cast(ShapeEnv, env.unwrapped)
    _, info = env.reset(seed=seed)
    ended = False
    while not ended and (action := planner.expert()) is not None:
        _, _, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
    return info


def _rates(args: Args, console: Console) -> list[BenchFigure]:
    rows: list[BenchFigure] = []
    for name in _NAMES:
        for measure in (
            lambda name=name: _alone(name, args.steps),
            lambda name=name: _vectorised(name, "sync", args),
            lambda name=name: _vectorised(name, "async", args),
        ):
            made = measure()
            rows += made
            for row in made:
                console.print(f"{row.case}, {row.method}: {row.metric} {row.value:.3g} {row.unit}", highlight=False)
    return rows


def _alone(name: str, steps: int) -> list[BenchFigure]:
    """Steps a second, seconds a reset, and the cost of restoring."""
    env = gymnasium.make(name, **_settings(name))
    stopwatch, resets = _Stopwatch(), _Stopwatch()
    try:
        with resets.running():
            env.reset(seed=0)
        for number in range(steps):
            action = _action(name, number, lambda: cast(ShapeEnv, env.unwrapped).expert())
            with stopwatch.running():
                _, _, terminated, truncated, _ = env.step(action)
            if (terminated or truncated) and number + 1 < steps:
                with resets.running():
                    env.reset()
        unwrapped = cast(ShapeEnv, env.unwrapped)
        state = unwrapped.save()
        restoring = _Stopwatch()
        with restoring.running():
            unwrapped.restore(state)
    finally:
        env.close()
    repeated_s = resets.busy_s[-1] + sum(stopwatch.busy_s[-len(state.actions) :])
    return [
        figure(name, "alone", "steps a second", _rate(stopwatch.laps_s, 1), "1/s"),
        figure(name, "alone", "processor time of a step", bootstrap(stopwatch.busy_s, np.random.default_rng(0)), "s"),
        figure(name, "alone", "reset", bootstrap(resets.laps_s, np.random.default_rng(0)), "s"),
        figure(name, "alone", "processor time of a reset", bootstrap(resets.busy_s, np.random.default_rng(0)), "s"),
        figure(name, "alone", "restoring, of the time of its steps", _single(restoring.busy_s[0] / repeated_s), ""),
    ]


def _vectorised(name: str, mode: str, args: Args) -> list[BenchFigure]:
    """Steps a second of all environments together. Resets are not counted: an ended episode is not stepped on."""
    # This process has taken pictures: it cannot be forked.
    options = {"context": "spawn"} if mode == "async" else {}
    envs = gymnasium.make_vec(
        name, args.envs, vectorization_mode=mode, vector_kwargs=options, wrappers=None, **_settings(name)
    )
    stopwatch = _Stopwatch()
    try:
        envs.reset(seed=0)
        while len(stopwatch.laps_s) * args.envs < args.steps:
            actions = np.stack(
                [_action(name, len(stopwatch.laps_s), lambda each=each: each) for each in _asked(envs, name, args.envs)]
            )
            with stopwatch.running():
                _, _, terminated, truncated, _ = envs.step(actions)
            if np.any(terminated | truncated):
                envs.reset(seed=1000 + len(stopwatch.laps_s))
    finally:
        envs.close()
    return [figure(name, f"{args.envs}, {mode}", "steps a second", _rate(stopwatch.laps_s, args.envs), "1/s")]


def _settings(name: str) -> dict[str, Any]:
    """The cheap planner `farthest` gives actions that are executed."""
    return {"planner": "farthest"} if name == dlokit.gym.SHAPE else {}


def _asked(envs: Any, name: str, count: int) -> Sequence[Any]:
    return cast(Sequence[Any], envs.call("expert")) if name == dlokit.gym.SHAPE else [None] * count


def _action(name: str, number: int, expert: Callable[[], Any]) -> Any:
    """An action that moves the arm: of the expert, or to and fro while the DLO is held."""
    if name == dlokit.gym.SHAPE:
        action = expert()
        return np.zeros(7, dtype=np.float32) if action is None else action
    return np.array([0.3 if number % 2 else -0.3, 0.0, 0.0, 0.0, 1.0], dtype=np.float32)


class _Stopwatch:
    """Times of laps on the machine's clock, and of this process's processors."""

    def __init__(self) -> None:
        self.laps_s: list[float] = []
        self.busy_s: list[float] = []

    @contextmanager
    def running(self) -> Generator[None]:
        """Measure one lap."""
        began_s, busy_s = time.perf_counter(), time.process_time()
        yield
        self.laps_s.append(time.perf_counter() - began_s)
        self.busy_s.append(time.process_time() - busy_s)


def _rate(laps_s: Sequence[float], steps_a_lap: int) -> Interval:
    """Steps a second over all laps."""
    return bootstrap(laps_s, np.random.default_rng(0), statistic=lambda samples: steps_a_lap / np.mean(samples, axis=1))


def _single(value: float) -> Interval:
    return Interval(value=value, low=None, high=None, n=1)


if __name__ == "__main__":
    run_study(Args, run, __doc__)
