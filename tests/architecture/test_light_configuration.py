"""The configuration tree, which every process of a run and most commands load, loads none of what it configures."""

import subprocess
import sys

LARGE = {"numba", "scipy", "mujoco", "cv2", "matplotlib", "cryptography"}
HELP = (
    "settings must not wait for libraries: move the class that brought one in to a file beside its algorithm "
    "(`cpd_config.py` beside `cpd.py`), and import the algorithm in `build`; "
    "`python -X importtime -c 'import dlokit.system.config'` shows which it is"
)


def test_the_configuration_is_loaded_and_made_without_large_libraries() -> None:
    statement = "import sys; from dlokit.system.config import RunConfig; RunConfig(); print(*sys.modules)"
    listing = subprocess.run(
        [sys.executable, "-c", statement], check=True, capture_output=True, text=True, timeout=60.0
    )
    assert sorted(LARGE & set(listing.stdout.split())) == [], HELP
