"""One run with a fault, from its start to the evaluation of its files."""

import asyncio
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from dlokit.communication import topics
from dlokit.errors import InputError, ProcessFailure
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.reader import read_recording
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.system.results.run_result import read_result
from dlokit.types.flow import RunOutcome
from dlokit.types.robot import RobotMode, RobotState
from parts.faults.disks import BadDisk
from parts.faults.disturbance import FILE_NAME as DISTURBANCE
from parts.faults.disturbance import first_unanswered_s
from parts.faults.judging import RunFinding
from parts.faults.moments import Moment, comes, ends_first
from parts.faults.table import Fault
from parts.live_run import LiveRun, StartedCommand, live_run
from parts.logs import AT_REST

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
MENDING = frozenset({"restore", "recover"})
"""Steps in which the flow waits for a lost component, or recovers an arm that has braked."""


@dataclass(frozen=True, kw_only=True)
class FaultCase:
    """One run to be executed."""

    fault: Fault
    number: int
    """Among the runs of the fault, from 0."""
    seed: int = 0
    """Of the first run of the fault."""

    @property
    def folder_name(self) -> str:
        """Name of the folder for its files."""
        return f"{self.fault.name}-{self.number:03d}"

    @property
    def moment(self) -> Moment:
        """When the fault is injected."""
        return self.fault.when[self.number % len(self.fault.when)]

    @property
    def config(self) -> RunConfig:
        """Configuration of its run."""
        start, goal = TASKS[(self.number // len(self.fault.when)) % len(TASKS)]
        seed, headless = self.seed + self.number, not self.fault.watched
        return RunConfig(start=start, goal=goal, seed=seed, runtime="live", headless=headless)


def cases(faults: Sequence[Fault], runs: int, seed: int) -> Iterator[FaultCase]:
    """Yield every fault once, then every fault again, so that an interrupted sweep has runs of each."""
    for number in range(runs):
        for fault in faults:
            yield FaultCase(fault=fault, number=number, seed=seed)


def finished(folder: Path) -> RunFinding | None:
    """The finding of an earlier sweep; None if the case is not finished, or its run never started."""
    try:
        finding = msgspec.json.decode((folder / FINDING_FILE).read_bytes(), type=RunFinding)
    except (OSError, msgspec.DecodeError):
        return None
    return None if finding.broken else finding


async def try_case(case: FaultCase, folder: Path) -> RunFinding:
    """Run a case in `folder`; its finding is written there at the end."""
    finding = RunFinding(fault=case.fault.name, number=case.number, moment=case.moment.value)
    if reason := case.fault.injury().unable():
        return msgspec.structs.replace(finding, skipped=reason)
    began_s = time.monotonic()
    _renew(folder)
    for attempt in range(ATTEMPTS):
        try:
            finding = await _Trial(case, finding, folder / f"attempt-{attempt}", attempt).run()
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
    """One attempt of a case; `finding` grows as the run is observed."""

    def __init__(self, case: FaultCase, finding: RunFinding, folder: Path, attempt: int) -> None:
        self._moment = case.moment
        self._fault = case.fault
        self._injury = case.fault.injury()
        self._folder = folder
        self._finding = finding
        self._rng = np.random.default_rng([case.seed, case.number, attempt, *case.fault.name.encode()])
        self._heard_ns = 0  # stamp of the last state of the arm that the bus brought
        folder.mkdir()
        (folder / CONFIG_FILE).write_text(to_toml(case.config), encoding="utf-8")

    async def run(self) -> RunFinding:
        if not isinstance(self._injury, BadDisk):
            await self._run_in(self._folder / "run")
        else:
            with self._injury.mounted(self._folder) as disk:
                await self._run_in(disk / "run")
        return self._finding

    def _find(self, **found: object) -> None:
        self._finding = msgspec.structs.replace(self._finding, **found)

    async def _run_in(self, run_dir: Path) -> None:
        program = self._shape(run_dir)
        async with live_run(program, run_dir) as run:
            if not await comes(self._moment, run, self._rng):
                return
            await self._strike(run)
            self._find(remaining_processes=await program.remaining_processes(GONE_WITHIN_S))
        self._read_recording(run_dir / FILE_NAME)
        if self._fault.resumed:
            await self._resume(run_dir)
        else:
            self._read_printed(program.output)
            self._read_result(run_dir)

    async def _strike(self, run: LiveRun) -> None:
        """Inject the fault, and observe the run to its end."""
        moved, step = run.arm.mode is RobotMode.MOVING, run.flow.step
        struck_ns, struck_s = run.bus.clock.now_ns(), time.monotonic()
        struck_s = await self._injury.inject(run) or struck_s
        healing, braked_at_s = asyncio.create_task(self._heal(run)), None
        if moved and self._fault.brakes:
            moved, braked_at_s = await run.arm.braked(struck_s, BRAKES_WITHIN_S)
        ended = await run.program.ends_within(ENDS_WITHIN_S)
        healing.cancel()
        await asyncio.gather(healing, return_exceptions=True)
        if self._fault.resumed:
            await run.arm.until_mode(*AT_REST, after_s=struck_s, within_s=BRAKES_WITHIN_S)
        newest = run.arm.newest
        self._heard_ns = 0 if newest is None else newest.stamp_ns
        recovered_after_s = recovery_time_s([(at_s, status.step) for at_s, status in run.flow.boxes], struck_s)
        self._find(
            struck=True,
            step=step,
            struck_ns=struck_ns,
            exit_code=run.program.exit_code if ended else None,
            moved=moved,
            braked_s=None if braked_at_s is None else braked_at_s - struck_s,
            stands=None if self._fault.takes_arm else run.arm.mode in AT_REST,
            recovered_after_s=recovered_after_s if np.isfinite(recovered_after_s) else None,
            named_s=self._named_s(run),
        )

    def _named_s(self, run: LiveRun) -> float | None:
        """Time from the first picture that did not come until the flow named the fault [s]; None: it did not."""
        since_s = first_unanswered_s(self._folder)
        if not self._fault.named or since_s is None:
            return None
        named = (at_s for at_s, status in run.flow.boxes if at_s >= since_s and self._fault.named in status.text)
        at_s = next(named, None)
        return None if at_s is None else at_s - since_s

    async def _heal(self, run: LiveRun) -> None:
        if self._fault.over_after_s is not None:
            await asyncio.sleep(self._fault.over_after_s)
            await self._injury.heal(run)
        elif not self._fault.disk:  # a bad disk stays bad
            await run.flow.end()
            await self._injury.heal(run)

    async def _resume(self, run_dir: Path) -> None:
        """Resume the run in another process, and use its end as the end of the run."""
        resumed_dir, began_s = self._folder / "resumed", time.monotonic()
        program = self._program("resume", str(run_dir), "--out", str(resumed_dir))
        try:
            async with live_run(program, resumed_dir) as run:
                await ends_first(run, run.flow.begun())
                self._find(recovered_after_s=time.monotonic() - began_s)
                ended = await program.ends_within(ENDS_WITHIN_S)
                left = await program.remaining_processes(GONE_WITHIN_S)
        except ProcessFailure:  # a run that cannot be resumed is a failure of the run, not of the study
            self._find(exit_code=program.exit_code)
            return
        remaining = (*self._finding.remaining_processes, *left)
        self._find(exit_code=program.exit_code if ended else None, remaining_processes=remaining)
        self._read_result(resumed_dir)

    def _shape(self, run_dir: Path) -> StartedCommand:
        config_file = str(self._folder / CONFIG_FILE)
        if not self._fault.disturbed:
            return self._program("shape", "--config", config_file, "--out", str(run_dir))
        arguments = (config_file, str(run_dir), str(self._folder / DISTURBANCE))
        return StartedCommand(command=DISTURBED_SHAPE, arguments=arguments, output=self._folder / "shape.txt")

    def _program(self, *arguments: str) -> StartedCommand:
        return StartedCommand(arguments=arguments, output=self._folder / f"{arguments[0]}.txt")

    def _read_result(self, run_dir: Path) -> None:
        try:
            result = read_result(run_dir)
        except InputError:
            return
        errors = {"rmse_m": result.rmse_m, "true_rmse_m": result.true_rmse_m, "threshold_m": result.threshold_m}
        self._find(outcome=result.outcome, reason=result.reason or "", **errors)

    def _read_printed(self, output: Path) -> None:
        """What a run printed: its outcome, whether it named missing files, whether it had a traceback."""
        text = output.read_text(encoding="utf-8", errors="replace")
        words = {line.split()[0] for line in text.splitlines() if line.split()}
        self._find(
            outcome=next((outcome for outcome in RunOutcome if outcome.value in words), None),
            incomplete="files are missing or incomplete" in text,
            traceback="Traceback" in text,
        )

    def _read_recording(self, path: Path) -> None:
        """Read it completely: the gap at its end if its writer was killed, and the arm."""
        states, last_ns, struck_ns = list[RobotState](), 0, self._finding.struck_ns
        try:
            for one in read_recording(path):
                last_ns = max(last_ns, one.log_ns)
                if one.topic == topics.ARM_STATE.name and isinstance(one.message, RobotState):
                    states.append(one.message)
        except InputError:
            return
        assert struck_ns is not None, "the fault was injected"
        self._find(readable=True, lost_s=max((struck_ns - last_ns) / 1e9, 0.0) if self._fault.resumed else None)
        if self._fault.brakes:
            self._see_recorded_arm(states, struck_ns)

    def _see_recorded_arm(self, states: Sequence[RobotState], struck_ns: int) -> None:
        """What the recording has of the arm, and the bus did not bring.

        Processes that go on after a minute lose the link to the study, which was not frozen: that the arm braked before
        it stood, and that it stands, only they hear. The time until it brakes is then that of the run's clock.
        """
        braked_s = recorded_braking_s(states, struck_ns)
        if self._finding.braked_s is None and braked_s is not None:
            self._find(moved=True, braked_s=braked_s)
        if self._finding.stands is not None and states and states[-1].stamp_ns > self._heard_ns:
            self._find(stands=states[-1].mode in AT_REST)


def recorded_braking_s(states: Sequence[RobotState], struck_ns: int) -> float | None:
    """Time from `struck_ns` until an arm that moved then brakes [s]; None where its motion ended otherwise, or goes on.

    `states` are in the order of their stamps.
    """
    modes = [(state.stamp_ns, state.mode) for state in states if state.stamp_ns >= struck_ns]
    ended = next((one for one in modes if one[1] is not RobotMode.MOVING), None)
    return (ended[0] - struck_ns) / 1e9 if ended is not None and ended[1] is RobotMode.BRAKING else None


def recovery_time_s(boxes: Sequence[tuple[float, str]], struck_s: float) -> float:
    """Time from a fault until the flow has left its last recovery step [s]; 0 if it had none.

    `boxes` are the times [s] on the machine's clock at which the flow entered each step. If the flow ended in a
    recovery step, or was cut off there, it has not recovered: inf.
    """
    after = [(at_s, step) for at_s, step in boxes if at_s >= struck_s]
    mending = [index for index, (_, step) in enumerate(after) if step in MENDING]
    if not mending:
        return 0.0
    last = mending[-1] + 1
    return after[last][0] - struck_s if last < len(after) else float("inf")
