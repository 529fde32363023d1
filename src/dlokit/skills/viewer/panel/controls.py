"""The operator's controls: the buttons of `operation`, the line of advice, and the end of a task."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from typing import Literal

import viser

from dlokit.description.shapes import BUILTIN_SHAPES
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.palette import term
from dlokit.skills.viewer.panel.operation import LEAVE_DRAWING, Button, PageState
from dlokit.skills.viewer.serving.address import PREFIX
from dlokit.skills.viewer.serving.page import LoopGate
from dlokit.types.flow import RunOutcome, TaskEnd

_CHOOSE = "choose a shape"


@dataclass(frozen=True, kw_only=True)
class Operator:
    """Callbacks for the operator's actions, called on the loop."""

    press: Callable[[Button, int | None], None]
    """A button was pressed, on the page of the visitor with this number."""
    leave_drawing: Callable[[], None]
    take_shape: Callable[[str], None]
    """A built-in shape was chosen."""
    take_file: Callable[[bytes, str], None]
    """A file was loaded: its content and its name."""
    goal_file: Callable[[], bytes | None]
    """The goal as a file; None: no goal is set. Called on a thread of the server."""
    ask_before_motions: Callable[[bool], None]


_Color = Literal["red", "green", "orange", "gray", "blue", "teal"]
_COLORS: Mapping[Button, _Color] = {
    Button.STOP: "red",
    Button.SHAPE: "green",
    Button.PROCEED: "green",
    Button.ENABLE: "orange",
    Button.DRAW: "blue",
    Button.NEAREST: "teal",
}
"""The others are gray."""
_ICONS: Mapping[Button, viser.IconName] = {
    Button.STOP: viser.Icon.HAND_STOP,
    Button.SHAPE: viser.Icon.WAND,
    Button.PROCEED: viser.Icon.PLAYER_TRACK_NEXT,
    Button.PAUSE: viser.Icon.PLAYER_PAUSE,
    Button.RESUME: viser.Icon.PLAYER_PLAY,
    Button.ENABLE: viser.Icon.LOCK_OPEN,
    Button.END: viser.Icon.POWER,
    Button.SEE: viser.Icon.CAMERA,
    Button.DRAW: viser.Icon.PENCIL,
    Button.NEAREST: viser.Icon.MAGNET,
    Button.UNDO: viser.Icon.ARROW_BACK_UP,
    Button.RESET: viser.Icon.REFRESH,
    Button.MORE: viser.Icon.PLUS,
    Button.FEWER: viser.Icon.MINUS,
    Button.LOAD: viser.Icon.UPLOAD,
    Button.SAVE: viser.Icon.DOWNLOAD,
}
"""Each its own: the style sheet finds a button by its icon."""
_FIRST_ROW: Mapping[Button, float] = {Button.SHAPE: 0.64, Button.PAUSE: 0.36, Button.RESUME: 0.36}
_SMALL_ROWS: tuple[Mapping[Button, float], ...] = (
    {Button.SEE: 0.66, Button.UNDO: 0.34},
    dict.fromkeys((Button.RESET, Button.MORE, Button.FEWER), 1 / 3),
    dict.fromkeys((Button.LOAD, Button.SAVE), 0.5),
)
"""Buttons that share a row, with the fraction of its width that each takes; Pause and Resume are never both shown."""
_HIDDEN_WHILE_OFF = frozenset({Button.PROCEED, Button.ENABLE, Button.RESUME, Button.NEAREST})
"""Buttons that are shown only while they are enabled; the line above them explains their purpose."""
# viser has no setting for the size or place of a button, and shows no hint of one; a style sheet does both. A tooltip
# covers what is below its button, so it goes with a click, or after a while.
_STYLE = """<style>
button:has(.icon-tabler-hand-stop){height:3.4em;font-size:1.25em;font-weight:700;letter-spacing:0.08em}
:has(> button .icon-tabler-hand-stop){position:sticky;top:0;z-index:20}
:has(> * > button.mantine-Button-root){position:relative}
:has(> button.mantine-Button-root):hover::after{position:absolute;left:0.8em;right:0.8em;z-index:30;margin-top:0.2em;
padding:0.4em 0.7em;border-radius:4px;background:%(ink)s;color:%(paper)s;font-size:0.8em;line-height:1.4;
pointer-events:none;animation:dlokit-hint 8s 0.5s both}
:has(> button:focus)::after{display:none}
@keyframes dlokit-hint{0%%,100%%{opacity:0}2%%,97%%{opacity:1}}
button:has(.tabler-icon-list-search){display:none}
%(shared)s{display:inline-block;box-sizing:border-box;margin-inline:0!important;padding-inline:3px}
%(first)s{margin-left:7px!important}
:is(%(small)s) > button{font-size:0.78em;font-weight:500;padding-inline:0.3em}
:is(%(small)s) > button:not(:disabled){background:#e2e8f0;color:%(ink)s}
%(widths)s
</style>"""


