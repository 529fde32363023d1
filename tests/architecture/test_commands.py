"""The table of commands is correct."""

import inspect
from importlib import import_module
from pathlib import Path

import pytest

from dlokit import app
from dlokit.app.commands import COMMANDS, GROUPS, CliCommand, summary_of


def command_of(name: str) -> CliCommand[object]:
    return import_module(f"dlokit.app.{COMMANDS[name]}").COMMAND


@pytest.mark.parametrize("name", COMMANDS)
def test_the_list_has_each_commands_own_summary(name: str) -> None:
    help_page = inspect.getdoc(command_of(name).arguments)
    assert help_page is not None
    assert help_page.split("\n\n")[0].replace("\n", " ") == summary_of(name)


def test_every_module_with_a_command_is_in_the_table() -> None:
    (folder,) = app.__path__
    modules = (path for path in Path(folder).rglob("*.py") if "\nCOMMAND = " in path.read_text(encoding="utf-8"))
    holding = {".".join(path.relative_to(folder).with_suffix("").parts) for path in modules}
    assert holding == set(COMMANDS.values())


def test_a_command_of_two_words_begins_with_a_group_or_with_the_command_that_it_goes_on() -> None:
    assert {name.split()[0] for name in COMMANDS if " " in name} == {*GROUPS, "doctor"}
    assert not set(GROUPS) & set(COMMANDS)
