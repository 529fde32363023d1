"""What all tests share."""

import os
import sys

# MuJoCo reads this once, when it is first imported; without a display only EGL can render.
if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")
