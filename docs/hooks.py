"""Hooks of the documentation site: pages from the repository's root, and links to files that are not on the site."""

import re
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT_PAGES = {"ARCHITECTURE.md": "architecture.md", "CHANGELOG.md": "changelog.md"}
"""Pages that stand in the root of the repository, and their places on the site."""

SEARCH_BOOST = {
    "tutorials/": 2.0,
    "how-to/": 1.5,
    "reference/glossary.md": 4.0,
    "reference/goal-verdict.md": 3.0,
    "decisions/": 0.3,
    "changelog.md": 0.3,
}
"""Rank of pages in the search: people ask how to do something, and seldom why it was decided."""

_LINK = re.compile(r"(?<!!)\[(?P<text>[^\]]*)\]\((?P<target>[^)#\s]*)(?P<anchor>#[^)]*)?\)")
_FENCE = re.compile(r"(```.*?```)", re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the root."""
    root = Path(config.config_file_path).parent
    for name, place in ROOT_PAGES.items():
        files.append(File.generated(config, place, content=(root / name).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links point to the site, or, for files that are not on it, show their names; rank the page in the search."""
    source = page.file.src_uri
    for place, boost in SEARCH_BOOST.items():
        if source.startswith(place):
            page.meta["search"] = {"boost": boost}
    inverse = {place: name for name, place in ROOT_PAGES.items()}
    # Where the page stands in the repository, from which its links are relative.
    folder = PurePosixPath(inverse.get(source, f"docs/{source}")).parent

    def link(match: re.Match[str]) -> str:
        text, target, anchor = match["text"], match["target"], match["anchor"] or ""
        if not target or "://" in target or target.startswith("mailto:"):
            return match[0]
        path = normpath((folder / target).as_posix())
        place = ROOT_PAGES.get(path, path.removeprefix("docs/") if path.startswith("docs/") else None)
        if place is not None and f"{place}/README.md" in files.src_uris:
            place = f"{place}/README.md"
        if place is not None and place in files.src_uris:
            return f"[{text}]({relpath(place, PurePosixPath(source).parent.as_posix())}{anchor})"
        if config.repo_url:
            return f"[{text}]({config.repo_url.rstrip('/')}/blob/main/{path}{anchor})"
        return text if text.strip("`") == path else f"{text} (`{path}`)"

    return "".join(part if part.startswith("```") else _LINK.sub(link, part) for part in _FENCE.split(markdown))
