"""The table of faults: for each the injection, its time, and the allowed ends of the run."""

import signal
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from dlokit.types.flow import RunOutcome
from parts.faults.disks import BadDisk, DiskFault
from parts.faults.disturbance import Disturbance
from parts.faults.injuries import AllFrozen, Disturbed, ForgingPeer, FullDisk, Injury, Signalled, SlippedGrasp
from parts.faults.moments import Moment


@dataclass(frozen=True)
class Ending:
    """An allowed end of a run."""

    outcome: RunOutcome
    reason: str = ""
    """Prefix of its reason."""

    def __str__(self) -> str:
        return f"{self.outcome.value}, {self.reason}" if self.reason else self.outcome.value


CONVERGES = (Ending(RunOutcome.CONVERGED),)


def ends_as(*reasons: str) -> tuple[Ending, ...]:
    """The run fails with one of these reasons; `robot.` is any skill of the robot without an answer."""
    return tuple(Ending(RunOutcome.FAILED, reason) for reason in reasons)


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One row."""

    name: str
    what: str
    injury: Callable[[], Injury]
    when: tuple[Moment, ...] = (Moment.ANY,)
    """Times of injection; the runs of a fault use them in turn."""
    over_after_s: float | None = None
    """Time after which the fault ends on its own, in wall time [s]; None: it does not."""
    right: tuple[Ending, ...] = CONVERGES
    """Allowed ends, of the resumed run if it is resumed."""
    resumed: bool = False
    """The fault ends the run's own process: all others must end on their own, and `dlokit resume` must continue."""
    brakes: bool = False
    """A moving arm must brake on its own; the time until it begins is measured."""
    takes_arm: bool = False
    """The fault destroys the cell and with it the arm, so that the state of the arm is unknown."""
    watched: bool = False
    """The run has a viewer."""
    disk: bool = False
    """The disk refuses files: the run ends with its outcome on the terminal and one sentence, exit code 1."""
    named: str = ""
    """Reason by which the flow must name the fault, within `NAMED_WITHIN_S` of the first picture that does not come."""
    disturbed: bool = False
    """The run's processes are started with a bus that can be disturbed."""


KILL, STOP = signal.SIGKILL, signal.SIGSTOP
ANY, MOVING, HOLDING, THINKING = Moment.ANY, Moment.MOVING, Moment.HOLDING, Moment.THINKING
LOOKING, ENDED = Moment.LOOKING, Moment.ENDED
FROZEN_S = 5.0
"""Duration of a temporary freeze [s]."""


LATE_FOR_S = 10.0
NO_FEEDBACK_S = 2.0
"""Longer than the gate waits for feedback before a motion [s]."""
HANGS_S = 20.0
"""Longer than any queue of a run holds what waits for the disk [s]."""
ALL_FROZEN_S = 60.0
"""Longer than any lease, and than a process may be silent [s]."""


def _to(process: str, number: signal.Signals, *, worker: bool = False) -> Callable[[], Injury]:
    return partial(Signalled, process, number, worker)


