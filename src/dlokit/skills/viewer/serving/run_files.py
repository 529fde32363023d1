"""The files of a run that the page serves: reports, results and goals of its tasks, and nothing else."""

import re
from collections.abc import Mapping
from pathlib import Path

PREFIX = "files/"
"""Where the files are, below the key in the page's address."""
KINDS: Mapping[str, str] = {
    "report.html": "text/html; charset=utf-8",
    "result.json": "application/json",
    "goal.csv": "text/csv; charset=utf-8",
    "nearest_goal.csv": "text/csv; charset=utf-8",
    "config.toml": "text/plain; charset=utf-8",
}
"""Names of the files → their content types."""
_ALLOWED = re.compile(rf"(task-\d{{1,6}}/)?({'|'.join(map(re.escape, KINDS))})")
# A report shows texts of a configuration that others may have written: it may style itself, and do nothing else.
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class RunFiles:
    """Reads the files of one run's folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, name: str) -> tuple[bytes, str] | None:
        """Content and content type of a file by its path in the folder; None where there is none that may be served."""
        if not _ALLOWED.fullmatch(name):
            return None
        path = self._folder / name
        try:
            # A link could lead out of the folder.
            if path.is_symlink() or path.parent.is_symlink():
                return None
            return path.read_bytes(), KINDS[path.name]
        except OSError:
            return None
