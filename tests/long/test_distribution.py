"""The wheel in an empty environment, as its user installs it; `live/test_wheel.py` looks at what is in it."""

import re
import shlex
import subprocess
import venv
from pathlib import Path

import numpy as np
from built_wheel import LIMIT_S, ROOT, built_wheel, run, version_of
from page_code import blocks

HARNESS = ROOT.parent / "shared" / "data" / "harness"
"""Recorded clouds, which lie beside the repository, not in it."""

TRACK = """
import numpy as np
import dlokit

s = np.linspace(0.0, 0.5, 500)
cloud = np.column_stack([0.4 + 0.0 * s, s - 0.25, np.full(500, 0.005)])
nodes = dlokit.Tracker(length_m=0.5, radius_m=0.004).update(cloud, stamp_ns=0)
assert nodes.health > 0.5, nodes.health
"""


def test_the_wheel_works_in_an_empty_environment(tmp_path: Path) -> None:
    (tmp_path / "dist").mkdir()
    wheel = built_wheel(tmp_path / "dist")
    venv.create(tmp_path / "env", with_pip=True)
    python = str(tmp_path / "env" / "bin" / "python")
    command = str(tmp_path / "env" / "bin" / "dlokit")
    install = (python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")

    run(*install, str(wheel), cwd=tmp_path)
    plain_mb = size_mb(tmp_path / "env")
    assert run(command, "--version", cwd=tmp_path).split() == ["dlokit", version_of(wheel)]
    assert "decision" in run(command, "skills", cwd=tmp_path)
    run(python, "-c", TRACK, cwd=tmp_path)
    run(command, "track", *clouds(tmp_path), "--out", "tracked", cwd=tmp_path)
    assert (tmp_path / "tracked").is_dir()
    if HARNESS.is_dir():
        seen = [str(HARNESS / name) for name in ("test_cloud.pcd", "test_cloud_occluded.pcd")]
        initial = ("--initial", str(HARNESS / "Xinit.csv"), "--observer", "anchored")
        run(command, "track", *seen, *initial, "--out", "harness", cwd=tmp_path)
    for asked in ((command, "shape", "--goal", "S"), (python, "-c", "import dlokit; dlokit.shape()")):
        lacking = subprocess.run(asked, cwd=tmp_path, capture_output=True, text=True, timeout=LIMIT_S, check=False)
        assert lacking.returncode != 0
        (advice,) = re.findall(r"which is not installed: (.*)", lacking.stderr)

    run(*shlex.split(advice), "--quiet", "--disable-pip-version-check", cwd=tmp_path)
    assert plain_mb < 0.6 * size_mb(tmp_path / "env")
    run(command, "demo", "--headless", "--out", "run", cwd=tmp_path)
    assert (tmp_path / "run" / "report.html").is_file()
    shape, *_ = blocks("docs/tutorials/python.md")  # `test_tutorial_scripts.py` runs all
    assert "converged" in run(python, "-c", shape, cwd=tmp_path)
    assert (tmp_path / "run.png").is_file()


def clouds(folder: Path) -> list[str]:
    """Files with two clouds of a rod that moves."""
    s = np.linspace(0.0, 0.5, 800)
    names = ["cloud_0.npy", "cloud_1.npy"]
    for shift_m, name in zip((0.0, 0.01), names, strict=True):
        np.save(folder / name, np.column_stack([0.4 + shift_m + 0.02 * np.sin(12 * s), s - 0.25, np.full(800, 0.005)]))
    return names


def size_mb(folder: Path) -> float:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6