# fmt: off
FAULTS: tuple[Fault, ...] = (
    Fault(name="none",              what="nothing (control)", injury=Injury),
    Fault(name="kill-decision",     what="SIGKILL to the decision process", injury=_to("decision", KILL),
          when=(MOVING, ANY, HOLDING), resumed=True, brakes=True),
    Fault(name="freeze-decision",   what="SIGSTOP to the decision process, for 5 s", injury=_to("decision", STOP),
          when=(MOVING, ANY, HOLDING), over_after_s=FROZEN_S, brakes=True),
    Fault(name="kill-robot",        what="SIGKILL to the robot's process", injury=_to("robot", KILL),
          when=(MOVING, ANY), right=ends_as("process_died: robot"), brakes=True),
    Fault(name="freeze-robot",      what="SIGSTOP to the robot's process", injury=_to("robot", STOP),
          when=(MOVING, ANY), right=ends_as("process_frozen: robot", "robot."), brakes=True),
    Fault(name="kill-cell",         what="SIGKILL to the cell's process", injury=_to("cell", KILL),
          when=(MOVING, ANY), right=ends_as("process_died: cell"), takes_arm=True),
    Fault(name="freeze-cell",       what="SIGSTOP to the cell's process", injury=_to("cell", STOP),
          when=(MOVING, ANY), right=ends_as("process_frozen: cell", "robot."), takes_arm=True),
    Fault(name="kill-camera",       what="SIGKILL to the camera's process", injury=_to("camera", KILL)),
    Fault(name="freeze-camera",     what="SIGSTOP to the camera's process", injury=_to("camera", STOP)),
    Fault(name="kill-observer",     what="SIGKILL to the observer's process", injury=_to("observer", KILL)),
    Fault(name="freeze-observer",   what="SIGSTOP to the observer's process", injury=_to("observer", STOP)),
    Fault(name="kill-simulation",   what="SIGKILL to the model's process", injury=_to("simulation", KILL)),
    Fault(name="freeze-simulation", what="SIGSTOP to the model's process", injury=_to("simulation", STOP)),
    Fault(name="kill-viewer",       what="SIGKILL to the viewer's process", injury=_to("viewer", KILL), watched=True),
    Fault(name="freeze-viewer",     what="SIGSTOP to the viewer's process", injury=_to("viewer", STOP), watched=True),
    Fault(name="kill-planner",      what="SIGKILL to the worker that plans",
          injury=_to("decision", KILL, worker=True), when=(THINKING,)),
    Fault(name="freeze-planner",    what="SIGSTOP to the worker that plans",
          injury=_to("decision", STOP, worker=True), when=(THINKING,)),
    Fault(name="drop-camera",       what="no pictures for 5 s", injury=_to("camera", STOP), over_after_s=FROZEN_S),
    Fault(name="stall-observer",    what="SIGSTOP to the observer's process, for 5 s", injury=_to("observer", STOP),
          over_after_s=FROZEN_S),
    Fault(name="stall-simulation",  what="SIGSTOP to the model's process, for 5 s", injury=_to("simulation", STOP),
          over_after_s=FROZEN_S),
    Fault(name="mute-camera",       what="the camera gives no pictures for 5 s",
          injury=partial(Disturbed, Disturbance.NO_PICTURES), when=(LOOKING,), over_after_s=FROZEN_S,
          disturbed=True, named="camera_lost"),
    Fault(name="withhold-feedback", what="no feedback of the arm reaches its driver for 2 s",
          injury=partial(Disturbed, Disturbance.NO_FEEDBACK), when=(MOVING,), over_after_s=NO_FEEDBACK_S,
          disturbed=True, brakes=True),
    Fault(name="slip-grasp",        what="the DLO falls out of the fingers", injury=SlippedGrasp, when=(HOLDING,)),
    Fault(name="delay-messages",    what="all messages and calls come 500 ms late, for 10 s",
          injury=partial(Disturbed, Disturbance.LATE), over_after_s=LATE_FOR_S, disturbed=True),
    Fault(name="forge-commander",   what="a peer without the key forges the commander", injury=ForgingPeer,
          when=(MOVING,)),
    Fault(name="forge-other-user",  what="a peer of another user forges the commander",
          injury=partial(ForgingPeer, of_another_user=True), when=(MOVING,)),
    Fault(name="fill-disk",         what="the recording may not grow any more", injury=FullDisk),
    Fault(name="full-disk",         what="a small disk fills up: recording, log, journal, truth, result, report",
          injury=partial(BadDisk, DiskFault.FULL), disk=True),
    Fault(name="full-at-result",    what="the disk fills up after the task: result and report",
          injury=partial(BadDisk, DiskFault.FULL), when=(ENDED,), disk=True),
    Fault(name="full-at-report",    what="the disk has 300 kB after the task: the report does not fit",
          injury=partial(BadDisk, DiskFault.FULL, 300_000), when=(ENDED,), disk=True),
    Fault(name="read-only-disk",    what="no file of the run can be opened for writing any more",
          injury=partial(BadDisk, DiskFault.READ_ONLY), disk=True),
    Fault(name="delete-folder",     what="the folder of the run is deleted",
          injury=partial(BadDisk, DiskFault.DELETED), disk=True),
    Fault(name="hang-disk",         what="the disk does not respond for 20 s",
          injury=partial(BadDisk, DiskFault.HANGS), over_after_s=HANGS_S),
    Fault(name="hang-disk-moving",  what="the disk does not respond, the decision process is stopped, for 5 s",
          injury=partial(BadDisk, DiskFault.HANGS, 0, True), when=(MOVING,), over_after_s=FROZEN_S, brakes=True),
    Fault(name="freeze-all",        what="SIGSTOP to all processes, for 60 s", injury=partial(AllFrozen, ALL_FROZEN_S),
          when=(MOVING,), right=(*CONVERGES, *ends_as("robot.")), brakes=True),
)
# fmt: on

BY_NAME = {fault.name: fault for fault in FAULTS}
