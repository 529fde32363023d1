"""The page of the Python API lists every field of an action."""

from pathlib import Path

from dlokit.system.results.run_result import ActionResult

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "python-api.md"


def test_every_field_of_an_action_is_on_the_page_of_the_python_api() -> None:
    page = PAGE.read_text()
    assert [name for name in ActionResult.__struct_fields__ if f"`{name}`" not in page] == []
