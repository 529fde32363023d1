"""`dlokit doctor franka` with a scripted operator and an arm in software."""

import asyncio
from collections.abc import Callable, Collection
from pathlib import Path
from types import TracebackType

import numpy as np
import pytest

from dlokit.app.doctor.machine import DoctorRow, Severity
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.arm.franka import FR3
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import ConfigError, HardwareError
from dlokit.extras.franka.doctor import FirstStart, FrankaDoctorArgs, exit_code, real_time_kernel, run
from dlokit.extras.franka.driver import FrankaRobotConfig
from dlokit.functional.robots.kinematic import KinematicRobot
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_file import with_installation
from dlokit.types.robot import GripResult, Lease, RobotState

STEPS = (
    "network",
    "library",
    "real time",
    "connection",
    "thresholds",
    "self-test",
    "camera",
    "calibration",
    "gripper",
    "stop",
    "arm's button",
    "dry run",
    "first grasp",
)

ADDRESS = "192.0.2.1"  # reserved for documentation: nobody has it


class SoftArm(KinematicRobot):
    """An FR3 in software, which may have a flaw."""

    def __init__(self, flaw: str = "", mount: ArmMount | None = None) -> None:
        super().__init__(LoopClock(), mount or ArmMount(model=FR3))
        self._flaw = flaw
        self.closed = False

    def read_back(self) -> str:
        return "mode idle"

    async def __aenter__(self) -> "SoftArm":
        if self._flaw == "connection":
            raise HardwareError("no connection to the arm")
        await super().__aenter__()
        self.closed = False
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.left = self.state()
        self.closed = True

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        result = await super().grip(width_m, force_n, lease)
        return GripResult(width_m=0.01, held=True) if self._flaw == "gripper" and width_m == 0.0 else result

    async def stop(self) -> None:
        if self._flaw == "stop":
            await self.halt()
        else:
            await super().stop()


def answers(address: str) -> None:
    """A computer answers at every address."""


def begun(
    arm: SoftArm,
    noes: Collection[str] = (),
    at: Callable[[str], None] | None = None,
    network: Callable[[str], None] = answers,
) -> list[DoctorRow]:
    """The rows; the operator says no to steps and questions that contain one of `noes`, and yes to the rest."""
    said: list[str] = [""]

    async def ask(question: str) -> bool:
        if at is not None:
            at(said[-1] + question)
        step = said[-1] if question.startswith("Go on") else question
        return not any(no in step for no in noes)

    args = FrankaDoctorArgs(driver=FrankaRobotConfig(address=ADDRESS, real_time=False))

    async def main() -> list[DoctorRow]:
        return await FirstStart(args, ask, said.append, arm, network).rows()

    return virtual_time.run(main())


SIMULATOR = ("arm's button", "that a self-test is due")
"""What an operator says no to at a simulator."""


def standing(rows: list[DoctorRow]) -> dict[str, str]:
    assert tuple(row.what for row in rows) == STEPS
    return {row.what: row.standing.value for row in rows}


def test_every_step_is_done_or_named_as_skipped_with_the_reason() -> None:
    arm = SoftArm()
    rows = begun(arm, SIMULATOR)
    skipped = {row.what: row.found for row in rows if row.standing is Severity.SKIPPED}
    assert skipped == {
        "real time": skipped["real time"],
        "camera": "no real camera is configured: --installation FILE names one",
        "calibration": "no --installation FILE names one",
        "arm's button": "the operator said no",
    }
    assert "not asked for (--driver.no-real-time, for simulators only)" in skipped["real time"]
    named = {row.what: row for row in rows}
    assert "latched until enabled" in named["stop"].found
    assert named["first grasp"].standing is Severity.ADVICE  # fingers in software close on nothing
    assert exit_code(rows) == 0
    assert arm.closed
    np.testing.assert_allclose(arm.left.q_rad, FR3.home_q_rad, atol=1e-3)


@pytest.mark.parametrize("flaw", ["connection", "gripper", "stop"])
def test_nothing_is_done_after_a_step_that_failed_and_it_says_what_to_do(flaw: str) -> None:
    rows = begun(SoftArm(flaw), SIMULATOR)
    at = STEPS.index(flaw)
    assert standing(rows)[flaw] == "lacking"
    assert rows[at].fix
    assert all(row.found == f"not reached: {flaw} failed" for row in rows[at + 1 :])
    assert exit_code(rows) == 1


