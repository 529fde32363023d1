"""The Python code of the project's pages, and how it is run."""

import re
import subprocess
import textwrap
from pathlib import Path

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^ *```python\n(.*?)^ *```", re.DOTALL | re.MULTILINE)


def blocks(page: str) -> list[str]:
    """The blocks of Python code on a page, named by its path in the repository."""
    return [textwrap.dedent(block) for block in BLOCK.findall((ROOT / page).read_text(encoding="utf-8"))]


def completed(script: str, page: str) -> str:
    """A script with each block of a page at its number, as in `{0}` or `{0:indented}`."""
    for number, block in enumerate(blocks(page)):
        assert f"{{{number}" in script, "the page has a block that its script does not have"
        script = script.replace(f"{{{number}}}", block).replace(
            f"{{{number}:indented}}", textwrap.indent(block, "    ")
        )
    return script


def run_script(python: str, script: str, folder: Path) -> str:
    """Run a script in a folder; returns what it printed."""
    (folder / "script.py").write_text(script, encoding="utf-8")
    done = subprocess.run([python, "script.py"], cwd=folder, capture_output=True, text=True, timeout=1200, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
