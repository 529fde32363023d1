"""Commands that another package adds: found by name, listed with their summary, and missing with a sentence."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from installed_packages import install

from dlokit.app.commands import ADDED, all_commands, execute
from dlokit.errors import InputError

THEIRS = '''
from dataclasses import dataclass
from dlokit.app.commands import CliCommand

@dataclass(frozen=True, kw_only=True)
class WeighArgs:
    """Weigh the rope.

    Try
      dlokit weigh
    """
    grams: int = 3

def run(args):
    print(f"{args.grams} g")
    return 0

COMMAND = CliCommand(WeighArgs, run)
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.syspath_prepend(tmp_path)
    all_commands.cache_clear()
    yield tmp_path
    all_commands.cache_clear()


def listed(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit):
        execute([*words, "--help"])
    return capsys.readouterr().out


def test_a_command_of_another_package_is_listed_and_runs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entries = {"weigh": "of_scales", "calibrate.scale": "of_scales"}
    install(folder, "scales", ADDED, entries, {"of_scales": THEIRS})
    assert "Weigh the rope." in listed(capsys)
    assert "Weigh the rope." in listed(capsys, "calibrate")
    assert execute(["weigh", "--grams", "5"]) == 0
    assert capsys.readouterr().out == "5 g\n"
    assert execute(["calibrate", "scale"]) == 0
    assert capsys.readouterr().out == "3 g\n"


def test_one_whose_module_is_missing_says_so_by_name_and_hides_no_other(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(folder, "half", ADDED, {"weigh": "of_scales_gone.deep"}, {})
    assert "(missing: of_scales_gone.deep)" in listed(capsys)
    with pytest.raises(InputError, match=r"`dlokit weigh` needs of_scales_gone\.deep, which is missing"):
        execute(["weigh"])


def test_a_fault_within_a_command_is_not_taken_for_a_missing_one(folder: Path) -> None:
    install(folder, "lame", ADDED, {"limp": "of_lame"}, {"of_lame": "import of_lame_needs_this"})
    with pytest.raises(ModuleNotFoundError, match="of_lame_needs_this"):
        execute(["limp"])


def test_a_name_that_is_taken_is_skipped_with_a_warning(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    install(folder, "thief", ADDED, {"stop": "of_thief"}, {"of_thief": THEIRS})
    assert all_commands()["stop"] == "dlokit.app.operate.stop"
    assert "'stop' of of_thief" in caplog.text


def test_a_group_of_one_command_is_listed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    install(folder, "lab", ADDED, {"lab.weigh": "of_lab_scales"}, {"of_lab_scales": THEIRS})
    assert "Weigh the rope." in listed(capsys, "lab")
    with pytest.raises(SystemExit):
        execute(["lab"])
    assert "Weigh the rope." in capsys.readouterr().out
    assert execute(["lab", "weigh"]) == 0


def test_a_module_without_a_command_says_so(folder: Path) -> None:
    install(folder, "empty", ADDED, {"nothing": "of_nothing"}, {"of_nothing": ""})
    with pytest.raises(InputError, match="`dlokit nothing` needs of_nothing, which has no COMMAND"):
        execute(["nothing"])
