"""One run with a fault, from its start to the evaluation of its files."""

import asyncio
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from dlokit.communication import topics
from dlokit.errors import InputError, ProcessFailure
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.reader import read_recording
from dlokit.recording.summary import summarise
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.results.run_result import read_result
from dlokit.system.toml_config import to_toml
from dlokit.types.flow import RunOutcome
from dlokit.types.robot import RobotMode, RobotState
from parts.faults.disks import BadDisk
from parts.faults.disturbance import FILE_NAME as DISTURBANCE
from parts.faults.disturbance import first_unanswered_s
from parts.faults.injuries import Injury
from parts.faults.judging import RunFinding
from parts.faults.moments import Moment, comes, ends_first
from parts.faults.table import Fault
from parts.live_run import LiveRun, StartedCommand, live_run, recovery_time_s

TASKS = (("S", "I"), ("I", "S"))
"""Start and goal, one or two actions each. The runs of a fault use them in turn."""
ENDS_WITHIN_S = 420.0
"""Time after the fault at which a run counts as hanging [s]."""
GONE_WITHIN_S = 15.0
"""Processes end within five seconds of their parent; after that their supervisors kill them."""
BRAKES_WITHIN_S = 5.0
ATTEMPTS = 3
"""Number of attempts for a fault that came too late, because the task had already ended."""
FINDING_FILE = "finding.json"
DISTURBED_SHAPE = (sys.executable, str(Path(__file__).with_name("disturbed_shape.py")))
RUN, RESUMED = "run", "resumed"


