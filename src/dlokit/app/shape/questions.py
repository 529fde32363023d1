"""Questions to the operator in the terminal before a real arm moves; arms move only if all answers are yes."""

import asyncio
import contextlib
import os
import sys
import termios
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any

from rich.console import Console

from dlokit.errors import StartNotConfirmed
from dlokit.system.config import RunConfig
from dlokit.system.operator_start import FLAG, RealStart, Sighting

YES = frozenset({"y", "yes"})
_LONGEST_LINE = 4096  # of a terminal [bytes]

Ask = Callable[[str], Coroutine[Any, Any, bool]]
"""Asks one question; True only for a clear yes."""


class TerminalOperator:
    """Asks the operator in the terminal of this process, or accepts a confirmation by a flag."""

    def __init__(self, *, confirms: bool, console: Console | None = None, ask: Ask | None = None) -> None:
        """`confirms`: the operator has already confirmed everything; the camera must still see the DLO.

        `console` shows what is seen, by default the terminal; `ask` asks a question, by default on standard input.
        """
        self._confirms = confirms
        self._console = console or Console()
        self._ask = ask or partial(ask_in_terminal, console=self._console)

    async def confirm(self, start: RealStart) -> None:
        """Show what the camera sees, and ask. Raises `StartNotConfirmed` at the first answer that is not yes."""
        self._say_who_moves(start.config)
        if (page := await start.page()) is not None:
            self._say(f"viewer: {page}")
        await self._dlo_seen(start)
        await self._answered(start)

    async def confirm_motion(self, start: RealStart) -> None:
        """Ask before one motion of a running system, whose camera may be in use. Raises `StartNotConfirmed`."""
        self._say_who_moves(start.config)
        await self._answered(start)

    async def _answered(self, start: RealStart) -> None:
        grippers = await start.grippers()
        if self._confirms:
            self._say(f"confirmed by {FLAG}")
            return
        for question, refusal in questions(grippers, resumed=start.resumed, twin=start.config.mirrors_arm):
            if not await self._ask(question):
                raise StartNotConfirmed(refusal)

    async def _dlo_seen(self, start: RealStart) -> None:
        """Look until the observer finds the DLO, or the operator gives up."""
        while True:
            seen = await start.look()
            self._say(sighting_text(seen))
            if not seen.problem or (start.resumed and seen.points):
                return  # a resumed run's arm may hold the DLO, and hide some of it
            what = "no DLO was found" if seen.pictured else "the camera gives no picture"
            refusal = f"{what} ({seen.problem.partition(':')[0]})"
            if self._confirms or not await self._ask("Look again?"):
                raise StartNotConfirmed(refusal)

    def _say_who_moves(self, config: RunConfig) -> None:
        scale = config.gate.speed_scale
        pace = " at full speed (--speed-scale 0.1 is slow)" if scale == 1.0 else f" at {scale:.0%} of its speed"
        self._say(f"[bold]A real arm will move[/], by the driver {config.driver.name}{pace}.")

    def _say(self, text: str) -> None:
        self._console.print(text, highlight=False, soft_wrap=True)


async def ask_in_terminal(question: str, console: Console) -> bool:
    """Ask on standard input; True only for y or yes. Ctrl-C cancels the task."""
    console.print(f"{question} [y/N] ", markup=False, highlight=False, soft_wrap=True, end="")
    with contextlib.suppress(OSError):
        return (await _line_of(sys.stdin.fileno())).strip().lower() in YES
    return False


def questions(grippers: dict[str, float], *, resumed: bool, twin: bool = False) -> tuple[tuple[str, str], ...]:
    """The questions, each with the meaning of a No; `grippers`: distance between the fingers of each arm [m]."""
    apart = ", ".join(f"{name}: {width_m * 1e3:.0f} mm apart" for name, width_m in grippers.items())
    gripper = (
        (
            f"Does the gripper hold nothing but the DLO? It opens where it is (fingers of {apart}).",
            "the gripper holds something else than the DLO",
        )
        if resumed
        else (f"Is the gripper empty? (fingers of {apart})", "the gripper is not empty")
    )
    dlo = (
        (
            "Camera and DLO are simulated. Is the arm's own table empty, and no higher than the simulated one?",
            "the arm's own table is not empty",
        )
        if twin
        else ("Does the DLO lie in view, and can it move freely?", "the DLO does not lie free in view")
    )
    return (
        dlo,
        gripper,
        ("Is the workspace free of people and of other things?", "the workspace is not free"),
        ("Do you have a hand on the emergency stop? With yes the arm moves.", "no hand is on the emergency stop"),
    )


def sighting_text(seen: Sighting) -> str:
    """Text about the camera's view, with advice if it shows no DLO."""
    if not seen.problem:
        return f"The camera sees {seen.points} points of the DLO, and the observer found it: {seen.nodes} nodes."
    if not seen.pictured:
        return (
            f"The camera gives no picture, so nothing is known of the DLO: {seen.problem}. Check its power, its cable "
            "and its serial number; dlokit doctor lists the cameras that answer."
        )
    what = f"The camera sees {seen.points} points" if seen.points else "The camera sees no DLO"
    return (
        f"{what}, but the observer finds no DLO in them: {seen.problem}. "
        if seen.points
        else f"{what}: {seen.problem}. "
    ) + (
        "Lay the DLO on the table in view of the camera, in one piece and not under the arm; move the arm aside by "
        "hand; compare the picture with the settings of --help perception."
    )


async def _line_of(fd: int) -> str:
    """The next typed line; input from before the question is ignored.

    Ctrl-C cancels the task; the end of the input is an empty line.
    """
    termios.tcflush(fd, termios.TCIFLUSH)
    loop, typed = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(fd, typed.set)
    try:
        await typed.wait()
    finally:
        loop.remove_reader(fd)
    return os.read(fd, _LONGEST_LINE).decode(errors="replace")
