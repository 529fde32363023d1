"""Environment variables that must be set before MuJoCo, OpenBLAS and OpenCV are imported."""

import os
import platform

from dlokit.communication.timing.one_thread import ONE_THREAD


def prepare_environment() -> None:
    """Render without a display, and keep linear algebra on one thread."""
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