def test_without_a_tested_stop_the_arm_makes_no_dry_run_and_no_grasp() -> None:
    rows = begun(SoftArm(), (*SIMULATOR, ", stop."))
    named = {row.what: row.found for row in rows}
    assert named["dry run"] == named["first grasp"] == "not reached without stop"


def test_an_arm_that_the_operator_did_not_see_move_is_not_used() -> None:
    rows = begun(SoftArm(), (*SIMULATOR, "Did the arm move, and stop?"))
    named = {row.what: row for row in rows}
    assert named["stop"].standing is Severity.LACKING
    assert named["dry run"].found == "not reached: stop failed"


def test_a_self_test_that_is_due_ends_it() -> None:
    named = {row.what: row for row in begun(SoftArm(), ("arm's button",))}
    assert named["self-test"].fix == "run it in Desk, then start this command again"


def test_an_address_that_does_not_answer_is_named() -> None:
    def nobody(address: str) -> None:
        raise TimeoutError(f"{address} timed out")

    rows = begun(SoftArm(), network=nobody)
    assert rows[0].found == f"{ADDRESS} does not answer: {ADDRESS} timed out"
    assert "check cable, power and --driver.address" in rows[0].fix


@pytest.mark.live
@pytest.mark.parametrize(("address", "found"), [("127.0.0.1", "answers after"), ("no-arm.invalid", "does not answer")])
def test_the_network_is_asked_for_the_address_itself(address: str, found: str) -> None:
    async def yes_to_the_network(question: str) -> bool:
        return "network" in said[-1]

    said: list[str] = [""]
    args = FrankaDoctorArgs(driver=FrankaRobotConfig(address=address, real_time=False))
    rows = virtual_time.run(FirstStart(args, yes_to_the_network, said.append, SoftArm()).rows())
    assert rows[0].found.startswith(f"{address} {found}")


def test_an_interrupt_leaves_the_arm_at_rest_and_closed() -> None:
    arm = SoftArm()
    states: list[RobotState] = []

    def interrupt(question: str) -> None:
        if "dry run" in question:
            states.append(arm.state())
            raise asyncio.CancelledError

    with pytest.raises(asyncio.CancelledError):
        begun(arm, SIMULATOR, at=interrupt)
    assert states
    assert arm.closed


def test_in_an_installation_the_arm_comes_down_in_front_of_its_base(tmp_path: Path) -> None:
    file = tmp_path / "lab.toml"
    file.write_text(
        '[[arms]]\nmodel = "fr3"\nposition_m = [0.2, -0.3, 0.1]\nrpy_deg = [0.0, 0.0, 90.0]\n', encoding="utf-8"
    )
    said: list[str] = []

    async def ask(question: str) -> bool:
        return not any(no in said[-1] + question for no in SIMULATOR)

    args = FrankaDoctorArgs(installation=file, driver=FrankaRobotConfig(address=ADDRESS, real_time=False))

    async def main() -> list[DoctorRow]:
        mount = with_installation(RunConfig(), file).installation.mounts(1)[0]
        return await FirstStart(args, ask, said.append, SoftArm(mount=mount), answers).rows()

    rows = virtual_time.run(main())
    assert "above a grasp at (0.20, 0.20) m" in "".join(said)
    assert [row for row in rows if row.standing is Severity.LACKING] == []
    assert {row.what: row.standing for row in rows}["dry run"] is Severity.READY


def test_it_needs_a_terminal() -> None:
    with pytest.raises(ConfigError, match="start it in a terminal"):
        run(FrankaDoctorArgs())


@pytest.mark.parametrize(("text", "found"), [("1\n", True), ("0\n", False), (None, False)])
def test_a_real_time_kernel_is_known_by_its_file(text: str | None, found: bool, tmp_path: Path) -> None:
    path = tmp_path / "realtime"
    if text is not None:
        path.write_text(text, encoding="ascii")
    assert real_time_kernel(path) is found
