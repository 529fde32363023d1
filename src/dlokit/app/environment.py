"""Environment variables that must be set before MuJoCo, OpenBLAS and OpenCV are imported."""

import os
import platform


def prepare_environment() -> None:
    """Render without a display, and keep linear algebra on one thread.

    The matrices here are small: more threads cost time, slow down parallel runs, and make sums depend on the number
    of threads. Values set by the user are kept.
    """
    if platform.system() == "Linux":
        # The cell opens EGL itself when it takes its first picture. MuJoCo loads no OpenGL on import, whatever the
        # shell sets for other programs: without a driver that import would end `dlokit doctor` too.
        os.environ["MUJOCO_GL"] = "disable"
        os.environ["PYOPENGL_PLATFORM"] = "egl"
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
