"""What ends a drawing, on a page on which nothing listens."""

import asyncio
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from made_states import ARM_AT_REST
from msgspec import structs
from unheard_page import open_unheard_page

from dlokit.description.shapes import builtin_shape
from dlokit.skills.viewer.goal.editor import RodOutline
from dlokit.skills.viewer.operator_input import OperatorInput
from dlokit.skills.viewer.panel.controls import Operator
from dlokit.skills.viewer.panel.health import Health
from dlokit.skills.viewer.panel.operation import Button
from dlokit.skills.viewer.serving.page import LoopGate, close_page
from dlokit.skills.viewer.state import Newest, Received
from dlokit.types.dlo import GoalShape
from dlokit.types.flow import OperatorCommand, RunPhase, RunStatus

ROD = RodOutline(nodes=31, length_m=0.5, radius_m=0.004)
MINE, ANOTHER = 3, 4
"""Numbers of two visitors' pages."""


class OpenGate(LoopGate):
    """Runs each call at once."""

    def __init__(self) -> None:
        super().__init__(asyncio.new_event_loop())
        self._loop.close()

    def post(self, function: Callable[..., object], *args: Any, **kwargs: Any) -> None:
        function(*args, **kwargs)


class Desk:
    """An operator's page between two tasks, with a goal."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self.commands: list[OperatorCommand] = []
        port: Any = SimpleNamespace(
            publish=lambda topic, message: self.commands.append(message), clock=SimpleNamespace(now_ns=lambda: 1)
        )
        self.seen = Received(())
        self.seen.record_run(RunStatus(stamp_ns=1, phase=RunPhase.WAITING, stays=True))
        self.input = OperatorInput(
            self.seen,
            Health(()),
            ROD,
            lambda: port,
            goals=None,
            arms=(),
            threshold_m=0.012,
            rejects_infeasible=True,
        )
        self.operator: Operator = self.input.add_to(server, OpenGate())
        straight = builtin_shape("I", ROD.length_m, ROD.nodes, radius_m=ROD.radius_m)
        self.input.on_goal(GoalShape(stamp_ns=1, nodes_world=straight, name="I"))

    def latch(self, *, latched: bool) -> None:
        state = structs.replace(ARM_AT_REST, stop_latched=latched)
        self.seen.robots.setdefault(state.robot, Newest()).put(state)

    @property
    def drawing(self) -> bool:
        """Whether a drag on the table would draw, as the page shows it."""
        page = self.input.show()
        sheet = self._server.scene.get_handle_by_name("/drawing/sheet")
        assert (sheet is not None) == page.drawing
        return page.drawing


@pytest.fixture
def leaves(monkeypatch: pytest.MonkeyPatch) -> list[Callable[[Any], Any]]:
    """What the page does when a visitor leaves."""
    callbacks: list[Callable[[Any], Any]] = []
    monkeypatch.setattr(viser.ViserServer, "on_client_disconnect", lambda self, callback: callbacks.append(callback))
    return callbacks


@pytest.fixture
def desk(leaves: list[Callable[[Any], Any]]) -> Iterator[Desk]:
    server = open_unheard_page("127.0.0.1", 0, "key")
    desk = Desk(server)
    desk.operator.press(Button.DRAW, MINE)
    assert desk.drawing
    yield desk
    close_page(server)


def _leave(callbacks: list[Callable[[Any], Any]], visitor: int) -> None:
    for callback in callbacks:
        asyncio.run(callback(SimpleNamespace(client_id=visitor)))


def test_the_button_and_escape_leave_a_drawing(desk: Desk) -> None:
    desk.operator.press(Button.DRAW, ANOTHER)
    assert not desk.drawing
    desk.operator.press(Button.DRAW, MINE)
    desk.operator.leave_drawing()
    assert not desk.drawing


def test_a_drawing_ends_with_the_page_on_which_it_began_and_no_other(
    desk: Desk, leaves: list[Callable[[Any], Any]]
) -> None:
    _leave(leaves, ANOTHER)
    assert desk.drawing
    _leave(leaves, MINE)
    assert not desk.drawing


def test_the_stop_button_leaves_a_drawing_before_any_arm_answers(desk: Desk) -> None:
    desk.operator.press(Button.STOP, ANOTHER)
    assert not desk.drawing


def test_a_stop_from_elsewhere_leaves_a_drawing_and_another_one_can_begin_while_the_arms_are_stopped(
    desk: Desk,
) -> None:
    desk.latch(latched=True)
    assert not desk.drawing
    desk.operator.press(Button.DRAW, MINE)
    assert desk.drawing
    desk.latch(latched=False)
    assert desk.drawing


def test_another_goal_leaves_a_drawing(desk: Desk) -> None:
    desk.operator.take_shape("S")
    assert not desk.drawing


def test_a_task_that_begins_leaves_a_drawing(desk: Desk) -> None:
    desk.seen.record_run(RunStatus(stamp_ns=2, phase=RunPhase.RUNNING, stays=True))
    assert not desk.drawing
