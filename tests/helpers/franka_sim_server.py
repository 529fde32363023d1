"""franka-sim, a simulator of the FR3's protocol that enforces its limits, in a process and an environment of its own.

Run as a program it is that process, and imports nothing of dlokit: ``franka_sim_server.py ADDRESS MODELS OBJECT_M``. A
line on its standard input aborts the running motion with the error of that number, as a reflex of the arm.
"""

import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any, Self

PYTHON = Path(__file__).parents[2] / ".venv-franka-sim" / "bin" / "python"
ERRORS = {
    "joint_reflex": 6,
    "cartesian_reflex": 7,
    "joint_motion_generator_velocity_limits_violation": 13,
    "joint_motion_generator_velocity_discontinuity": 14,
    "joint_motion_generator_acceleration_discontinuity": 15,
    "controller_torque_discontinuity": 32,
}
"""Errors that the driver's motions cannot provoke in it, by libfranka's number: it has no contact reflexes, the driver
uses no motion generator, and franky limits the rate of torques."""
_STARTS_S = 30.0
_PORT = 1337
_FLANGE_M = 0.107
_HAND_M = 0.1034
_HAND_KG = 0.73
_HALF = 0.5**0.5  # the hand is turned by -45° about the flange's z


def why_not() -> str:
    """Why franka-sim cannot run here; empty where it can."""
    if not PYTHON.exists():
        return f"{PYTHON} does not exist: make test-peers"
    return "" if find_spec("franky_sim") else "franky_sim, whose model is used, is not installed: make test-peers"


class FrankaSimServer:
    """The simulator at an address of its own; a context manager. Communication and motion limits are enforced."""

    def __init__(self, folder: Path, address: str = "127.0.31.2", *, object_m: float = 0.0) -> None:
        """`folder` takes the models and the simulator's log; an object of `object_m` between the fingers, if not 0."""
        self.address = address
        self._object_m = object_m
        self._folder = folder
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        """Start it; returns when it listens."""
        _write_models(self._folder)
        self._log = (self._folder / "franka_sim.log").open("w", encoding="utf-8")
        self._process = subprocess.Popen(
            (str(PYTHON), __file__, self.address, str(self._folder), str(self._object_m)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
        )
        assert self._process.stdout is not None
        if not self._process.stdout.readline():
            raise RuntimeError(f"franka-sim did not start: {self.log()[-2000:]}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End it."""
        assert self._process is not None
        self._process.kill()
        self._process.communicate()
        self._log.close()

    def abort(self, name: str) -> None:
        """Abort the running motion with an error of `ERRORS`."""
        assert self._process is not None
        assert self._process.stdin is not None
        self._process.stdin.write(f"{ERRORS[name]}\n")
        self._process.stdin.flush()

    def kill(self) -> None:
        """As a control box that is switched off."""
        assert self._process is not None
        self._process.kill()
        self._process.wait()

    def log(self) -> str:
        """What the simulator has said."""
        return (self._folder / "franka_sim.log").read_text(encoding="utf-8")


def _write_models(folder: Path) -> None:
    """Cut the arm and the hand out of franky-sim's model of both, without what only pictures need."""
    found = find_spec("franky_sim")
    assert found is not None
    assert found.origin is not None
    assets = Path(found.origin).parent / "assets"
    whole = (assets / "fr3.xml").read_text(encoding="utf-8")
    for name in ("arm", "hand"):
        root = ElementTree.fromstring(whole)
        # Visual meshes, contacts of meshes and the models' own actuators play no part: torques are applied to joints.
        for tag in ("actuator", "tendon", "keyframe", "contact", "asset"):
            for part in root.findall(tag):
                root.remove(part)
        if name == "arm":
            for equality in root.findall("equality"):
                root.remove(equality)
        parents = {child: parent for parent in root.iter() for child in parent}
        for geom in list(root.iter("geom")):
            if geom in parents and parents[geom].tag == "body":
                parents[geom].remove(geom)
        hand = next(body for body in root.iter("body") if body.get("name") == "hand")
        parents[hand].remove(hand)
        if name == "hand":
            world = root.find("worldbody")
            assert world is not None
            for child in list(world):
                world.remove(child)
            hand.attrib.update(pos="0 0 0", quat="0 0 0 1", childclass="fr3")
            world.append(hand)
        (folder / f"{name}.xml").write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")


def _serve(address: str, folder: str, object_m: float) -> None:
    import threading

    os.environ.update(FR3_MJCF=f"{folder}/arm.xml", FRANKA_HAND_MJCF=f"{folder}/hand.xml")
    import numpy as np
    from franka_sim import FrankaSimServer as Server  # pyright: ignore
    from franka_sim.mujoco_franka_sim import MujocoFrankaSim  # pyright: ignore
    from franka_sim.server import lifecycle  # pyright: ignore

    class Handed(lifecycle.RobotState):  # pyright: ignore
        """An arm for which the hand was chosen as end effector in Desk."""

        def __init__(self) -> None:
            super().__init__()
            state: Any = self.state
            state["F_T_NE"] = [_HALF, -_HALF, 0, 0, _HALF, _HALF, 0, 0, 0, 0, 1, 0, 0, 0, _HAND_M, 1]
            state["m_ee"] = _HAND_KG

    class Flanged(MujocoFrankaSim):  # pyright: ignore
        """The flange is 107 mm beyond the model's last body, which franka-sim takes for the flange."""

        def update_ee_transform(self, f_t_ee: Any) -> None:
            super().update_ee_transform(f_t_ee)
            T = np.eye(4)
            T[2, 3] = _FLANGE_M
            self._f_t_ee = T @ self._f_t_ee

    class Remembering(Server):  # pyright: ignore
        """The arm reports the errors of its last motion; franka-sim adds those of all motions up."""

        def _abort_with_error(self, *args: Any, **kwargs: Any) -> None:
            self.robot_state.state["reflex_reason"] = [False] * 41
            super()._abort_with_error(*args, **kwargs)

    lifecycle.RobotState = Handed
    server: Any = Remembering(
        host=address,
        port=_PORT,
        physics_sim=Flanged(enable_hand=True),
        gripper_physics=True,
        gripper_object_width=object_m or None,
        enforce_comm_constraints=True,
        enforce_motion_limits=True,
    )
    parent = os.getppid()

    def listen() -> None:
        for line in sys.stdin:
            server._abort_with_error(int(line), "ordered by the test")

    def watch() -> None:
        deadline_s = time.monotonic() + _STARTS_S
        while not (server.running and server.server_socket is not None):
            if time.monotonic() > deadline_s:
                os._exit(1)
            time.sleep(0.05)
        print("listens", flush=True)
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(0)

    for work in (listen, watch):
        threading.Thread(target=work, daemon=True).start()
    server.start()


if __name__ == "__main__":
    import logging

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    _serve(sys.argv[1], sys.argv[2], float(sys.argv[3]))
