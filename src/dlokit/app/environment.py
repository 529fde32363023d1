"""Environment variables that must be set before MuJoCo, Matplotlib, OpenBLAS and OpenCV are imported."""

import os
import platform

from dlokit.communication.timing.one_thread import ONE_THREAD


def prepare_environment() -> None:
    """Render without a display, draw without one, and keep linear algebra on one thread."""
    os.environ["MPLBACKEND"] = "agg"  # a notebook sets its own for every command that a cell starts
    if platform.system() == "Linux":
        # The cell opens EGL itself when it takes its first picture. MuJoCo loads no OpenGL on import, whatever the
        # shell sets for other programs: without a driver that import would end `dlokit doctor` too.
        os.environ["MUJOCO_GL"] = "disable"
        os.environ["PYOPENGL_PLATFORM"] = "egl"
    keep_to_one_thread()


def keep_to_one_thread() -> None:
    """Keep linear algebra on one thread, in this process and in those that it starts; the user's values are kept."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)
