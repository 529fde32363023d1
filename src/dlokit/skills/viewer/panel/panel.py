"""The panel beside the scene: the operator's controls, the flow chart, the error, the camera's picture, the system."""

from collections.abc import Callable, Mapping, Sequence
from html import escape

import numpy as np
import viser
from viser import uplot

from dlokit.skills.viewer import palette
from dlokit.skills.viewer.goal.editor import goal_name
from dlokit.skills.viewer.palette import TERMS, Layer, term
from dlokit.skills.viewer.panel.controls import Controls, Operator, end_html, error_html, note_html
from dlokit.skills.viewer.panel.flow_chart import Edge, flow_chart_svg
from dlokit.skills.viewer.panel.health import ComponentHealth, EventLog, health_html
from dlokit.skills.viewer.panel.operation import Situation, page_state
from dlokit.skills.viewer.panel.segmentation import SegmentationTab
from dlokit.skills.viewer.panel.timeline import TimelineTools
from dlokit.skills.viewer.playback import Player
from dlokit.skills.viewer.segmentation import SegmentationTuner
from dlokit.skills.viewer.serving.page import LoopGate
from dlokit.skills.viewer.state import ActiveStep, ErrorHistory, RunState
from dlokit.types.action import Candidates
from dlokit.types.arrays import UInt8Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict, Standing
from dlokit.types.flow import FlowStatus, Mode, RunPhase, RunStatus, TaskEnd
from dlokit.types.observation import DistrustReason, ObserverEvent, ObserverEventKind

_WIDTH_PX = 380
# viser dims the panel of a page whose server has ended, and says nothing.
_NOT_CONNECTED = """<style>
div[style*="opacity: 0.5"][style*="pointer-events: none"]::before{display:block;margin:0.4em 0.8em;font-weight:650;
content:"Not connected: this page shows its last state, and its buttons have no effect."}
div[style*="opacity: 0.5"] div[style*="opacity: 0.5"]::before{display:none!important}
</style>"""


