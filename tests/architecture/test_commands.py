"""The table of commands, and the entry points of those that annexes add, are correct."""

import inspect
from pathlib import Path

import pytest

import dlokit
from dlokit.app.commands import all_commands, groups, load, summary_of

OURS = [name for name, module in all_commands().items() if module.startswith("dlokit.")]


@pytest.mark.parametrize("name", OURS)
def test_the_list_has_each_commands_own_summary(name: str) -> None:
    help_page = inspect.getdoc(load(name).arguments)
    assert help_page is not None
    assert help_page.split("\n\n")[0].replace("\n", " ") == summary_of(name)


def test_every_module_with_a_command_is_in_the_table_or_an_entry_point() -> None:
    (folder,) = dlokit.__path__
    modules = (path for path in Path(folder).rglob("*.py") if "\nCOMMAND = " in path.read_text(encoding="utf-8"))
    holding = {".".join(("dlokit", *path.relative_to(folder).with_suffix("").parts)) for path in modules}
    assert holding == {all_commands()[name] for name in OURS}


def test_a_command_of_two_words_begins_with_a_group_or_with_the_command_that_it_goes_on() -> None:
    assert {name.split()[0] for name in OURS if " " in name} == {"bench", "calibrate", "doctor"}
    assert set(groups()) == {"bench", "calibrate"}
    assert all(groups().values())
