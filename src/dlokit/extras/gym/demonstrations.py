"""Demonstrations of the expert in `dlokit/Shape-v0`, one file per episode."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np

from dlokit.errors import ConfigError, InputError
from dlokit.extras.gym.shape import ShapeEnv
from dlokit.types.arrays import Float32Array, Float64Array

_SEEN = "observation."
"""Prefix of the names of observations in a file."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstration:
    """One episode of T steps."""

    observations: dict[str, Any]
    """Observations by name, (T + 1, …) each: before each step, and at the end."""
    actions: Float32Array  # (T, D)
    rewards: Float64Array  # (T,)
    rmse_m: Float64Array  # (T + 1,) [m]
    success: bool
    seed: int


def demonstrate(env: "gymnasium.Env[Any, Any]", seed: int) -> Demonstration:
    """Record one episode until the expert has no valid action. Raises `ConfigError` without an expert."""
    planner = env.unwrapped
    if not isinstance(planner, ShapeEnv):
        raise ConfigError(f"{type(planner).__name__} has no expert; dlokit/Shape-v0 has one.")
    seen, info = env.reset(seed=seed)
    observations, errors_m = [seen], [float(info["rmse_m"])]
    actions, rewards = list[Float32Array](), list[float]()
    ended = False
    while not ended and (action := planner.expert()) is not None:
        seen, reward, terminated, truncated, info = env.step(action)
        observations.append(seen)
        actions.append(action)
        rewards.append(float(reward))
        errors_m.append(float(info["rmse_m"]))
        ended = terminated or truncated
    size = cast(tuple[int, ...], planner.action_space.shape)
    return Demonstration(
        observations={name: np.stack([each[name] for each in observations]) for name in observations[0]},
        actions=np.array(actions, dtype=np.float32).reshape(-1, *size),
        rewards=np.array(rewards),
        rmse_m=np.array(errors_m),
        success=bool(info["is_success"]),
        seed=seed,
    )


def write_demonstrations(env: "gymnasium.Env[Any, Any]", seeds: Iterable[int], folder: Path | str) -> list[Path]:
    """Write an episode of the expert for each seed to ``demonstration-SEED.npz``; files that exist are kept.

    Raises `ConfigError` as `demonstrate` does.
    """
    paths: list[Path] = []
    Path(folder).mkdir(parents=True, exist_ok=True)
    for seed in seeds:
        path = Path(folder) / f"demonstration-{seed:06d}.npz"
        paths.append(path)
        if path.exists():
            continue
        done = demonstrate(env, seed)
        seen = {f"{_SEEN}{name}": values for name, values in done.observations.items()}
        partial = path.with_suffix(".part")
        with partial.open("wb") as file:
            np.savez_compressed(
                file,
                actions=done.actions,
                rewards=done.rewards,
                rmse_m=done.rmse_m,
                success=np.array(done.success),
                seed=np.array(done.seed),
                **seen,
            )
        partial.rename(path)  # an interrupted run leaves no half file
    return paths


def read_demonstrations(folder: Path | str) -> list[Demonstration]:
    """Read the demonstrations in a folder, by seed. Raises `InputError` if the folder has none."""
    paths = sorted(Path(folder).glob("demonstration-*.npz"))
    if not paths:
        raise InputError(f"{folder} has no demonstration-*.npz; write some with write_demonstrations.")
    return [_read(path) for path in paths]


def _read(path: Path) -> Demonstration:
    with np.load(path, allow_pickle=False) as arrays:
        return Demonstration(
            observations={name.removeprefix(_SEEN): arrays[name] for name in arrays.files if name.startswith(_SEEN)},
            actions=arrays["actions"],
            rewards=arrays["rewards"],
            rmse_m=arrays["rmse_m"],
            success=bool(arrays["success"]),
            seed=int(arrays["seed"]),
        )
