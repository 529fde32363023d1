"""The tab in which a user finds the thresholds of the segmentation: the picture with its mask, sliders, a click."""

import base64
import math
import re
from html import escape
from typing import Any

import cv2
import numpy as np
import viser

from dlokit.ranges import NumericSetting, numeric_settings
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.panel.controls import note_html
from dlokit.skills.viewer.segmentation import SegmentationTuner, flags, table
from dlokit.skills.viewer.serving.page import LoopGate
from dlokit.types.arrays import UInt8Array
from dlokit.types.image import SegmentedPicture

_PIXEL = "Pixel"
_PIXEL_TEXT = re.compile(r"\s*(\d{1,5})\s*,\s*(\d{1,5})\s*")
_OPACITY = 0.65
_STEPS = 200
"""A slider of a setting that is not whole has at least this many steps."""
_EXPLAINED = (
    "Find which pixels are the DLO: click on it in the picture, then correct with the sliders. A change lasts for this "
    "run; the lines at the end keep it. While a gripper holds the DLO nothing can be changed."
)
# viser's images have no clicks. This one writes the clicked pixel into the field of that name, as a person could.
# React notices a value that is set through the element's own property, and an event of input. A press, as a click that
# begins on one picture and ends on the next one is none.
_CLICKED = f"""const r=this.getBoundingClientRect(),d=this.dataset;
const label=[...document.querySelectorAll('label')].find(each=>each.textContent==='{_PIXEL}');
let box=label;while(box&&!box.querySelector('input'))box=box.parentElement;
if(box){{const field=box.querySelector('input');
const u=Math.floor((event.clientX-r.left)/r.width*d.width),v=Math.floor((event.clientY-r.top)/r.height*d.height);
Object.getOwnPropertyDescriptor(HTMLInputElement.prototype,'value').set.call(field,u+', '+v);
field.dispatchEvent(new Event('input',{{bubbles:true}}));}}"""

_Slider = viser.GuiSliderHandle[Any] | viser.GuiNumberHandle[Any]


