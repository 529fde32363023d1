"""The configuration tree, which every process of a run and most commands load, loads none of what it configures."""

import subprocess
import sys

SCIPY = {f"scipy.{part}" for part in ("interpolate", "linalg", "ndimage", "optimize", "sparse", "spatial", "stats")}
"""`import scipy` alone is small: it loads each of these when it is first used."""
LARGE = {"numba", "mujoco", "cv2", "matplotlib", "cryptography", "OpenGL"} | SCIPY
HELP = (
    "settings must not wait for libraries: they stand beside the class that they build, whose module imports none that "
    "is large. Compiled functions have modules of their own (`mixture_kernels.py` beside `mixture.py`), imported where "
    "they are called; of SciPy write `import scipy` and, where it is used, `scipy.spatial.KDTree`; "
    "`python -X importtime -c 'import dlokit.system.config'` shows which it is"
)


def test_the_configuration_is_loaded_and_made_without_large_libraries() -> None:
    statement = "import sys; from dlokit.system.config import RunConfig; RunConfig(); print(*sys.modules)"
    listing = subprocess.run(
        [sys.executable, "-c", statement], check=True, capture_output=True, text=True, timeout=60.0
    )
    assert sorted(LARGE & set(listing.stdout.split())) == [], HELP
