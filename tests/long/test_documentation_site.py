"""The documentation as a site: built without warnings, and its search finds what people ask."""

import functools
import os
import subprocess
import sys
import threading
from collections.abc import Generator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import quote

import pytest
from loaded_elsewhere import loaded_elsewhere

ROOT = Path(__file__).parents[2]

CHROMIUM = Path("/usr/bin/chromium")

QUESTIONS = {
    "stop the robot": "explanations/what-stops-the-robot.html",
    "add planner": "how-to/add-a-planner.html",
    "own point clouds": "tutorials/python.html",
    "notebook event loop": "reference/python-api.html",
    "export lerobot": "how-to/record-and-replay.html",
    "certificates several machines": "how-to/several-machines.html",
    "wire plastic": "how-to/shape-a-wire.html",
    "report benchmark seeds": "how-to/benchmark-your-method.html",
    "infeasible goal verdict": "reference/goal-verdict.html",
    "what is a lease": "reference/glossary.html",
}
"""What people ask, and the page that answers it; it must be among the first three results."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built; a warning fails the build."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    return folder


def test_the_site_has_every_page_and_the_signatures(site: Path) -> None:
    pages = [path for path in (ROOT / "docs").rglob("*.md") if path.name != "README.md"]
    places = [path.relative_to(ROOT / "docs").with_suffix("") for path in pages]
    assert [place for place in places if not (site / place).with_suffix(".html").is_file()] == []
    text = (site / "reference" / "api.html").read_text(encoding="utf-8")
    assert 'id="dlokit.shape"' in text
    assert "Bring the DLO of the simulated cell from a start to a goal" in text


@pytest.fixture
def address(site: Path) -> Generator[str]:
    """The site, served."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(site)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    thread.join()
    server.server_close()


def test_no_page_loads_anything_from_another_host(site: Path) -> None:
    files = [path for kind in ("*.html", "*.css", "*.js") for path in site.rglob(kind)]
    assert [path for path in files if loaded_elsewhere(path.read_text(encoding="utf-8"))] == []


@pytest.mark.browser
@pytest.mark.skipif(not CHROMIUM.exists(), reason=f"{CHROMIUM} is missing; on Debian: apt install chromium")
def test_charts_links_and_search_work_from_a_folder_without_a_network(site: Path) -> None:
    from playwright.sync_api import sync_playwright

    pages = [page for page in site.rglob("*.html") if 'class="mermaid"' in page.read_text(encoding="utf-8")]
    assert pages
    asked: list[str] = []
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        offline = browser.new_context(offline=True)
        for place in pages:
            page = offline.new_page()
            page.on("request", lambda request: asked.append(request.url))
            charts = place.read_text(encoding="utf-8").count('class="mermaid"')
            page.goto(place.as_uri())
            # Material puts each chart, drawn, into a shadow of its own in place of the text.
            page.wait_for_function(f"document.querySelectorAll('div.mermaid').length == {charts}", timeout=120_000)
            assert page.locator("pre.mermaid").count() == 0
        page = offline.new_page()
        page.goto(f"{(site / 'index.html').as_uri()}?q=lease")
        page.locator("a.md-search-result__link").first.wait_for(timeout=120_000, state="attached")
        links = page.locator("nav.md-nav--primary a.md-nav__link").all()
        targets = {(link.get_attribute("href") or "").partition("#")[0] for link in links} - {""}
        browser.close()
    assert [url for url in asked if not url.startswith((site.as_uri(), "blob:", "data:"))] == []
    assert len(targets) > 50
    assert [target for target in targets if not (site / target).is_file()] == []


@pytest.mark.browser
@pytest.mark.skipif(not CHROMIUM.exists(), reason=f"{CHROMIUM} is missing; on Debian: apt install chromium")
def test_the_search_answers_questions(address: str) -> None:
    from playwright.sync_api import sync_playwright

    found: dict[str, list[str]] = {}
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        page = browser.new_page()
        for question in QUESTIONS:
            # In the address, since the page may not listen yet to what is typed.
            page.goto(f"{address}?q={quote(question)}")
            page.locator("a.md-search-result__link").first.wait_for(timeout=120_000, state="attached")
            links = page.locator("li.md-search-result__item > a.md-search-result__link").all()
            found[question] = [(link.get_attribute("href") or "").partition("?")[0].partition("#")[0] for link in links]
        browser.close()
    wrong = {
        question: found[question][:3]
        for question, wanted in QUESTIONS.items()
        if not any(link.endswith(wanted) for link in found[question][:3])
    }
    assert wrong == {}