class SegmentationTab:
    """Shows the state of a tuner, and passes it what the user does; without the switch it computes and does nothing."""

    def __init__(
        self, gui: viser.GuiApi, tabs: viser.GuiTabGroupHandle, gate: LoopGate, tuner: SegmentationTuner
    ) -> None:
        self._gui, self._gate, self._tuner = gui, gate, tuner
        self._drawn: tuple[object, ...] = ()
        self._moved = -1
        with tabs.add_tab("Mask", viser.Icon.FILTER):
            self._explained = gui.add_html(note_html(_EXPLAINED))
            self._on = gui.add_checkbox(
                "Adjust", initial_value=False, hint="Shows the mask, and lets the page change the segmentation"
            )
            self._folder = gui.add_folder("Segmentation", visible=False)
        self._on.on_update(gate.posting(self._switched))
        with self._folder:
            self._picture = gui.add_html("")
            self._pixel = gui.add_text(_PIXEL, "", hint="Click on the DLO in the picture, or type column, row")
            self._notice = gui.add_html("")
            self._choice = gui.add_dropdown("Method", tuner.names, initial_value=tuner.settings.name)
            self._sliders = {name: self._add_sliders(kind) for name, kind in tuner.tools.kind.installed().items()}
            reset = gui.add_button("As at the start", icon=viser.Icon.REFRESH, color="gray")
            self._keep = gui.add_html("")
        self._pixel.on_update(self._pixel_changed)
        self._choice.on_update(self._chosen)
        reset.on_click(gate.posting(tuner.reset))

    def draw(self) -> None:
        """Bring the tab up to date; viser sends only the differences."""
        tuner = self._tuner
        if not self._on.value:
            return
        tuner.show()
        now = (tuner.picture, tuner.settings, tuner.notice)
        if tuple(map(id, now)) == tuple(map(id, self._drawn)):
            return
        if tuner.picture is not None and not (self._drawn and tuner.picture is self._drawn[0]):
            self._picture.content = picture_html(tuner.picture, tuner.size_px)
        self._drawn = now
        problem = "" if tuner.picture is None else tuner.picture.problem
        self._notice.content = "".join(map(said_html, filter(None, (tuner.notice, problem))))
        self._keep.content = keep_html(tuner)
        if tuner.moved != self._moved:  # else a slider would be sent back to where it was while it is dragged
            self._moved = tuner.moved
            self._place_sliders()

    def _place_sliders(self) -> None:
        settings = self._tuner.settings
        self._choice.value = settings.name
        for name, sliders in self._sliders.items():
            for setting, slider in sliders.items():
                slider.visible = name == settings.name
                if slider.visible:
                    slider.value = getattr(settings, setting)

    def _switched(self) -> None:
        self._folder.visible, self._explained.visible = self._on.value, not self._on.value

    def _add_sliders(self, kind: type[Any]) -> dict[str, _Slider]:
        defaults, present = kind(), self._tuner.settings
        settings = present if isinstance(present, kind) else defaults
        numbers = numeric_settings(kind)
        sliders = {each.name: self._add_slider(each, getattr(settings, each.name)) for each in numbers}

        async def moved(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:  # a person's browser, not `draw`
                kinds = {each.name: int if each.whole else float for each in numbers}
                # All of them: a value that was refused together with another may now be valid.
                self._gate.post(self._tuner.change, {name: kinds[name](each.value) for name, each in sliders.items()})

        for slider in sliders.values():
            slider.on_update(moved)
        return sliders

    def _add_slider(self, setting: NumericSetting, value: float) -> _Slider:
        label = setting.name.replace("_", " ")
        least, most = setting.least, setting.most
        if least is None or most is None:  # without a declared range a slider has no ends
            return self._gui.add_number(
                label, value, min=least, max=most, step=1 if setting.whole else None, hint=setting.text
            )
        step = step_of(least, most, whole=setting.whole)
        return self._gui.add_slider(label, least, most, step, value, hint=setting.text)

    async def _chosen(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            self._gate.post(self._tuner.choose, self._choice.value)

    async def _pixel_changed(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None and (pixel := _PIXEL_TEXT.fullmatch(self._pixel.value)) is not None:
            self._gate.post(self._tuner.click, (int(pixel[1]), int(pixel[2])))


def step_of(least: float, most: float, *, whole: bool) -> float:
    """A slider's step: 1, or the power of ten that gives it enough steps."""
    return 1 if whole else 10.0 ** math.floor(math.log10((most - least) / _STEPS))


def picture_html(seen: SegmentedPicture, size_px: tuple[int, int]) -> str:
    """The picture with its mask, of a picture of `size_px` (width, height), and what the colours mean."""
    rgb = masked(seen)
    _, encoded = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])
    data = base64.b64encode(encoded.tobytes()).decode()
    keys = ((palette.MASK_USED, f"DLO ({seen.fraction:.1%} of the picture)"), (palette.MASK_DROPPED, "not used"))
    legend = "".join(
        f'<span style="margin-right:1em"><span style="display:inline-block;width:0.8em;height:0.8em;border-radius:50%;'
        f'margin-right:0.35em;background:{palette.css(color)}"></span>{text}</span>'
        for color, text in keys
    )
    why = "Segmented, but outside the box, on an arm, or a patch too small to be used"
    return (
        f'<div data-used="{seen.fraction:.4f}" style="padding:0 0.6em 0.3em"><img alt="the picture with its mask" '
        f'data-width="{size_px[0]}" data-height="{size_px[1]}" decoding="sync" '
        f'onpointerdown="{escape(_CLICKED, quote=True)}" '
        f'style="display:block;width:100%;cursor:crosshair" src="data:image/jpeg;base64,{data}">'
        f'<div title="{why}" style="font-size:0.8em;color:{palette.INK}">{legend}</div></div>'
    )


def masked(seen: SegmentedPicture) -> UInt8Array:
    """The picture (h, w, 3) with the pixels of the DLO, and those that are not used, in their colours."""
    drawn = seen.pixels.astype(np.float32)
    for mask, color in ((seen.dropped, palette.MASK_DROPPED), (seen.used, palette.MASK_USED)):
        alpha = _OPACITY / 255.0 * mask[..., None].astype(np.float32)
        drawn += alpha * (np.array(color, dtype=np.float32) - drawn)
    return np.asarray(drawn.round(), dtype=np.uint8)


def said_html(text: str) -> str:
    """What became of a change, or what is wrong with it, beside a bar."""
    sentence = escape(text[:1].upper() + text[1:].rstrip(".") + ".")
    return (
        f'<div data-said style="margin:0.2em 0.8em;padding:0.3em 0.6em;font-size:0.85em;color:{palette.INK};'
        f'border-left:0.3em solid {palette.css(palette.MASK_USED)};overflow-wrap:anywhere">{sentence}</div>'
    )


def keep_html(tuner: SegmentationTuner) -> str:
    """The lines that begin the next run with the present settings: a click selects them."""
    parts = [("On the command line", flags(tuner.settings, tuner.tools.group))]
    if tuner.tools.has_file:
        parts.append(("In a configuration file", table(tuner.settings, tuner.tools.group)))
    blocks = "".join(
        f'<div style="margin-top:0.3em">{title}:</div><pre data-keep style="margin:0;padding:0.4em;background:#f1f5f9;'
        f'white-space:pre-wrap;overflow-wrap:anywhere;user-select:all">{escape(text)}</pre>'
        for title, text in parts
    )
    return f'<div style="padding:0 0.8em 0.5em;font-size:0.8em;color:{palette.INK}">Keep these settings.{blocks}</div>'