def _box(button: Button) -> str:
    """The selector of the box around a button."""
    return f":has(> button .icon-tabler-{_ICONS[button]})"


def style_html() -> str:
    """The style sheet of the buttons: STOP stays in view while the panel scrolls, and some buttons share a row."""
    rows = (_FIRST_ROW, *_SMALL_ROWS)
    return _STYLE % {
        "ink": palette.INK,
        "paper": palette.PAPER,
        "shared": ",".join(_box(button) for row in rows for button in row),
        "first": ",".join(_box(next(iter(row))) for row in rows),
        "small": ",".join(_box(button) for row in _SMALL_ROWS for button in row),
        "widths": "\n".join(
            f"{_box(button)}{{width:calc({part:.4f}*(100% - 14px))}}" for row in rows for button, part in row.items()
        ),
    }


def hints_html(page: PageState) -> str:
    """The tooltips of the buttons: what each does, or why it is off and what to do. STOP has none: it would cover the
    buttons that are needed next. Nor has a button whose line above it says the same."""
    rules = (
        f"{_box(button)}:hover::after{{content:{_quoted(page.buttons[button].hint)}}}"
        for button in _ICONS
        if button is not Button.STOP and page.buttons[button].hint
    )
    return f"<style>{''.join(rules)}</style>"


def _quoted(text: str) -> str:
    """A string of a style sheet within HTML."""
    escaped = "".join(f"\\{ord(char):x} " if char in '\\"<\n' else char for char in text)
    return f'"{escaped}"'


