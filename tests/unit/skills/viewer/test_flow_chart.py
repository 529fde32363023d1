import re
import xml.etree.ElementTree as ET
from itertools import pairwise

from dlokit.skills.viewer import palette
from dlokit.skills.viewer.panel.flow_chart import Edge, flow_chart_svg

FLOW: tuple[Edge, ...] = (
    ("look", "seen", "compare"),
    ("look", "lost", "failed"),
    ("compare", "far", "move_there"),
    ("compare", "close", "converged"),
    ("move_there", "done", "look"),
)
SVG = "{http://www.w3.org/2000/svg}"


def _parse(html: str) -> ET.Element:
    return ET.fromstring(html)


def _lit(html: str) -> list[str]:
    root = _parse(html)
    boxes = list(root.iter(f"{SVG}rect"))
    names = [element.text or "" for element in root.iter(f"{SVG}text") if element.get("text-anchor") == "middle"]
    return [name for box, name in zip(boxes, names, strict=True) if box.get("fill") == palette.ACTIVE]


def test_every_step_and_every_outcome_of_the_table_is_drawn_once() -> None:
    texts = [element.text for element in _parse(flow_chart_svg(FLOW)).iter(f"{SVG}text")]
    boxes = ["look", "compare", "move there", "failed", "converged"]
    assert sorted(t or "" for t in texts) == sorted([*boxes, *(outcome for _, outcome, _ in FLOW)])


def test_only_the_current_step_is_highlighted_also_if_it_is_an_end() -> None:
    assert _lit(flow_chart_svg(FLOW)) == []
    assert _lit(flow_chart_svg(FLOW, "move_there", "far")) == ["move there"]
    assert _lit(flow_chart_svg(FLOW, "converged")) == ["converged"]


def test_steps_do_not_overlap() -> None:
    rects = _parse(flow_chart_svg(FLOW)).iter(f"{SVG}rect")
    spans = [(float(rect.get("y") or 0), float(rect.get("height") or 0)) for rect in rects]
    assert all(y + height < below for (y, height), (below, _) in pairwise(spans))


def test_arrows_to_different_steps_do_not_overlap() -> None:
    lanes: dict[float, list[tuple[float, float]]] = {}
    for x, y in re.findall(r"H(\d+) V([\d.]+) H", flow_chart_svg(FLOW)):
        lanes.setdefault(float(x), []).append((float(y), float(y)))
    # look ← move_there, failed ← look and converged ← compare overlap in height, so each has a lane of its own.
    assert len(lanes) == 3


def test_external_names_are_escaped_in_the_drawing() -> None:
    html = flow_chart_svg((("<b>", 'a"&', "end"),), '"><script>')
    assert "<script>" not in html
    assert "<b>" not in html
    _parse(html)


def test_an_empty_flow_draws_an_empty_chart() -> None:
    assert _lit(flow_chart_svg(())) == []
