"""The report, the viewer's page and the documentation load nothing from another host: they work without a network."""

from pathlib import Path

import pytest
import viser
import yaml
from loaded_elsewhere import loaded_elsewhere

import dlokit

ROOT = Path(__file__).parents[2]
SOURCES = Path(dlokit.__file__).parent
# Of the pages that dlokit makes, each part is written in one of these; the rest of the viewer's page is viser's.
PAGES = [
    *(path for part in ("app/report", "skills/viewer") for path in sorted((SOURCES / part).rglob("*.*"))),
    *(path for kind in ("*.md", "*.js", "*.css", "*.html") for path in sorted((ROOT / "docs").rglob(kind))),
    *(ROOT / name for name in ("README.md", "ARCHITECTURE.md", "CHANGELOG.md")),
    *sorted((Path(viser.__file__).parent / "client" / "build").rglob("*.html")),
]


@pytest.mark.parametrize(
    "text",
    [
        '<script defer src="https://host/x">',
        "<script\n  src=//host/x></script>",
        "<link rel=stylesheet href='http://host/x'>",
        '<img alt="a" srcset="https://host/x 2x">',
        '<svg><image xlink:href="https://host/x"/></svg>',
        '<iframe src="https://host/x">',
        '@import "https://host/x";',
        "@import url(//host/x);",
        "body { background: url('https://host/x') }",
        'const library = await import("https://host/x")',
        "![a chart](https://host/x)",
    ],
)
def test_what_is_loaded_from_another_host_is_found(text: str) -> None:
    assert [url.partition("//")[2] for url in loaded_elsewhere(text)] == ["host/x"]


@pytest.mark.parametrize(
    "text",
    [
        '<a href="https://host/x">',
        '<a href="https://host/x">read</a><img src="data:image/png;base64,//8=">',
        '<svg xmlns="http://www.w3.org/2000/svg"><use href="#mark"/></svg>',
        '<link rel="canonical" href="https://host/x">',
        "[read](https://host/x)",
        "@import 'fonts.css'; b { mask: url(data:image/svg+xml;base64,//8=) }",
    ],
)
def test_what_a_reader_follows_or_the_page_has_is_not(text: str) -> None:
    assert loaded_elsewhere(text) == []


def test_no_page_loads_anything_from_another_host() -> None:
    kinds = {path.suffix for path in PAGES}
    assert {".css", ".html", ".js", ".md", ".py"} <= kinds
    texts = {path: path.read_text(encoding="utf-8") for path in PAGES if path.suffix != ".pyc"}
    assert {path: found for path, text in texts.items() if (found := loaded_elsewhere(text))} == {}


def test_the_documentation_takes_its_theme_from_this_host() -> None:
    site = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"), yaml.BaseLoader)
    assert site["theme"]["font"] == "false"  # Material would take its fonts from another host,
    scripts = [script["path"] for script in site["extra_javascript"]]
    assert "javascripts/mermaid.tiny.js" in scripts  # and, without one that draws the charts, its script
    assert site["extra"]["polyfills"] == ["javascripts/iframe-worker.js"]  # as its offline search its worker
    scripts += site["extra"]["polyfills"]
    assert [path for path in [*scripts, *site.get("extra_css", [])] if not (ROOT / "docs" / path).is_file()] == []
