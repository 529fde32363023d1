"""What all tests share."""

import os
import signal
import sys

# MuJoCo reads this once, when it is first imported; without a display only EGL can render.
if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")

# A shell lets what runs in the background of a script ignore Ctrl-C; the tests of Ctrl-C mean it.
signal.signal(signal.SIGINT, signal.default_int_handler)
