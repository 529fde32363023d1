"""The operator's input on the page."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ParamSpec

import msgspec
import viser

from dlokit.communication import topics
from dlokit.communication.port import Port
from dlokit.communication.skill import Skill
from dlokit.description.point_files import csv_of
from dlokit.description.shapes import builtin_shape
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.skills.viewer.goal.editor import GoalEditor, GoalSkills, RodOutline
from dlokit.skills.viewer.goal.frames import DragPhase, GoalFramesView, GoalHandles
from dlokit.skills.viewer.goal.pen import Pen
from dlokit.skills.viewer.panel.controls import Operator
from dlokit.skills.viewer.panel.health import Health
from dlokit.skills.viewer.panel.operation import Button, PageState, Situation, page_state
from dlokit.skills.viewer.serving.page import LoopGate
from dlokit.skills.viewer.state import Received
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.flow import Command, OperatorCommand, RunPhase

P = ParamSpec("P")


@dataclass(frozen=True, kw_only=True)
class ArmButtons:
    """The skills that stop and enable one arm, called directly: the decision process may be frozen."""

    stop: Skill[[], None]
    enable: Skill[[], None]


class OperatorInput:
    """Turns buttons, frames, drawing and files into commands, calls and goals. Its methods are called on the loop."""

    def __init__(
        self,
        seen: Received,
        health: Health,
        rod: RodOutline,
        port: Callable[[], Port],
        *,
        goals: GoalSkills | None,
        arms: tuple[ArmButtons, ...],
        threshold_m: float,
        rejects_infeasible: bool,
    ) -> None:
        """`port` is known once the component runs; the other arguments are those of `ViewerComponent`."""
        self._seen, self._health, self._rod, self._port = seen, health, rod, port
        self._arms, self._rejects_infeasible = arms, rejects_infeasible
        self._editor = GoalEditor(goals, rod, threshold_m, port)
        self._handles = GoalHandles(
            builtin_shape("I", rod.length_m, rod.nodes, radius_m=rod.radius_m), TABLE_X_M, TABLE_Y_M
        )
        self._frames: GoalFramesView | None = None
        self._pen: Pen | None = None
        self._stopped = False
        self._calls: set[asyncio.Task[Any]] = set()

    def add_to(self, server: viser.ViserServer, gate: LoopGate) -> Operator:
        """Add the frames and the pen to the page; returns the callbacks of its buttons."""
        self._frames = GoalFramesView(server, self._handles, gate, self._frame_dragged)
        self._pen = Pen(server, gate, self._rod, lambda nodes: self._change_goal(self._editor.take, nodes, "drawn"))
        return Operator(
            press=self._press,
            leave_drawing=self._leave_drawing,
            take_shape=partial(self._change_goal, self._editor.take_builtin),
            take_file=partial(self._change_goal, self._editor.take_csv),
            goal_file=self._goal_file,
            ask_before_motions=lambda asks: self._command(Command.STEPWISE if asks else Command.CONTINUOUS),
        )

    async def close(self) -> None:
        """End all calls that concern the goal."""
        await self._editor.close()

    def on_goal(self, goal: GoalShape) -> None:
        """Note the goal that the model has published; the frames follow it until the operator drags one."""
        self._editor.on_goal(goal)
        self._handles.follow(goal.nodes_world)

    def on_verdict(self, verdict: GoalVerdict) -> None:
        """Note a verdict on the goal."""
        self._editor.on_verdict(verdict)

    def judge(self) -> None:
        """Ask for a verdict on the goal between two tasks, unless it was asked for."""
        if self._waiting:
            self._editor.judge()

    def place_frames(self) -> None:
        """Put the frames where the goal is, unless the operator has dragged one."""
        if self._frames is not None and not self._handles.dragged:
            self._frames.place()

    def show(self) -> PageState:
        """Show the frames and the sheet where they have an effect; returns the rest of the page's state."""
        stopped, self._stopped = self._stopped, self._seen.stop_latched
        page = page_state(self._situation())
        if not page.editable or (self._stopped and not stopped):  # stopped by whomever
            self._leave_drawing()
            page = page_state(self._situation())
        if self._frames is not None and self._pen is not None:
            self._frames.show(page.editable and not self._pen.ready)
        return page

    @property
    def _waiting(self) -> bool:
        return self._seen.run.phase is RunPhase.WAITING

    def _situation(self) -> Situation:
        verdict = self._editor.verdict
        run = self._seen.run
        if self._editor.notice and not run.notice:
            run = msgspec.structs.replace(run, notice=self._editor.notice)
        return Situation(
            run=run,
            stop_latched=self._seen.stop_latched,
            goal_set=self._editor.goal is not None,
            standing=None if verdict is None else verdict.standing,
            rejects_infeasible=self._rejects_infeasible,
            nearest=verdict is not None and verdict.nearest_world is not None,
            undoable=self._editor.undoable,
            frames=len(self._handles.handles),
            drawing=self._pen is not None and self._pen.ready,
            lost=self._health.lost,
        )

    def _press(self, button: Button, visitor: int | None) -> None:
        """Execute a button if it is enabled now: a browser's page may be a moment late.

        `visitor` is the number of the browser's page on which it was pressed.
        """
        if not page_state(self._situation()).buttons[button].enabled:
            return
        if (command := _COMMANDS.get(button)) is not None:
            self._command(command)
            return
        match button:
            case Button.STOP:
                self._call_arms([arm.stop for arm in self._arms])
                self._command(Command.STOP)
                self._leave_drawing()
            case Button.ENABLE:
                self._call_arms([arm.enable for arm in self._arms])
            case Button.SHAPE:
                self._shape_it()
            case Button.UNDO:
                self._change_goal(self._editor.undo)
            case Button.NEAREST:
                self._take_nearest()
            case Button.RESET:
                self._change_goal(lambda: None)
            case Button.MORE | Button.FEWER:
                self._handles.set_count(len(self._handles.handles) + (1 if button is Button.MORE else -1))
                self._change_goal(lambda: None)
            case Button.DRAW if self._pen is not None:
                self._pen.take_up(visitor)
            case _:
                pass

    def _leave_drawing(self) -> None:
        if self._pen is not None:
            self._pen.put_away()

    def _change_goal(self, change: Callable[P, None], *args: P.args, **kwargs: P.kwargs) -> None:
        """Change the goal other than by frames, between two tasks; the frames follow it, with free directions."""
        if not self._waiting:
            return
        self._leave_drawing()
        change(*args, **kwargs)
        self._handles.release()
        if self._frames is not None:
            self._frames.place()

    def _take_nearest(self) -> None:
        verdict = self._editor.verdict
        if verdict is not None and (nearest := verdict.nearest_world) is not None:
            self._change_goal(self._editor.take, nearest, "nearest")

    def _goal_file(self) -> bytes | None:
        goal = self._editor.goal
        return None if goal is None else csv_of(goal.nodes_world)

    def _frame_dragged(self, phase: DragPhase) -> None:
        if not self._waiting:
            return
        if phase == "start":
            self._editor.remember()
            return
        message = self._handles.message(self._port().clock.now_ns())
        self._port().publish(topics.GOAL_FRAMES, message)
        if phase == "end":
            self._editor.settle(message.frames)

    def _command(self, command: Command) -> None:
        self._port().publish(topics.COMMAND, OperatorCommand(stamp_ns=self._port().clock.now_ns(), command=command))

    def _call_arms(self, skills: Sequence[Skill[[], None]]) -> None:
        for skill in skills:
            call = asyncio.create_task(self._port().call(skill), name=f"viewer calls {skill.key}")
            self._calls.add(call)
            call.add_done_callback(self._calls.discard)

    def _shape_it(self) -> None:
        # The goal that the page shows: the operator sees it, and the verdict refers to it.
        goal = self._editor.goal
        assert goal is not None, "the button is enabled only with a goal"
        self._handles.release()
        self._port().publish(
            topics.COMMAND,
            OperatorCommand(
                stamp_ns=self._port().clock.now_ns(),
                command=Command.START,
                nodes_world=goal.nodes_world,
                goal="dragged" if goal.name == "frames" else goal.name,
            ),
        )


_COMMANDS = {
    Button.PAUSE: Command.PAUSE,
    Button.RESUME: Command.RESUME,
    Button.PROCEED: Command.PROCEED,
    Button.END: Command.END,
    Button.SEE: Command.SEE,
}
"""Buttons that only send a command to the decision layer."""
