"""LeRobot, in a process and an environment of its own: reads a data set as those who train do.

Run as a program it is that process, and imports nothing of dlokit: ``lerobot_peer.py FOLDER OUT.npz``. It iterates all
frames by a loader with batches, asks for frames before and after one, and reads the last episode alone.
"""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

PYTHON = Path(__file__).parents[2] / ".venv-lerobot" / "bin" / "python"
VIEW = "observation.images.left"
"""The view of which frames before and after one are asked for, where there is one."""
_BATCH = 16
_ENDS_S = 600.0


def why_not() -> str:
    """Why LeRobot cannot run here; empty where it can."""
    return "" if PYTHON.exists() else f"{PYTHON} does not exist: make test-peers"


def read_by_lerobot(folder: Path, scratch: Path) -> dict[str, np.ndarray]:
    """What LeRobot reads of a data set: arrays by name, pictures of `VIEW` as (T, height, width, 3), 0 to 255."""
    out = scratch / "read.npz"
    offline = os.environ | {"HF_HUB_OFFLINE": "1", "HF_HOME": str(scratch / "home")}
    subprocess.run((str(PYTHON), __file__, str(folder), str(out)), check=True, timeout=_ENDS_S, env=offline)
    with np.load(out, allow_pickle=False) as arrays:
        return dict(arrays)


def _main(folder: str, out: str) -> None:
    torch: Any = import_module("torch")
    datasets: Any = import_module("lerobot.datasets.lerobot_dataset")

    # The other backend, torchcodec, needs FFmpeg of the system.
    def opened(**settings: Any) -> Any:
        return datasets.LeRobotDataset("local/exported", root=folder, video_backend="pyav", **settings)

    dataset = opened()
    found: dict[str, list[Any]] = {}
    for batch in torch.utils.data.DataLoader(dataset, batch_size=_BATCH):
        for name, values in batch.items():
            found.setdefault(name, []).append(np.array(values))
    arrays = {name: np.concatenate(parts) for name, parts in found.items()}
    for name in dataset.meta.video_keys:
        arrays[name] = np.round(255.0 * arrays[name].transpose(0, 2, 3, 1)).astype(np.uint8)
    view = VIEW if VIEW in dataset.meta.video_keys else dataset.meta.video_keys[0]
    around = opened(delta_timestamps={"action": [0.0, 1.0 / dataset.fps], view: [-1.0 / dataset.fps, 0.0]})[5]
    last = opened(episodes=[dataset.meta.total_episodes - 1])
    arrays |= {
        "two_actions": around["action"].numpy(),
        "two_pictures": np.round(255.0 * around[view].numpy().transpose(0, 2, 3, 1)).astype(np.uint8),
        "frames_of_last": np.array(len(last)),
        "task_of_last": np.array(last[0]["task"]),
        "episodes": np.array(dataset.meta.total_episodes),
        "state_mean": np.array(dataset.meta.stats["observation.state"]["mean"]),
    }
    with Path(out).open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]


if __name__ == "__main__":
    _main(*sys.argv[1:])
