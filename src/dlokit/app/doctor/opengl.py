"""Check rendering with one small MuJoCo picture in a separate process.

A broken OpenGL may end the process instead of raising an error, hence the separate process. Running this module
renders the picture and prints the renderer's name.
"""

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from typing import cast

from dlokit.types.arrays import UInt8Array

_SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 0 2"/>
    <geom type="sphere" size="0.2" rgba="1 1 1 1"/>
    <camera name="eye" pos="0 0 1"/>
  </worldbody>
</mujoco>
"""
_SIZE_PX = 32
_ERROR_LINE = re.compile(r"^[\w.]*(Error|Exception)\b")


@dataclass(frozen=True, kw_only=True)
class OpenGLReport:
    """The result of rendering the picture."""

    works: bool
    text: str
    """The renderer's name, or the error."""


def probe_opengl(timeout_s: float = 60.0) -> OpenGLReport:
    """Render one small picture in a child process; never raises."""
    environment = dict(os.environ)
    if sys.platform.startswith("linux"):
        environment["MUJOCO_GL"] = "egl"
    try:
        child = subprocess.run(
            [sys.executable, "-m", "dlokit.app.doctor.opengl"],
            env=environment,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return OpenGLReport(works=False, text=f"rendering one picture did not finish within {timeout_s:.0f} s")
    if child.returncode == 0:
        return OpenGLReport(works=True, text=child.stdout.strip().splitlines()[-1])
    return OpenGLReport(works=False, text=f"{_cause(child.stderr)} (exit code {child.returncode})")


def _cause(stderr: str) -> str:
    """Extract the error from the child's output; destructors of a partly created context may print after it."""
    lines = [line for line in stderr.splitlines() if line.strip()]
    for number, line in enumerate(lines):
        if _ERROR_LINE.match(line):
            # Some messages start on the next line.
            return " ".join([line, *lines[number + 1 : number + 2]]) if line.endswith(":") else line
    return lines[-1].strip() if lines else "no message"


def _render() -> str:
    """Render the picture and return the renderer's name."""
    import mujoco  # Imported here, because MuJoCo selects its OpenGL back end on import.
    from OpenGL import GL

    model = mujoco.MjModel.from_xml_string(_SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, _SIZE_PX, _SIZE_PX) as renderer:
        renderer.update_scene(data, camera="eye")
        picture = renderer.render()
        name = cast("bytes", GL.glGetString(GL.GL_RENDERER))  # PyOpenGL declares it without a result
    check_picture(picture)
    return name.decode()


def check_picture(picture: UInt8Array) -> None:
    """Raise `RuntimeError` when a picture (height, width, 3) of the scene is empty."""
    if int(picture.max()) == int(picture.min()):
        raise RuntimeError("the picture is empty: OpenGL runs but draws nothing")


if __name__ == "__main__":
    print(_render())
