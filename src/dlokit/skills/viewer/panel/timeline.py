"""The timeline of a recorded run: a drawing of its steps and actions, and controls to play, pause and seek."""

import math
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import viser

from dlokit.skills.viewer import palette
from dlokit.skills.viewer.playback import SPEEDS, Mark, MarkKind, Player, RunTimeline
from dlokit.skills.viewer.serving.page import LoopGate

_JUMP = "choose a moment"
_PREVIOUS, _NEXT = "Previous", "Next"
_MOST_MOMENTS = 200
"""With more moments than this, the list has only actions and ends."""
_STEP_S = 0.1
"""Resolution of the slider [s]."""
_WIDTH, _BAR_Y, _BAR, _HEIGHT = 340, 16, 14, 44
_SHORTEST_LABEL = 36.0
"""Narrowest step with a name in the drawing."""
_LETTER = 5.5
"""Width of a letter of such a name."""


class TimelineTools:
    """The badge, the drawing and the controls; they change the player on the loop."""

    def __init__(self, gui: viser.GuiApi, gate: LoopGate, player: Player) -> None:
        self._gate, self._player = gate, player
        gui.add_html(badge_html(player.timeline))
        self._drawing = gui.add_html(timeline_svg(player.timeline, 0.0))
        self._slider = self._add_slider(gui)
        self._play = self._button(gui, "Play", viser.Icon.PLAYER_PLAY, player.play, "Plays on from here")
        self._pause = self._button(gui, "Pause", viser.Icon.PLAYER_PAUSE, player.pause, "Stays at this moment")
        self._add_actions(gui)
        self._add_jump(gui)
        self._add_speed(gui)
        self._add_waits(gui)
        self._drawn: tuple[float, bool] | None = None

    def draw(self) -> None:
        """Bring the tools up to date with the player."""
        now = (round(self._player.position_s, 1), self._player.playing)
        if now == self._drawn:
            return
        self._drawn = now
        self._drawing.content = timeline_svg(self._player.timeline, now[0])
        self._slider.value = min(now[0], self._slider.max)
        self._play.visible, self._pause.visible = not now[1], now[1]

    def _button(
        self, gui: viser.GuiApi, label: str, icon: viser.IconName, act: Callable[[], None], hint: str
    ) -> viser.GuiButtonHandle:
        button = gui.add_button(label, icon=icon, hint=hint)
        button.on_click(self._gate.posting(act))
        return button

    def _add_slider(self, gui: viser.GuiApi) -> viser.GuiSliderHandle[float]:
        steps = max(math.ceil(self._player.timeline.duration_s / _STEP_S), 1)  # rounded up: the end can be reached
        slider = gui.add_slider(
            "Time [s]",
            min=0.0,
            max=round(steps * _STEP_S, 1),
            step=_STEP_S,
            initial_value=0.0,
            hint="Drag to any moment of the run",
        )

        async def dragged(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:  # a person's browser, not `draw`
                self._gate.post(self._player.seek, float(slider.value))

        slider.on_update(dragged)
        return slider

    def _add_actions(self, gui: viser.GuiApi) -> None:
        group = gui.add_button_group(
            "Action", (_PREVIOUS, _NEXT), hint="Goes to the beginning of an action, or to the end of a task"
        )
        acts = {_PREVIOUS: self._player.previous_action, _NEXT: self._player.next_action}
        group.on_click(self._gate.posting(lambda: acts[group.value]()))

    def _add_jump(self, gui: viser.GuiApi) -> None:
        moments = {f"{mark.time_s:.1f} s  {mark.name}": mark.time_s for mark in listed(self._player.timeline.marks)}
        jump = gui.add_dropdown("Go to", (_JUMP, *moments), initial_value=_JUMP, hint="Steps, actions and ends")

        async def chosen(_: object) -> None:
            if jump.value != _JUMP:
                time_s = moments[jump.value]
                jump.value = _JUMP  # so that the same moment can be chosen again
                self._gate.post(self._player.seek, time_s)

        jump.on_update(chosen)

    def _add_speed(self, gui: viser.GuiApi) -> None:
        player = self._player
        speeds = {f"{speed:g} ×": speed for speed in sorted({*SPEEDS, player.speed})}
        choice = gui.add_dropdown(
            "Speed", tuple(speeds), initial_value=f"{player.speed:g} ×", hint="Seconds of the run per second"
        )
        choice.on_update(self._gate.posting(lambda: setattr(player, "speed", speeds[choice.value])))

    def _add_waits(self, gui: viser.GuiApi) -> None:
        player = self._player
        box = gui.add_checkbox(
            "Skip waits", initial_value=player.skips_waits, hint="Passes over the time in which no arm moves"
        )
        box.on_update(self._gate.posting(lambda: setattr(player, "skips_waits", box.value)))


def listed(marks: Sequence[Mark]) -> tuple[Mark, ...]:
    """The marks for a list: all, or in a long run only actions and ends."""
    if len(marks) <= _MOST_MOMENTS:
        return tuple(marks)
    return tuple(mark for mark in marks if mark.kind is not MarkKind.STEP)


def badge_html(timeline: RunTimeline) -> str:
    """The badge of a recorded run: its name, date and duration."""
    return (
        f'<div data-badge style="margin:0.4em 0.8em 0.2em;color:{palette.INK}"><span style="padding:0.15em 0.7em;'
        f"border-radius:1em;font-size:0.72em;font-weight:700;letter-spacing:0.06em;color:{palette.PAPER};"
        f'background:{palette.INK}">RECORDED RUN</span><span style="margin-left:0.6em;font-weight:600;'
        f'overflow-wrap:anywhere">{escape(timeline.name)}</span><div style="font-size:0.8em;opacity:0.75">'
        f"{escape(timeline.recorded_at)} · {timeline.duration_s:.1f} s · watching it moves no arm</div></div>"
    )


def timeline_svg(timeline: RunTimeline, position_s: float) -> str:
    """The steps as coloured parts, skipped waits pale, actions and ends as marks above, and the position."""

    def x(time_s: float) -> float:
        return 4.0 + (_WIDTH - 8.0) * time_s / max(timeline.duration_s, 1e-9)

    steps, at_s = timeline.steps(), position_s + _STEP_S / 2.0  # positions are rounded
    current = next((name for begin_s, end_s, name in steps if begin_s <= at_s < end_s), "")
    drawn = [(name, x(begin_s), x(end_s), begin_s <= at_s < end_s) for begin_s, end_s, name in steps]
    parts = [_step(number, *step) for number, step in enumerate(drawn)]
    parts += [
        f'<rect x="{x(begin_s):.1f}" y="{_BAR_Y}" width="{x(end_s) - x(begin_s):.1f}" height="{_BAR}" '
        f'fill="{palette.PAPER}" fill-opacity="0.65"/>'
        for begin_s, end_s in timeline.waits
    ]
    parts += [_step_label(name, begin, end) for name, begin, end, _ in drawn]  # over the pale waits
    actions = palette.css(palette.ACTION.color)
    for mark in timeline.of(MarkKind.ACTION):
        parts.append(_mark(x(mark.time_s), actions, mark.name.rpartition(" ")[2], mark.name))
    for mark in timeline.of(MarkKind.END):
        parts.append(_mark(x(mark.time_s), palette.INK, "■", mark.name))
    parts.append(
        f'<line x1="{x(position_s):.1f}" x2="{x(position_s):.1f}" y1="{_BAR_Y - 3}" y2="{_BAR_Y + _BAR + 3}" '
        f'stroke="{palette.STOP_CSS}" stroke-width="2"/>'
    )
    return (
        f'<div style="padding:0 0.6em"><svg role="img" data-position="{position_s:.1f}" '
        f'aria-label="timeline at {position_s:.1f} s" viewBox="0 0 {_WIDTH} {_HEIGHT}" width="100%" '
        f'xmlns="http://www.w3.org/2000/svg" font-family="system-ui, sans-serif">{"".join(parts)}'
        f'<text x="4" y="{_HEIGHT - 2}" font-size="10.5" fill="{palette.INK}">{position_s:.1f} s  {escape(current)}'
        f"</text></svg></div>"
    )


def _step(number: int, name: str, begin: float, end: float, now: bool) -> str:
    fill = palette.ACTIVE if now else ("#cbd5e1", "#e2e8f0")[number % 2]
    width = max(end - begin, 0.5)
    return (
        f'<rect x="{begin:.1f}" y="{_BAR_Y}" width="{width:.1f}" height="{_BAR}" fill="{fill}">'
        f"<title>{escape(name)}</title></rect>"
    )


def _step_label(name: str, begin: float, end: float) -> str:
    """The name of a step, where its part is wide enough."""
    if end - begin < max(_SHORTEST_LABEL, _LETTER * len(name)):
        return ""
    return (
        f'<text x="{(begin + end) / 2:.1f}" y="{_BAR_Y + _BAR - 3.5}" font-size="9.5" text-anchor="middle" '
        f'fill="{palette.INK}" pointer-events="none">{escape(name)}</text>'
    )


def _mark(x: float, color: str, label: str, name: str) -> str:
    return (
        f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{_BAR_Y - 4}" y2="{_BAR_Y + _BAR}" stroke="{color}" stroke-width="1.5"/>'
        f'<text x="{x:.1f}" y="{_BAR_Y - 6}" font-size="9.5" text-anchor="middle" fill="{color}">{escape(label)}'
        f"<title>{escape(name)}</title></text>"
    )