class Panel:
    """Read-outs, and the controls of an operator, or the timeline of a recorded run."""

    def __init__(
        self,
        server: viser.ViserServer,
        gate: LoopGate,
        *,
        flow: Sequence[Edge],
        threshold_m: float,
        tools: Operator | Player | None,
        watch_url: str,
        layers: Sequence[Layer],
        picture_layers: Sequence[Layer],
        set_visible: Callable[[Layer, bool], None],
        segmentation: SegmentationTuner | None = None,
    ) -> None:
        """`layers` of the scene can be hidden; `picture_layers` are drawn into the camera's picture."""
        self._gui = server.gui
        self._gate = gate
        self._flow = flow
        self._threshold_m = threshold_m
        self._gui.configure_theme(
            show_logo=False, show_share_button=False, brand_color=palette.STATE.color, control_width="large"
        )
        self._gui.main_panel.dock_right()
        self._gui.main_panel.set_width(_WIDTH_PX)
        self._gui.add_html(_NOT_CONNECTED)
        self.controls = Controls(self._gui, gate, tools) if isinstance(tools, Operator) else None
        self.timeline = TimelineTools(self._gui, gate, tools) if isinstance(tools, Player) else None
        self._key = self._gui.add_html("")
        self._end = self._gui.add_html("", visible=False)
        self._begun = False
        self._task = 0
        self._status = self._gui.add_html(
            status_html(RunState.WAITING, None, threshold_m), visible=self.controls is None
        )
        self._observer = self._gui.add_html("", visible=False)
        self._goal = self._gui.add_html("")
        tabs = self._gui.add_tab_group()
        if self.controls is not None:
            with tabs.add_tab("Goal", viser.Icon.TARGET):
                self.controls.add_goal()
        with tabs.add_tab("Task", viser.Icon.ROUTE):
            if self.controls is not None:
                self.controls.add_run()
            self._plot = ErrorPlot(self._gui, threshold_m)
            self._candidates = self._gui.add_html("")
            self._chart = self._gui.add_html(flow_chart_svg(flow))
        with tabs.add_tab("Look", viser.Icon.EYE):
            self._picture = self._gui.add_image(
                np.full((3, 4, 3), 230, dtype=np.uint8), label="Camera", format="jpeg", visible=False
            )
            self._picture_key = self._gui.add_html(
                f'<div style="padding:0 0.8em 0.6em;font-size:0.8em">{legend_html(picture_layers)}</div>', visible=False
            )
            for layer in layers:
                self._add_visibility(layer, set_visible)
        self.segmentation = None if segmentation is None else SegmentationTab(self._gui, tabs, gate, segmentation)
        with tabs.add_tab("System", viser.Icon.HEARTBEAT):
            self._health = self._gui.add_html("")
            self._log = self._gui.add_html("")
            if self.controls is not None:
                self._gui.add_html(note_html(f"Address for people who may only watch: {watch_url}"))
        if self.controls is not None:  # a browser gets this before the first drawing
            self.controls.show(page_state(Situation(run=RunStatus(stamp_ns=0, phase=RunPhase.STARTING))))

    def draw_status(self, state: RunState, status: FlowStatus, active: ActiveStep, history: ErrorHistory) -> None:
        """Show a status of the task."""
        # The headline says that a run waits; the status adds to it what is known of the DLO.
        self._begun = state is not RunState.WAITING or status.rmse_m is not None
        self._status.content = status_html(state, status, self._threshold_m)
        self._chart.content = flow_chart_svg(self._flow, active.step, active.last_outcome)
        self._plot.draw(history)

    def clear(self) -> None:
        """Clear the panel, before another moment of a recorded run."""
        self._status.content = status_html(RunState.WAITING, None, self._threshold_m)
        self._chart.content = flow_chart_svg(self._flow)
        self._plot.draw(ErrorHistory())
        self._goal.content = self._candidates.content = ""
        self._picture.visible = self._picture_key.visible = False
        self._observer.visible = self._begun = False
        self.show_end(False)

    def draw_end(self, end: TaskEnd, *, served: bool) -> None:
        """Show how the last task ended; its files are links while they are `served`."""
        self._end.content = end_html(end, served=served)

    def show_end(self, shown: bool) -> None:
        """Between two tasks show how the last one ended, else the status of the present one: never both."""
        self._end.visible = shown
        self._status.visible = not self._end.visible and (self.controls is None or self._begun)

    def draw_task(self, number: int) -> None:
        """Clear what was said of an earlier task."""
        if number != self._task:
            self._task = number
            self._observer.visible = False

    def draw_observer_event(self, event: ObserverEvent) -> None:
        """Show that the observer has lost the DLO, until it has found it again."""
        self._observer.content = observer_html(event)
        self._observer.visible = event.kind is not ObserverEventKind.FOUND_AGAIN

    def draw_goal(self, goal: GoalShape | None, verdict: GoalVerdict | None) -> None:
        """Show the name of the goal and the verdict on it."""
        self._goal.content = "" if goal is None else goal_html(goal, verdict)

    def draw_candidates(self, candidates: Candidates) -> None:
        """Show the progress of a decision, and its best candidates."""
        self._candidates.content = candidates_html(candidates)

    def draw_picture(self, picture: UInt8Array) -> None:
        """Show the camera's picture (height, width, 3), RGB; of a pair, the left one."""
        self._picture.image = picture
        self._picture.visible = self._picture_key.visible = True

    def draw_key(self, layers: Sequence[Layer]) -> None:
        """Show the colours of these layers beside the scene."""
        self._key.content = key_html(layers)

    def draw_health(self, states: Sequence[ComponentHealth]) -> None:
        """Show which components answer."""
        if states:
            self._health.content = health_html(states)

    def draw_log(self, log: EventLog) -> None:
        """Show the event log."""
        self._log.content = log.html()

    def _add_visibility(self, layer: Layer, set_visible: Callable[[Layer, bool], None]) -> None:
        box = self._gui.add_checkbox(layer.title, initial_value=True, hint=layer.meaning)
        box.on_update(self._gate.posting(lambda: set_visible(layer, box.value)))


