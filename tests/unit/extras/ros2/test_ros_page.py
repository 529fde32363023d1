"""The page about ROS 2 has the table of the topics that dlokit publishes."""

import re
from pathlib import Path

from dlokit.extras.ros2.published.outgoing import PUBLISHED, absolute

PAGE = Path(__file__).parents[4] / "docs" / "how-to" / "use-from-ros2.md"
PLACE = re.compile(r"<!-- ros2 topics -->\n(.*?)<!-- end -->", re.DOTALL)


def table() -> str:
    """The rows of the published topics in Markdown."""
    lines = ["| topic | type | content | late subscribers |", "|---|---|---|---|"]
    for row in PUBLISHED:
        late = "get the last message" if row.transient_local else ""
        late = "made only while it has subscribers" if row.on_demand else late
        lines.append(f"| `{absolute(row.topic)}` | {row.kind.replace('/msg/', '/')} | {row.doc} | {late} |")
    return "\n".join([*lines, ""])


def test_the_page_has_the_table_of_the_published_topics() -> None:
    (found,) = PLACE.findall(PAGE.read_text(encoding="utf-8"))
    assert found == table(), f"write into the page:\n{table()}"
