"""The configuration tree, which every process of a run and most commands load, loads none of what it configures."""

import subprocess
import sys

SCIPY = {f"scipy.{name}" for name in ("interpolate", "linalg", "optimize", "sparse", "spatial", "special", "stats")}
"""What SciPy loads at the first use; by itself it is small."""
LARGE = {"numba", *SCIPY, "mujoco", "OpenGL", "cv2", "matplotlib", "cryptography"}
HELP = (
    "settings must not wait for libraries: import the one that was brought in where it is called, "
    "and SciPy's modules as attributes (`import scipy`, then `scipy.spatial.KDTree`); "
    "`python -X importtime -c 'import dlokit.system.config'` shows which it is"
)


def test_the_configuration_is_loaded_and_made_without_large_libraries() -> None:
    statement = "import sys; from dlokit.system.config import RunConfig; RunConfig(); print(*sys.modules)"
    listing = subprocess.run(
        [sys.executable, "-c", statement], check=True, capture_output=True, text=True, timeout=60.0
    )
    assert sorted(LARGE & set(listing.stdout.split())) == [], HELP