def status_html(state: RunState, status: FlowStatus | None, threshold_m: float) -> str:
    """Status of the task: one line in large type, one in small."""
    title, detail, mode = state.value, "Nothing has run yet.", ""
    if status is not None:
        if status.outcome is not None:
            title = status.outcome.value
        elif state is RunState.RUNNING:
            title = status.step.replace("_", " ")
            mode = "" if status.mode is None else _badge(status.mode)
        actions = f"1 {term('action')}" if status.actions == 1 else f"{status.actions} {term('actions')}"
        error = error_html(status.rmse_m, status.outcome)
        detail = f"{actions} · {error} · {term('threshold')} {threshold_m * 1000.0:.1f} mm" + (
            f"<br>{escape(status.text)}" if status.text else ""
        )
    return (
        f'<div style="padding:0.4em 0.8em 0.2em"><div data-state="{state.value}" style="font-size:1.25em;'
        f'font-weight:600;color:{palette.INK}">{escape(title)}{mode}</div><div style="font-size:0.85em;'
        f'color:{palette.INK};opacity:0.75">{detail}</div></div>'
    )


def _badge(mode: Mode) -> str:
    """Label beside the name of the step: planning or control."""
    return (
        f'<span data-mode="{mode.value}" style="margin-left:0.6em;padding:0.1em 0.6em;border-radius:1em;'
        f"font-size:0.6em;vertical-align:middle;color:{palette.PAPER};"
        f'background:{palette.css(palette.MODES[mode])}">{term(f"{mode.value} mode")}</span>'
    )


_OBSERVER_LINES: Mapping[DistrustReason | None, str] = {
    None: "The observer has found the DLO again",
    DistrustReason.NO_POINTS: "The observer keeps its estimate: the clouds have no points of the DLO",
    DistrustReason.FAR_POINTS: "The observer keeps its estimate: the clouds are far from the DLO; check frame and unit",
    DistrustReason.OLD_STAMP: "The observer keeps its estimate: the clouds are not newer",
    DistrustReason.CLOCK_JUMPED: "The observer keeps its estimate: the clock of the clouds was set back",
    DistrustReason.NOT_THE_DLO: "The observer keeps its estimate: the clouds show something else",
    DistrustReason.BAD_MEMORY: "The observer keeps its estimate: its strategy's memory is refused; see its log",
    DistrustReason.BAD_TARGETS: "The observer keeps its estimate: its strategy has failed; see its log",
    # The fingers hide half of a carried DLO, which is no failure.
    DistrustReason.LOW_HEALTH: "The observer is unsure of its estimate",
    DistrustReason.SHORTENED: "The observer's estimate is shorter than the DLO: a hidden part is drawn onto the rest",
    DistrustReason.ELSEWHERE: "The observer has found the DLO in another place than expected, and continues from there",
}
"""The observer's present behaviour, by the reason of its event."""


def observer_html(event: ObserverEvent) -> str:
    """One line about the observer's event."""
    return note_html(f"{_OBSERVER_LINES[event.reason]} (health {event.health:.2f})", TERMS["health"])


_HOLDS = "Once in this shape, the DLO stays in it."
"""What a goal that holds means: whether an arm can bring the DLO into it from where it lies is another question."""


def goal_html(goal: GoalShape, verdict: GoalVerdict | None) -> str:
    """The name of the goal, the verdict on it, and the reason."""
    edge, standing, text = palette.FAINT, "", ""
    if verdict is not None:
        edge, standing = palette.css(palette.VERDICTS[verdict.standing]), verdict.standing.value
        text = f" – {verdict.text}" + (f" {_HOLDS}" if verdict.standing is Standing.HOLDS else "")
    return (
        f'<div data-verdict="{standing}" style="margin:0.2em 0.8em;padding:0.3em 0.6em;font-size:0.85em;'
        f'color:{palette.INK};border-left:0.3em solid {edge};overflow-wrap:anywhere">'
        f"<b>Goal: {escape(goal_name(goal))}</b>{escape(text)}</div>"
    )


