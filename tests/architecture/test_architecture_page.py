"""The charts of ARCHITECTURE.md are those of the tables that run the system."""

from pathlib import Path

import pytest

from dlokit.app.operate.graph import DRAWINGS, GraphArgs, run, with_charts
from dlokit.errors import InputError

PAGE = Path(__file__).parents[2] / "ARCHITECTURE.md"
STALE = "ARCHITECTURE.md shows charts that are no longer the system's; renew them: dlokit graph --write ARCHITECTURE.md"


def test_the_page_has_the_current_chart_of_every_table() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for name in DRAWINGS:
        assert f"<!-- dlokit graph {name} -->" in page
    assert with_charts(page) == page, STALE


def test_the_page_fits_a_page_without_its_charts() -> None:
    words = 0
    drawing = False
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        drawing = line.startswith("<!-- dlokit graph") or (drawing and not line.startswith("<!-- end"))
        words += 0 if drawing else len(line.split())
    assert words < 1000  # about two columns of print


def test_a_stale_chart_is_renewed_and_the_text_around_it_stays(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- dlokit graph flow -->\nstale\n<!-- end -->\nafter\n", encoding="utf-8")
    assert run(GraphArgs(write=page)) == 0
    written = page.read_text(encoding="utf-8")
    assert written.startswith("before\n<!-- dlokit graph flow -->\n```mermaid\nflowchart TD\n")
    assert written.endswith("```\n<!-- end -->\nafter\n")
    assert "stale" not in written
    assert with_charts(written) == written


def test_a_page_without_marks_or_with_marks_for_an_unknown_chart_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="dlokit graph flow"):
        with_charts("nothing here")
    with pytest.raises(InputError, match="weather"):
        with_charts("<!-- dlokit graph weather -->\n<!-- end -->\n")
    with pytest.raises(InputError, match=r"gone\.md"):
        run(GraphArgs(write=tmp_path / "gone.md"))
