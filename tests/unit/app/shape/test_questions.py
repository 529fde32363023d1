"""The questions before a real arm moves: in a terminal of this process, and where there is none."""

import asyncio
import io
import os
import pty
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import ClassVar

import pytest
from rich.console import Console

from dlokit.app.shape.questions import TerminalOperator, questions
from dlokit.app.shape.terminal import RunDisplay
from dlokit.communication.memory import MemoryTransport
from dlokit.errors import ConfigError, StartNotConfirmed
from dlokit.extras.cameras.realsense import RealSenseConfig
from dlokit.functional.cameras.simulated import SimulatedStereoConfig
from dlokit.functional.robots.kinematic import KinematicRobotConfig
from dlokit.system.config import RunConfig
from dlokit.system.configuration.preflight import check_before_start
from dlokit.system.operator_start import RealStart, Sighting, has_terminal

SEEN = Sighting(points=365, nodes=31)
NOTHING = Sighting(points=0, nodes=0, problem="no_points: nothing in the picture passes the filters")
SILENT = Sighting(points=0, nodes=0, problem="camera_lost: no picture came within 2 s", pictured=False)
HIDDEN = Sighting(points=90, nodes=0, problem="out_of_view: an end is cut off")
PATIENCE_S = 30.0  # it takes milliseconds; only a failing test waits this long


@dataclass(frozen=True, kw_only=True)
class RealArmConfig(KinematicRobotConfig):
    """An arm in software that counts as real."""

    name: ClassVar[str] = "real-arm"
    is_real: ClassVar[bool] = True


REAL = RunConfig(runtime="live", headless=True, camera=RealSenseConfig(), driver=RealArmConfig())


class MadeStart(RealStart):
    """A start whose looks are given."""

    def __init__(self, *looks: Sighting, resumed: bool = False) -> None:
        super().__init__(MemoryTransport(), REAL, resumed=resumed)
        self.looks = list(looks)

    async def page(self) -> str | None:
        return "http://127.0.0.1:8080/key"

    async def look(self) -> Sighting:
        return self.looks.pop(0)

    async def grippers(self) -> dict[str, float]:
        return {"panda": 0.08}


@dataclass
class Asked:
    """Answers questions in order, and keeps them; one for which no answer is left fails the test."""

    answers: list[bool]

    def __post_init__(self) -> None:
        self.questions: list[str] = []

    async def __call__(self, question: str) -> bool:
        self.questions.append(question)
        return self.answers.pop(0)


def confirm(start: RealStart, *answers: bool, confirms: bool = False) -> tuple[Asked, str]:
    console, asked = Console(file=io.StringIO(), width=200), Asked(list(answers))
    asyncio.run(TerminalOperator(confirms=confirms, console=console, ask=asked).confirm(start))
    assert isinstance(console.file, io.StringIO)
    return asked, console.file.getvalue()


def test_four_questions_are_asked_after_what_the_camera_sees_is_shown() -> None:
    asked, said = confirm(MadeStart(SEEN), True, True, True, True)
    assert asked.questions == [question for question, _ in questions({"panda": 0.08}, resumed=False)]
    assert len(asked.questions) == 4
    assert said.index("viewer: http") < said.index("365 points")
    assert "31 nodes" in said
    assert "real-arm at full speed" in said


@pytest.mark.parametrize("yes", [0, 1, 2, 3])
def test_the_first_no_ends_the_start_with_its_reason(yes: int) -> None:
    refusal = questions({"panda": 0.08}, resumed=False)[yes][1]
    with pytest.raises(StartNotConfirmed, match=refusal):
        confirm(MadeStart(SEEN), *[True] * yes, False)


def test_without_a_dlo_the_operator_may_look_again_or_end() -> None:
    asked, said = confirm(MadeStart(NOTHING, HIDDEN, SEEN), *[True] * 6)
    assert asked.questions[:2] == ["Look again?", "Look again?"]
    assert "Lay the DLO on the table" in said
    with pytest.raises(StartNotConfirmed, match="no DLO was found"):
        confirm(MadeStart(NOTHING), False)


def test_a_camera_that_does_not_answer_is_not_reported_as_no_dlo() -> None:
    asked, said = confirm(MadeStart(SILENT, SEEN), *[True] * 5)
    assert asked.questions[0] == "Look again?"
    assert "The camera gives no picture" in said
    assert "no DLO" not in said
    assert "Lay the DLO" not in said
    with pytest.raises(StartNotConfirmed, match=r"^the camera gives no picture \(camera_lost\)$"):
        confirm(MadeStart(SILENT), confirms=True)


def test_an_operators_word_answers_the_questions_but_does_not_replace_the_dlo() -> None:
    asked, _ = confirm(MadeStart(SEEN), confirms=True)
    assert asked.questions == []
    with pytest.raises(StartNotConfirmed, match="no DLO was found"):
        confirm(MadeStart(NOTHING), confirms=True)