_SCORE_NOTE = "A score is larger than the expected RMSE: uncertainty adds to it."


def candidates_html(candidates: Candidates) -> str:
    """The progress of a decision, and its best candidates with their scores."""
    rows = "".join(
        f"<tr><td>{term(one.kind)}</td><td>node {one.node}</td>"
        f'<td style="text-align:right">{one.score_m * 1000.0:.1f} mm</td></tr>'
        for one in candidates.best
    )
    table = f'; {term("scores")}:<table style="width:100%">{rows}</table>' if rows else ""
    note = f'<div style="opacity:0.75">{_SCORE_NOTE}</div>' if rows else ""
    return (
        f'<div data-rollouts="{candidates.rollouts}" style="padding:0 0.8em;font-size:0.8em;color:{palette.INK}">'
        f"Decision: {candidates.rollouts} of {candidates.budget} {term('rollouts')}{table}{note}</div>"
    )


def legend_html(layers: Sequence[Layer]) -> str:
    """The colours of these layers and their meaning."""
    return "".join(
        f'<span title="{escape(layer.meaning, quote=True)}" style="white-space:nowrap;margin-right:1em">'
        '<span style="display:inline-block;width:0.8em;'
        f"height:0.8em;border-radius:50%;border:1px solid {palette.FAINT};margin-right:0.35em;"
        f'background:{palette.css(layer.color)}"></span>{escape(layer.title)}</span>'
        for layer in layers
    )


def key_html(layers: Sequence[Layer]) -> str:
    """The key of the scene, in its lower left corner: viser has no other place beside the panel."""
    if not layers:
        return ""
    return (
        '<div data-key style="position:fixed;left:0.8em;bottom:0.8em;z-index:5;max-width:60vw;'
        f"padding:0.2em 0 0.2em 0.8em;border-radius:4px;background:{palette.PAPER}d0;color:{palette.INK};"
        'font-size:0.8em;line-height:1.7">'
        f"{legend_html(layers)}</div>"
    )


_MM_PER_M = 1000.0


class ErrorPlot:
    """RMSE after each action, and the threshold that ends the task."""

    def __init__(self, gui: viser.GuiApi, threshold_m: float) -> None:
        self._threshold_mm = threshold_m * _MM_PER_M
        state = palette.css(palette.STATE.color)
        self._plot = gui.add_uplot(
            data=self._data(ErrorHistory()),
            series=(
                uplot.Series(label="action"),
                uplot.Series(
                    label="RMSE [mm]",
                    stroke=state,
                    width=2,
                    points=uplot.Series_Points(show=True, size=7, fill=state),
                ),
                uplot.Series(
                    label="threshold [mm]",
                    stroke=palette.css(palette.GOAL.color),
                    width=1.5,
                    dash=(6.0, 4.0),
                    points=uplot.Series_Points(show=False),
                ),
            ),
            axes=(uplot.Axis(incrs=(1.0, 2.0, 5.0, 10.0)), uplot.Axis()),  # actions are whole numbers
            title="Error after each action",
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
            height=160,
        )

    def draw(self, history: ErrorHistory) -> None:
        """Bring the plot up to date."""
        self._plot.data = self._data(history)

    def _data(self, history: ErrorHistory) -> tuple[np.ndarray, ...]:
        actions, rmse_m = history.arrays()
        if len(actions) < 2:  # a plot of one number has no scale
            actions, rmse_m = np.array([0.0, 1.0]), np.array([*rmse_m, np.nan, np.nan])[:2]
        return actions, rmse_m * _MM_PER_M, np.full(len(actions), self._threshold_mm)
