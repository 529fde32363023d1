"""One table from the state of a run to the page's buttons and its line of advice.

Pure: the panel shows the result, and no other code decides about a button.
"""

import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from dlokit.types.feasibility import Standing
from dlokit.types.flow import RunPhase, RunStatus


class Button(enum.Enum):
    """The buttons of the page; the value is the label."""

    STOP = "STOP"
    SHAPE = "Shape it"
    PROCEED = "Make this motion"
    PAUSE = "Pause"
    RESUME = "Resume"
    ENABLE = "Enable arms"
    END = "End run"
    SEE = "Take what the camera sees"
    SHAPES = "Shape"
    DRAW = "Draw on the table"
    NEAREST = "Take the nearest that holds"
    UNDO = "Undo"
    RESET = "Reset frames"
    MORE = "More frames"
    FEWER = "Fewer frames"
    LOAD = "Load a goal"
    SAVE = "Save the goal"


@dataclass(frozen=True, kw_only=True)
class Situation:
    """The state on which the buttons depend."""

    run: RunStatus
    stop_latched: bool = False
    """Whether a person's stop is latched in an arm."""
    goal_set: bool = False
    standing: Standing | None = None
    """Verdict on the goal that is set; None while it is judged."""
    rejects_infeasible: bool = True
    """Whether the run refuses goals that cannot hold."""
    nearest: bool = False
    """Whether a nearest shape that holds is known."""
    undoable: bool = False
    """Whether there was another goal before."""
    frames: int = 3
    drawing: bool = False
    """Whether the operator draws a goal."""
    lost: tuple[str, ...] = ()
    """Components that do not answer."""


@dataclass(frozen=True, kw_only=True)
class ButtonState:
    """Whether a button is enabled, and its effect, or why it is disabled."""

    enabled: bool
    hint: str
    """Empty where the headline says it."""
    label: str


@dataclass(frozen=True, kw_only=True)
class PageState:
    """The state of the page."""

    headline: str
    """The present activity."""
    advice: str
    """The operator's next step."""
    urgent: bool
    """Whether the run waits for the operator to act on a stop or a loss."""
    buttons: Mapping[Button, ButtonState]
    editable: bool
    """Whether the goal can be changed."""
    drawing: bool
    """Whether a goal is drawn, which can be left."""


MOST_FRAMES, FEWEST_FRAMES = 7, 2

_DOES: Mapping[Button, str] = {
    Button.STOP: "Stops the arms at once, and ends the task; they stay stopped until “Enable arms”",
    Button.SHAPE: "Starts a task: the arm brings the DLO into the green goal shape",
    Button.PROCEED: "Allows the motion that the page asks about",
    Button.PAUSE: "Holds the task after the motion that runs",
    Button.RESUME: "Goes on with the task",
    Button.ENABLE: "Lets the arms move again; check first that no person is within reach",
    Button.END: "Ends the run and its processes; the files stay",
    Button.SEE: "Moves the arm out of the picture, looks, and takes the shape of the DLO as the goal",
    Button.SHAPES: "Takes a built-in shape as the goal",
    Button.DRAW: "Draw with the mouse, the left button held: the line becomes the goal, with the length of the DLO",
    Button.NEAREST: "Takes the nearest shape found that friction holds and the arm reaches as the goal",
    Button.UNDO: "Takes the previous goal",
    Button.RESET: "Puts the frames back on the goal, and frees their directions",
    Button.MORE: "Adds a frame: the goal can be bent in more places",
    Button.FEWER: "Removes a frame",
    Button.LOAD: "Reads the goal from a .csv file with points x, y in metres, as --goal does",
    Button.SAVE: "Downloads the goal as a .csv file, which “Load a goal” and --goal take",
}
LEAVE_DRAWING = "Leave the drawing (Esc)"
"""Label of `Button.DRAW` while a goal is drawn."""

_BUSY: Mapping[RunPhase, str] = {
    RunPhase.STARTING: "The system is starting: wait until the camera has found the DLO.",
    RunPhase.LOOKING: "The camera is looking at the DLO: keep your hands away, and wait.",
    RunPhase.RUNNING: "A task is running: wait for its end, or stop it.",
    RunPhase.PAUSED: "The task is paused: press Resume to go on with it, or STOP to end it.",
    RunPhase.ASKING: "The task waits for your answer: press “Make this motion”, or STOP to end it.",
    RunPhase.FINISHING: "The files of the last task are being written: wait a moment.",
    RunPhase.ENDED: "The run has ended: start another one in a terminal.",
}
"""Why neither the goal can be changed nor a task started; in WAITING both are possible."""

_GOAL_BUTTONS = (
    Button.SEE,
    Button.SHAPES,
    Button.DRAW,
    Button.NEAREST,
    Button.UNDO,
    Button.RESET,
    Button.MORE,
    Button.FEWER,
    Button.LOAD,
)
LATCHED = "The arms are stopped: press “Enable arms” first."
TASK_PHASES = (RunPhase.RUNNING, RunPhase.PAUSED, RunPhase.ASKING)
"""In which a task runs, or waits for its operator."""


def page_state(situation: Situation) -> PageState:
    """The state of the page in a situation."""
    headline, advice = _line(situation)
    return PageState(
        headline=headline,
        advice=advice,
        urgent=situation.stop_latched or bool(situation.lost),
        buttons={button: _button(button, situation) for button in Button},
        editable=situation.run.phase is RunPhase.WAITING,
        drawing=situation.drawing,
    )