def test_a_resumed_arm_may_hold_and_hide_the_dlo_and_the_question_says_that_it_lets_go() -> None:
    asked, _ = confirm(MadeStart(HIDDEN, resumed=True), *[True] * 4)
    assert any("It opens where it is" in question for question in asked.questions)
    with pytest.raises(StartNotConfirmed, match="no DLO was found"):
        confirm(MadeStart(NOTHING, resumed=True), False)


def test_a_run_with_a_real_arm_and_no_terminal_is_refused_unless_an_operator_confirms_or_nothing_moves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    with pytest.raises(ConfigError, match=r"real-arm moves a real arm.*--operator-confirms"):
        check_before_start(REAL)
    check_before_start(REAL, operator_confirms=True)
    check_before_start(replace(REAL, dry_run=True))


def test_a_run_that_nobody_watches_does_not_start_a_real_arm() -> None:
    display = RunDisplay(Console(quiet=True), title="", threshold_m=0.01)
    with pytest.raises(StartNotConfirmed, match="no operator to ask"):
        asyncio.run(display.confirm(MadeStart(SEEN)))


def test_the_live_table_gives_way_to_the_questions_and_comes_back() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=100, _environ={"TERM": "xterm"})
    shown: list[bool] = []

    def is_live() -> bool:
        """Whether the cursor is hidden."""
        assert isinstance(console.file, io.StringIO)
        text = console.file.getvalue()
        return text.rfind("\x1b[?25l") > text.rfind("\x1b[?25h")

    class Watched:
        async def confirm(self, start: RealStart) -> None:
            shown.append(is_live())

    with RunDisplay(console, title="", threshold_m=0.01, operator=Watched()) as display:
        asyncio.run(display.confirm(MadeStart(SEEN)))
        shown.append(is_live())
        display.page("http://127.0.0.1:8080/key")
    assert shown == [False, True]
    assert isinstance(console.file, io.StringIO)
    assert "viewer" not in console.file.getvalue()  # the operator's questions had it


@contextmanager
def keyboard() -> Generator[int]:
    """The end of a terminal at which a person types; the other is standard input and output meanwhile."""
    person, terminal = pty.openpty()
    before = sys.stdin, sys.stdout
    with os.fdopen(terminal, "r+b", buffering=0) as raw, io.TextIOWrapper(raw, write_through=True) as both:
        sys.stdin = sys.stdout = both
        try:
            yield person
        finally:
            sys.stdin, sys.stdout = before
    os.close(person)


def typed(*lines: bytes) -> list[bool]:
    """The answers to as many questions, each typed when its question has been printed."""

    async def main(person: int) -> list[bool]:
        operator, answers = TerminalOperator(confirms=False), list[bool]()
        for number, line in enumerate(lines):
            asking = asyncio.create_task(operator._ask(f"Question {number}?"))  # pyright: ignore[reportPrivateUsage]
            text = b""
            while b"[y/N] " not in text:
                text += await asyncio.to_thread(os.read, person, 1024)
            await asyncio.sleep(0)  # it waits for the answer now
            os.write(person, line)
            async with asyncio.timeout(PATIENCE_S):
                answers.append(await asking)
        return answers

    with keyboard() as person:
        assert has_terminal()
        return asyncio.run(main(person))


@pytest.mark.parametrize(
    ("line", "is_yes"),
    [(b"y\n", True), (b"Yes\n", True), (b"\n", False), (b"n\n", False), (b"yep\n", False), (b"\x04", False)],
    ids=["y", "Yes", "Enter", "n", "yep", "end of input"],
)
def test_only_a_clear_yes_is_one(line: bytes, is_yes: bool) -> None:
    assert typed(line) == [is_yes]


def test_what_was_typed_before_a_question_does_not_answer_it() -> None:
    assert typed(b"y\ny\ny\n", b"n\n") == [True, False]


def test_ctrl_c_ends_a_question() -> None:
    """As asyncio cancels the main task at SIGINT."""

    async def main() -> None:
        asking = asyncio.create_task(TerminalOperator(confirms=False).confirm(MadeStart(SEEN)))
        await asyncio.sleep(0.01)
        assert not asking.done()
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking

    with keyboard():
        asyncio.run(main())


def test_before_a_twin_run_the_operator_is_asked_for_an_empty_table_instead_of_the_dlo() -> None:
    usual, twin = (questions({"panda": 0.08}, resumed=False, twin=twin) for twin in (False, True))
    assert "Camera and DLO are simulated" in twin[0][0]
    assert twin[1:] == usual[1:]
    start = MadeStart(SEEN)
    start.config = replace(REAL, twin=True, camera=SimulatedStereoConfig())
    assert start.config.mirrors_arm
    asked, _ = confirm(start, True, True, True, True)
    assert asked.questions[0] == twin[0][0]