class Controls:
    """The buttons, in the states that `page_state` computes."""

    def __init__(self, gui: viser.GuiApi, gate: LoopGate, operator: Operator) -> None:
        self._gui, self._gate, self._operator = gui, gate, operator
        self._buttons: dict[Button, viser.GuiButtonHandle | viser.GuiDropdownHandle[str] | viser.GuiUploadButtonHandle]
        self._buttons = {}
        gui.add_html(style_html())
        self._hints = gui.add_html("")
        self._line = gui.add_html("")
        self._add(Button.STOP)
        self._add(Button.ENABLE)
        self._add(Button.PROCEED)
        self._add(Button.SHAPE)
        self._add(Button.PAUSE)
        self._add(Button.RESUME)

    def add_goal(self) -> None:
        """Add the tools that set the goal."""
        gui = self._gui
        self._add_shapes()
        for button in (Button.NEAREST, Button.DRAW, Button.SEE, Button.UNDO, Button.RESET, Button.MORE, Button.FEWER):
            self._add(button)
        self._escape = gui.add_command(LEAVE_DRAWING, hotkey="escape", icon=_ICONS[Button.DRAW], disabled=True)
        self._escape.on_trigger(self._gate.posting(self._operator.leave_drawing))
        upload = gui.add_upload_button(Button.LOAD.value, icon=_ICONS[Button.LOAD], color="gray", mime_type=".csv")
        upload.on_upload(self._gate.posting(lambda: self._operator.take_file(upload.value.content, upload.value.name)))
        self._buttons[Button.LOAD] = upload
        save = self._add(Button.SAVE, acts=False)

        async def saves(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            content = self._operator.goal_file()
            if content is not None and event.client is not None:
                event.client.send_file_download("goal.csv", content, save_immediately=True)

        save.on_click(saves)
        gui.add_html('<div style="height:3em"></div>')  # for the tooltips of the last row

    def add_run(self) -> None:
        """Add the controls of the whole run."""
        stepwise = self._gui.add_checkbox(
            "Step by step", initial_value=False, hint="Ask before each motion of the arm; it can be changed at any time"
        )
        stepwise.on_update(self._gate.posting(lambda: self._operator.ask_before_motions(stepwise.value)))
        self._add(Button.END)

    def show(self, page: PageState) -> None:
        """Show a state of the page; viser sends only the differences."""
        self._line.content = line_html(page)
        self._hints.content = hints_html(page)
        for button, handle in self._buttons.items():
            state = page.buttons[button]
            handle.disabled = not state.enabled
            handle.label = state.label
            handle.hint = state.hint
            if button in _HIDDEN_WHILE_OFF:
                handle.visible = state.enabled
        pause, resume = page.buttons[Button.PAUSE], page.buttons[Button.RESUME]
        self._buttons[Button.PAUSE].visible = pause.enabled or not resume.enabled
        self._escape.disabled = not page.drawing

    def _add(self, button: Button, *, acts: bool = True) -> viser.GuiButtonHandle:
        handle = self._gui.add_button(
            button.value,
            color=_COLORS.get(button, "gray"),
            icon=_ICONS[button],
            visible=button not in _HIDDEN_WHILE_OFF,
        )

        async def pressed(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            self._gate.post(self._operator.press, button, event.client_id)

        if acts:
            handle.on_click(pressed)
        self._buttons[button] = handle
        return handle

    def _add_shapes(self) -> None:
        shapes = self._gui.add_dropdown(Button.SHAPES.value, (_CHOOSE, *BUILTIN_SHAPES), initial_value=_CHOOSE)

        async def chosen(_: object) -> None:
            name = shapes.value
            if name != _CHOOSE:
                shapes.value = _CHOOSE  # so that the operator can choose the same shape again
                self._gate.post(self._operator.take_shape, name)

        shapes.on_update(chosen)
        self._buttons[Button.SHAPES] = shapes


def line_html(page: PageState) -> str:
    """The headline and the advice for the operator."""
    edge = palette.STOP_CSS if page.urgent else palette.css(palette.STATE.color)
    return (
        f'<div data-line style="margin:0.3em 0.8em;padding:0.4em 0.7em;border-left:0.35em solid {edge};'
        f'background:#f1f5f9;color:{palette.INK}"><div style="font-weight:650;font-size:1.05em">'
        f'{escape(page.headline)}</div><div style="font-size:0.88em;overflow-wrap:anywhere">{escape(page.advice)}</div>'
        "</div>"
    )


def note_html(text: str, tooltip: str = "") -> str:
    """A note in small type."""
    return (
        f'<div title="{escape(tooltip, quote=True)}" style="padding:0 0.9em;font-size:0.8em;color:{palette.INK};'
        'opacity:0.8;overflow-wrap:anywhere">'
        f"{escape(text)}</div>"
    )


def error_html(rmse_m: float | None, outcome: RunOutcome | None) -> str:
    """The error of a task with an outcome, or of one that runs (None)."""
    if rmse_m is None:
        return f"{term('RMSE')} –"
    # An action that runs or was cut short has changed it since the last look.
    last = "last " if outcome in (None, RunOutcome.CANCELLED, RunOutcome.FAILED) else ""
    return f"{last}{term('RMSE')} {rmse_m * 1000.0:.1f} mm"


def end_html(end: TaskEnd, *, served: bool) -> str:
    """The end of a task: outcome, error, actions, the sentences that explain it, its files and their folder.

    The files are links while they are `served`.
    """
    color = palette.ALIVE if end.outcome.is_success else palette.LOST
    actions = f"1 {term('action')}" if end.actions == 1 else f"{end.actions} {term('actions')}"
    names = [escape(file.rpartition("/")[2]) for file in end.files]
    if served:
        names = [
            f'<a href="{PREFIX}{escape(file)}" target="_blank" rel="noopener">{name}</a>'
            for file, name in zip(end.files, names, strict=True)
        ]
    inside = end.files[0].rpartition("/")[0] if end.files else ""
    path = escape("/".join(filter(None, (end.folder, inside))))
    folder = f'<div style="opacity:0.7;overflow-wrap:anywhere">{path}</div>' if end.folder else ""
    return (
        f'<div data-end="{end.number}" style="margin:0.3em 0.8em;padding:0.4em 0.7em;font-size:0.85em;'
        f'border-left:0.35em solid {palette.css(color)};color:{palette.INK}"><div style="font-size:1.2em;'
        f'font-weight:650">Task {end.number}, to {escape(end.goal or "no goal")}: '
        f"{escape(end.outcome.value.replace('_', ' '))}</div><div>{actions} · {error_html(end.rmse_m, end.outcome)} · "
        f"{term('threshold')} {end.threshold_m * 1000.0:.1f} mm</div>"
        f'<div style="overflow-wrap:anywhere">{escape(end.text)}</div>'
        f"<div>{' · '.join(names)}</div>{folder}</div>"
    )