def _button(button: Button, situation: Situation) -> ButtonState:
    why_not = _why_not(button, situation)
    if button is Button.SHAPE and situation.run.phase is RunPhase.RUNNING and not situation.stop_latched:
        # The headline says it; the tooltip would cover the task's status just after the button was pressed.
        return ButtonState(enabled=False, hint="", label=button.value)
    if button is Button.DRAW and situation.drawing and not why_not:
        return ButtonState(enabled=True, hint="Keeps the present goal", label=LEAVE_DRAWING)
    return ButtonState(enabled=not why_not, hint=why_not or _DOES[button], label=button.value)


def _why_not(button: Button, situation: Situation) -> str:
    """Why a button is disabled now; empty if it is enabled."""
    if button in _GOAL_BUTTONS and (busy := _BUSY.get(situation.run.phase)):
        return busy
    check = _CHECKS.get(button)
    return "" if check is None else check(situation)


def _shape(situation: Situation) -> str:
    if situation.stop_latched:
        return LATCHED
    if busy := _BUSY.get(situation.run.phase):
        return busy
    if situation.drawing:
        return "A goal is being drawn: finish the line, or press Esc to keep the present goal."
    if situation.lost:
        return f"Not answering: {', '.join(situation.lost)}; wait until it is restarted."
    if not situation.goal_set:
        return "No goal is set: drag a frame, choose or draw a shape, or show one to the camera."
    if situation.standing is Standing.INFEASIBLE and situation.rejects_infeasible:
        return "The goal cannot be kept or reached, as the verdict below says: change it" + (
            ", or take the nearest that holds." if situation.nearest else "."
        )
    return ""


def _pause(situation: Situation) -> str:
    if situation.run.phase not in TASK_PHASES:
        return "No task is running."
    return "The task is paused already." if situation.run.paused else ""


def _end(situation: Situation) -> str:
    if situation.run.phase is RunPhase.WAITING:
        return ""
    if situation.run.phase in TASK_PHASES:
        return "A task is running: stop it first."
    return _BUSY.get(situation.run.phase, "")


def _needs(condition: Callable[[Situation], bool], why: str) -> Callable[[Situation], str]:
    return lambda situation: "" if condition(situation) else why


_CHECKS: Mapping[Button, Callable[[Situation], str]] = {
    Button.SHAPE: _shape,
    Button.PAUSE: _pause,
    Button.RESUME: _needs(lambda s: s.run.paused and s.run.phase in TASK_PHASES, "The task is not paused."),
    Button.PROCEED: _needs(lambda s: s.run.phase is RunPhase.ASKING, "No motion waits for your answer."),
    Button.ENABLE: _needs(lambda s: s.stop_latched, "The arms are not stopped."),
    Button.END: _end,
    Button.SEE: _needs(lambda s: not s.stop_latched, LATCHED),
    Button.NEAREST: _needs(lambda s: s.nearest, "The goal holds, or no shape near it was found that holds."),
    Button.UNDO: _needs(lambda s: s.undoable, "There is no previous goal."),
    Button.MORE: _needs(lambda s: s.frames < MOST_FRAMES, f"There are {MOST_FRAMES} frames already."),
    Button.FEWER: _needs(lambda s: s.frames > FEWEST_FRAMES, f"{FEWEST_FRAMES} frames are the fewest."),
    Button.SAVE: _needs(lambda s: s.goal_set, "No goal is set."),
}


def _line(situation: Situation) -> tuple[str, str]:
    """The headline and the advice. What people must know for their safety is said whatever else goes on."""
    run = situation.run
    if situation.stop_latched:
        return "The arms are stopped", "Check that no person is within reach, then press “Enable arms”."
    if situation.lost and run.phase is not RunPhase.ENDED:
        return f"Not answering: {', '.join(situation.lost)}", "Wait: it is restarted, and the run goes on."
    if situation.drawing:
        return (
            "Drawing a goal",
            "Draw on the table with the left button held; the line becomes the goal. Esc leaves the drawing.",
        )
    if run.phase is RunPhase.RUNNING and run.paused:
        return "Pausing", "The arm finishes its motion first."
    if run.phase is RunPhase.ASKING:
        return f"Next: {run.asks}", "Press “Make this motion” to allow it, or STOP."
    if run.phase is RunPhase.WAITING:
        return _waiting(situation)
    if run.phase is RunPhase.RUNNING and not situation.goal_set:
        return "Getting ready", "The camera looks for the DLO, and the arm may move: press STOP if anything goes wrong."
    return _LINES[run.phase]


_LINES: Mapping[RunPhase, tuple[str, str]] = {
    RunPhase.STARTING: ("Starting", "Wait until the camera has found the DLO."),
    RunPhase.LOOKING: ("Looking at the DLO", "Keep your hands away from the picture."),
    RunPhase.RUNNING: ("Shaping the DLO", "Watch, and press STOP if anything goes wrong."),
    RunPhase.PAUSED: ("Paused", "Press Resume to go on, or STOP to end the task."),
    RunPhase.FINISHING: ("The task has ended", "Wait: its report is being written."),
    RunPhase.ENDED: ("The run has ended", "Start another one in a terminal; this page shows its last state."),
}


def _waiting(situation: Situation) -> tuple[str, str]:
    # How the last task ended is said by its card alone.
    last = situation.run.last
    headline = "Waiting for your goal" if last is None else "Waiting for your next goal"
    advice = "Press “Shape it” to bring the DLO into the green shape, or set another goal."
    if last is not None and not last.outcome.is_success:
        advice = f"The goal stays set. {advice}"
    return headline, situation.run.notice or _shape(situation) or advice
