"""The distribution that a user installs: built of this tree, with hatchling."""

import subprocess
import sys
import tarfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
LIMIT_S = 1200.0


def built_wheel(folder: Path) -> Path:
    """A wheel in `folder`, built from the source distribution, not from the working tree."""
    run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(folder), cwd=ROOT)
    (source,) = folder.glob("dlokit-*.tar.gz")
    with tarfile.open(source) as archive:
        # An argument of `extractall` since Python 3.11.4; Debian 12 has 3.11.2, which ignores the attribute.
        archive.extraction_filter = getattr(tarfile, "data_filter", lambda member, path: member)
        archive.extractall(folder)
    tree = folder / source.name.removesuffix(".tar.gz")
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder), cwd=tree)
    (wheel,) = folder.glob("dlokit-*.whl")
    assert version_of(wheel) == source.name.removeprefix("dlokit-").removesuffix(".tar.gz")
    return wheel


def version_of(wheel: Path) -> str:
    return wheel.name.split("-")[1]


def run(*command: str, cwd: Path) -> str:
    """Run a command in a folder; returns what it printed."""
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