@dataclass(frozen=True, kw_only=True)
class FaultCase:
    """One run to be executed."""

    fault: Fault
    number: int

    @property
    def folder_name(self) -> str:
        """Name of the folder for its files."""
        return f"{self.fault.name}-{self.number:03d}"

    @property
    def moment(self) -> Moment:
        """When the fault is injected."""
        return self.fault.when[self.number % len(self.fault.when)]

    def config(self, common: RunConfig) -> RunConfig:
        """Configuration of its run."""
        start, goal = TASKS[(self.number // len(self.fault.when)) % len(TASKS)]
        return replace(
            common,
            start=start,
            goal=goal,
            seed=common.seed + self.number,
            runtime="live",
            headless=not self.fault.watched,
            record=True,
        )


async def try_case(case: FaultCase, common: RunConfig, folder: Path) -> RunFinding:
    """Run a case in `folder`; its finding is written there at the end."""
    injury = case.fault.injury()
    if reason := injury.unable():
        return RunFinding(fault=case.fault.name, number=case.number, skipped=reason)
    began_s = time.monotonic()
    finding = RunFinding(fault=case.fault.name, number=case.number)
    _renew(folder)
    for attempt in range(ATTEMPTS):
        try:
            finding = await _Trial(case, case.fault.injury(), common, folder / f"attempt-{attempt}", attempt).run()
        except ProcessFailure as failure:
            finding = msgspec.structs.replace(finding, broken=str(failure))
        if finding.struck:
            break
    finding = msgspec.structs.replace(finding, wall_s=time.monotonic() - began_s)
    (folder / FINDING_FILE).write_bytes(msgspec.json.format(msgspec.json.encode(finding), indent=2) + b"\n")
    return finding


def _renew(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)


class _Trial:
    def __init__(self, case: FaultCase, injury: Injury, common: RunConfig, folder: Path, attempt: int) -> None:
        self._case = case
        self._fault = case.fault
        self._injury = injury
        self._folder = folder
        self._rng = np.random.default_rng([common.seed, case.number, attempt, *case.fault.name.encode()])
        self._heard_ns = 0  # stamp of the last state of the arm that the bus brought
        folder.mkdir()
        (folder / CONFIG_FILE).write_text(to_toml(case.config(common)), encoding="utf-8")

    async def run(self) -> RunFinding:
        if not isinstance(self._injury, BadDisk):
            return await self._run_in(self._folder / RUN)
        with self._injury.mounted(self._folder) as disk:
            return await self._run_in(disk / RUN)

    async def _run_in(self, run_dir: Path) -> RunFinding:
        program = self._shape(run_dir)
        finding = RunFinding(fault=self._fault.name, number=self._case.number, moment=self._case.moment.value)
        async with live_run(program, run_dir) as run:
            if not await comes(self._case.moment, run, self._rng):
                return finding
            finding = await self._faulted(run, finding)
            left = await program.remaining_processes(GONE_WITHIN_S)
        killed_ns = finding.struck_ns if self._fault.resumed else None
        finding = msgspec.structs.replace(finding, remaining_processes=left, **_recording(run_dir, killed_ns))
        if self._fault.brakes and finding.struck:
            finding = _with_recorded_arm(run_dir, finding, self._heard_ns)
        if self._fault.resumed:
            return await self._resumed(run_dir, finding)
        return _with_result(run_dir, _with_printed(program.output, finding))

    async def _faulted(self, run: LiveRun, finding: RunFinding) -> RunFinding:
        """Inject the fault, and observe the run to its end."""
        moved, step = run.arm.mode is RobotMode.MOVING, run.flow.step
        struck_ns, struck_s = run.bus.clock.now_ns(), time.monotonic()
        struck_s = await self._injury.inject(run) or struck_s
        healing = asyncio.create_task(self._heal(run))
        moved, braked_s = await self._braked(run, struck_s) if moved else (False, None)
        ended = await run.program.ends_within(ENDS_WITHIN_S)
        healing.cancel()
        await asyncio.gather(healing, return_exceptions=True)
        if self._fault.resumed:
            await run.arm.until_mode(*AT_REST, after_s=struck_s, within_s=BRAKES_WITHIN_S)
        newest = run.arm.newest
        self._heard_ns = 0 if newest is None else newest.stamp_ns
        named_s = self._named_s(run)
        recovered_after_s = recovery_time_s([(at_s, status.step) for at_s, status in run.flow.boxes], struck_s)
        return msgspec.structs.replace(
            finding,
            struck=True,
            step=step,
            exit_code=run.program.exit_code if ended else None,
            moved=moved,
            braked_s=braked_s,
            stands=None if self._fault.takes_arm else run.arm.mode in AT_REST,
            recovered_after_s=recovered_after_s if np.isfinite(recovered_after_s) else None,
            named_s=named_s,
            restarts=dict(run.restarts()),
            struck_ns=struck_ns,
        )

    def _named_s(self, run: LiveRun) -> float | None:
        """Time from the first picture that did not come until the flow named the fault [s]; None: it did not."""
        since_s = first_unanswered_s(self._folder)
        if not self._fault.named or since_s is None:
            return None
        named = (at_s for at_s, status in run.flow.boxes if at_s >= since_s and self._fault.named in status.text)
        at_s = next(named, None)
        return None if at_s is None else at_s - since_s

    async def _braked(self, run: LiveRun, struck_s: float) -> tuple[bool, float | None]:
        """Whether the fault interrupted a motion, and the time until the arm reports that it brakes [s]."""
        if not self._fault.brakes:
            return True, None
        ended = (RobotMode.BRAKING, *AT_REST)
        at_s = await run.arm.until_mode(*ended, after_s=struck_s, within_s=BRAKES_WITHIN_S)
        if at_s is None:
            return True, None
        if run.arm.mode_at(at_s) is not RobotMode.BRAKING:  # the motion ended before the fault took effect
            return False, None
        return True, at_s - struck_s

    async def _heal(self, run: LiveRun) -> None:
        if self._fault.over_after_s is not None:
            await asyncio.sleep(self._fault.over_after_s)
            await self._injury.heal(run)
        elif not self._fault.disk:  # a bad disk stays bad
            await run.flow.end()
            await self._injury.heal(run)

    async def _resumed(self, run_dir: Path, finding: RunFinding) -> RunFinding:
        """Resume the run in another process, and use its end as the end of the run."""
        resumed_dir = self._folder / RESUMED
        program = self._program("resume", str(run_dir), "--out", str(resumed_dir))
        began_s = time.monotonic()
        try:
            async with live_run(program, resumed_dir) as run:
                await ends_first(run, run.flow.begun())
                goes_on_s = time.monotonic() - began_s
                ended = await program.ends_within(ENDS_WITHIN_S)
                left = await program.remaining_processes(GONE_WITHIN_S)
        except ProcessFailure:  # a run that cannot be resumed is a failure of the run, not of the bench
            return msgspec.structs.replace(finding, exit_code=program.exit_code)
        finding = msgspec.structs.replace(
            finding,
            exit_code=program.exit_code if ended else None,
            recovered_after_s=goes_on_s,
            remaining_processes=(*finding.remaining_processes, *left),
        )
        return _with_result(resumed_dir, finding)

    def _shape(self, run_dir: Path) -> StartedCommand:
        config_file = self._folder / CONFIG_FILE
        if not self._fault.disturbed:
            return self._program("shape", "--config", str(config_file), "--out", str(run_dir))
        arguments = (str(config_file), str(run_dir), str(self._folder / DISTURBANCE))
        return StartedCommand(command=DISTURBED_SHAPE, arguments=arguments, output=self._folder / "shape.txt")

    def _program(self, *arguments: str) -> StartedCommand:
        return StartedCommand(arguments=arguments, output=self._folder / f"{arguments[0]}.txt")


AT_REST = (RobotMode.IDLE, RobotMode.FAULT)


def _with_result(run_dir: Path, finding: RunFinding) -> RunFinding:
    try:
        result = read_result(run_dir)
    except InputError:
        return finding
    return msgspec.structs.replace(
        finding,
        outcome=result.outcome,
        reason=result.reason or "",
        actions=result.actions,
        rmse_m=result.rmse_m,
        true_rmse_m=result.true_rmse_m,
        threshold_m=result.threshold_m,
    )


def _with_printed(output: Path, finding: RunFinding) -> RunFinding:
    """What a run printed: its outcome, whether it named missing files, whether it had a traceback."""
    lines = output.read_text(encoding="utf-8", errors="replace").splitlines()
    words = {line.split()[0] for line in lines if line.split()}
    return msgspec.structs.replace(
        finding,
        outcome=next((outcome for outcome in RunOutcome if outcome.value in words), None),
        incomplete=any("files are missing or incomplete" in line for line in lines),
        traceback=any("Traceback" in line for line in lines),
    )


def _recording(run_dir: Path, killed_ns: int | None) -> dict[str, Any]:
    """Facts about a recording whose writer was killed at that time, read with `dlokit info` and completely."""
    path = run_dir / FILE_NAME
    try:
        summary = summarise(path)
        last_ns = max((one.log_ns for one in read_recording(path)), default=0)
    except InputError:
        return {"readable": False}
    lost = {name: int(number) for name, number in summary.metadata.get("lost", {}).items()}
    return {
        "readable": True,
        "whole": summary.whole,
        "lost_s": None if killed_ns is None else max((killed_ns - last_ns) / 1e9, 0.0),
        "lost_messages": sum(lost.values()) if summary.whole else None,
    }


def _with_recorded_arm(run_dir: Path, finding: RunFinding, heard_ns: int) -> RunFinding:
    """The finding with what the recording has of the arm, and the bus did not bring.

    Processes that go on after a minute lose the link to the bench, which was not frozen: that the arm braked before it
    stood, and that it stands, only they hear. The time until it brakes is then that of the run's clock. `heard_ns` is
    the stamp of the last state that the bus brought.
    """
    try:
        messages = [one.message for one in read_recording(run_dir / FILE_NAME, {topics.ARM_STATE.name})]
    except InputError:
        return finding
    states = [message for message in messages if isinstance(message, RobotState)]
    assert finding.struck_ns is not None, "the fault was injected"
    braked_s = recorded_braking_s(states, finding.struck_ns)
    if finding.braked_s is None and braked_s is not None:
        finding = msgspec.structs.replace(finding, moved=True, braked_s=braked_s)
    if finding.stands is not None and states and states[-1].stamp_ns > heard_ns:
        finding = msgspec.structs.replace(finding, stands=states[-1].mode in AT_REST)
    return finding


def recorded_braking_s(states: Sequence[RobotState], struck_ns: int) -> float | None:
    """Time from `struck_ns` until an arm that moved then brakes [s]; None where its motion ended otherwise, or goes on.

    `states` are in the order of their stamps.
    """
    modes = [(state.stamp_ns, state.mode) for state in states if state.stamp_ns >= struck_ns]
    ended = next((one for one in modes if one[1] is not RobotMode.MOVING), None)
    return (ended[0] - struck_ns) / 1e9 if ended is not None and ended[1] is RobotMode.BRAKING else None


def finished(folder: Path) -> RunFinding | None:
    """The finding of an earlier sweep; None if the case is not finished, or its run never started."""
    try:
        finding = msgspec.json.decode((folder / FINDING_FILE).read_bytes(), type=RunFinding)
    except (OSError, msgspec.DecodeError):
        return None
    return None if finding.broken else finding


def cases(faults: tuple[Fault, ...], runs: int) -> Iterator[FaultCase]:
    """Yield every fault once, then every fault again, so that an interrupted sweep has runs of each."""
    for number in range(runs):
        for fault in faults:
            yield FaultCase(fault=fault, number=number)
