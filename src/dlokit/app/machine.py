"""What a run ran on."""

import os
import platform
from importlib.metadata import version

PACKAGES = ("dlokit", "mujoco", "numpy", "opencv-python-headless", "mink", "ruckig", "eclipse-zenoh")


def machine_facts() -> dict[str, str]:
    """Machine, interpreter and the versions that a result depends on."""
    facts = {
        "system": f"{platform.system()} {platform.machine()}",
        "cores": str(os.cpu_count()),
        "python": platform.python_version(),
    }
    return facts | {package: version(package) for package in PACKAGES}
