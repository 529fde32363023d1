"""The flow chart as a drawing (SVG), the active step highlighted: one column of boxes, arrows in lanes beside it.

It is drawn from the flow's own table, so that chart and flow agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from dlokit.skills.viewer import palette

Edge = tuple[str, str, str]
"""(step, outcome, next): one arrow of a flow chart."""

_BOX_X, _BOX_WIDTH, _ROW, _BOX_PADDING, _GAP = 4, 128, 15, 6, 20
_LABEL_X = _BOX_X + _BOX_WIDTH + 5
_LANE_X, _LANE_WIDTH = 262, 8


@dataclass(frozen=True)
class _Box:
    name: str
    is_end: bool
    y: float
    height: float
    aside: tuple[Edge, ...]
    """Arrows that leave to the right, one per row."""
    below: str | None
    """Outcome of the arrow to the next box, if there is one."""


def flow_chart_svg(edges: Sequence[Edge], step: str = "", last_outcome: str = "") -> str:
    """The chart of `edges`, with the step `step` highlighted; `last_outcome` is the arrow that led there.

    Boxes are in the order of their first outgoing arrow; below them are the ends, which have none.
    """
    boxes = _boxes(edges)
    lanes, lane_count = _lanes(boxes)
    width = _LANE_X + _LANE_WIDTH * lane_count + 8
    height = boxes[-1].y + boxes[-1].height + 4 if boxes else 0
    parts = [_arrow(box, boxes, lanes) for box in boxes] + [_draw(box, box.name == step) for box in boxes]
    caption = f"last outcome: {_words(last_outcome)}" if last_outcome else ""
    return (
        f'<div style="padding:0 0.6em 0.4em">'
        f'<svg role="img" aria-label="flow chart, at {escape(step, quote=True)}" data-step="{escape(step, quote=True)}"'
        f' viewBox="0 0 {width} {height:.0f}" width="100%" xmlns="http://www.w3.org/2000/svg"'
        f' font-family="system-ui, sans-serif">'
        f'<defs><marker id="dlokit-tip" markerWidth="7" markerHeight="6" refX="6" refY="3" orient="auto">'
        f'<path d="M0,0 L7,3 L0,6 z" fill="{palette.FAINT}"/></marker></defs>'
        f"{''.join(parts)}</svg>"
        f'<div style="font-size:0.75em;color:{palette.FAINT}">{caption}</div></div>'
    )


def _boxes(edges: Sequence[Edge]) -> list[_Box]:
    steps = list(dict.fromkeys(source for source, _, _ in edges))
    names = list(dict.fromkeys([*steps, *(target for _, _, target in edges)]))
    boxes: list[_Box] = []
    y = 4.0
    for index, name in enumerate(names):
        following = names[index + 1] if index + 1 < len(names) else None
        leaving = [edge for edge in edges if edge[0] == name]
        straight = next((edge for edge in leaving if edge[2] == following), None)
        aside = tuple(edge for edge in leaving if edge is not straight)
        height = _ROW * max(1, len(aside)) + _BOX_PADDING
        boxes.append(_Box(name, name not in steps, y, height, aside, straight[1] if straight else None))
        # Ends need no room for a label below them.
        y += height + (_GAP if straight else _GAP / 2 if name in steps else 5)
    return boxes


def _lanes(boxes: Sequence[_Box]) -> tuple[dict[str, int], int]:
    """A lane for each step with arrows from the side; steps whose arrows do not overlap use a common lane."""
    spans: dict[str, tuple[float, float]] = {}
    by_name = {box.name: box for box in boxes}
    for box in boxes:
        for _, _, target in box.aside:
            ys = (box.y, box.y + box.height, by_name[target].y, by_name[target].y + by_name[target].height)
            low, high = spans.get(target, (ys[0], ys[0]))
            spans[target] = (min(low, *ys), max(high, *ys))
    lanes: dict[str, int] = {}
    taken: list[list[tuple[float, float]]] = []
    for target, (low, high) in sorted(spans.items(), key=lambda item: item[1][1] - item[1][0]):
        free = (i for i, lane in enumerate(taken) if all(high < a or b < low for a, b in lane))
        lane = next(free, len(taken))
        if lane == len(taken):
            taken.append([])
        taken[lane].append((low, high))
        lanes[target] = lane
    return lanes, len(taken)


def _arrow(box: _Box, boxes: Sequence[_Box], lanes: dict[str, int]) -> str:
    by_name = {other.name: other for other in boxes}
    line = f'fill="none" stroke="{palette.FAINT}" stroke-width="1.1" marker-end="url(#dlokit-tip)"'
    right, parts = _BOX_X + _BOX_WIDTH, list[str]()
    if box.below is not None:
        middle, bottom = _BOX_X + 20, box.y + box.height
        parts.append(f'<path d="M{middle},{bottom} V{bottom + _GAP - 1}" {line}/>')
        parts.append(_text(middle + 6, bottom + _GAP / 2 + 3, box.below, 10, palette.FAINT))
    for row, (_, outcome, target) in enumerate(box.aside):
        y = box.y + _BOX_PADDING / 2 + _ROW * (row + 0.5)
        # Arrows arrive at the lower edge of a box, from which no arrow leaves.
        arrival = by_name[target].y + by_name[target].height - 3
        lane = _LANE_X + _LANE_WIDTH * lanes[target]
        parts.append(f'<path d="M{right},{y} H{lane} V{arrival} H{right + 1}" {line} stroke-linejoin="round"/>')
        parts.append(_text(_LABEL_X, y - 2, outcome, 10, palette.FAINT))
    return "".join(parts)


def _draw(box: _Box, active: bool) -> str:
    fill = palette.ACTIVE if active else palette.PAPER
    radius = box.height / 2 if box.is_end else 5
    return (
        f'<rect x="{_BOX_X}" y="{box.y}" width="{_BOX_WIDTH}" height="{box.height}" rx="{radius}" fill="{fill}"'
        f' stroke="{palette.INK if active else palette.FAINT}" stroke-width="{1.6 if active else 1}"/>'
        + _text(_BOX_X + _BOX_WIDTH / 2, box.y + box.height / 2 + 4, box.name, 11.5, palette.INK, centred=True)
    )


def _text(x: float, y: float, name: str, size: float, color: str, *, centred: bool = False) -> str:
    anchor = ' text-anchor="middle"' if centred else ""
    # A white outline keeps text readable where a lane passes behind it.
    return (
        f'<text x="{x}" y="{y}" font-size="{size}" fill="{color}"{anchor} paint-order="stroke" stroke="{palette.PAPER}"'
        f' stroke-width="{0 if centred else 2.5}">{_words(name)}</text>'
    )


def _words(name: str) -> str:
    return escape(name.replace("_", " "))
