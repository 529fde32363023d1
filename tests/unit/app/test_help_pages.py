"""The help of a command with many settings: a first page, and one for each group."""

import re

import pytest

from dlokit.app import help_pages
from dlokit.app.commands import parse
from dlokit.errors import ConfigError, InputError

GROUPS = ("task", "cell", "perception", "observer", "model", "planning", "robot", "gate", "viewer", "ros2")
LINE = re.compile(r"^(?:│|  ?) ?(--.*)$", re.MULTILINE)
TITLE = re.compile(r"^╭─ (.+?) ─+╮$", re.MULTILINE)


def page(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as end:
        parse(arguments)
    assert end.value.code == 0
    return capsys.readouterr().out


def options(text: str) -> set[str]:
    """All options in the boxes of a page."""
    return {option for line in LINE.findall(text) for option in re.findall(r"--[a-z][\w.-]*", line)}


def first_page(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """The names of the options on it."""
    return re.findall(r"^  --(\S+)", page(capsys, "shape", "--help"), re.MULTILINE)


def test_the_first_page_has_the_common_options_and_lists_the_other_pages(capsys: pytest.CaptureFixture[str]) -> None:
    text = page(capsys, "shape", "--help")
    for flag in ("--goal", "--planner", "--threshold-m", "--max-actions"):
        assert f"  {flag} " in text
    assert "  --speed-scale FLOAT " in text
    assert "--task.max-time-s" not in text
    more = text[text.rindex("--help GROUP") :]
    for group in GROUPS:
        assert re.search(rf"\b{group}\b", more)


def test_the_first_page_fits_two_screens(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    lines = page(capsys, "shape", "--help").splitlines()
    assert len(lines) <= 2 * 24
    assert max(len(line.rstrip()) for line in lines) <= 100


def test_the_first_page_has_every_option_without_a_group(capsys: pytest.CaptureFixture[str]) -> None:
    plain = {option for option in options(page(capsys, "shape", "--help", "all")) if not re.search(r"\.|--no-", option)}
    assert len(plain) > 20
    assert plain <= {f"--{flag.removeprefix('[no-]')}" for flag in first_page(capsys)}


def test_a_group_has_a_page_of_its_own_with_all_of_its_parts(capsys: pytest.CaptureFixture[str]) -> None:
    text = page(capsys, "shape", "--help", "planning")
    titles = TITLE.findall(text)
    assert "planning.strategy.search options" in titles
    assert all(title.startswith("planning.") for title in titles)
    assert "--planning.strategy.search.rollouts INT" in text


def test_the_settings_of_a_strategy_that_is_named_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--observer.strategy.beta-m" in page(capsys, "shape", "--observer", "cpd", "--help", "observer")


def test_all_pages_together_are_the_whole_help(capsys: pytest.CaptureFixture[str]) -> None:
    whole = options(page(capsys, "shape", "--help", "all"))
    found = {option for group in GROUPS for option in options(page(capsys, "shape", "--help", group))}
    first = {f"--{flag.removeprefix('[no-]')}" for flag in first_page(capsys)}
    assert {option for option in whole - found if "no-" not in option} <= first


@pytest.mark.parametrize("words", [["shape"], ["shape", "--observer", "cpd"], ["bench", "shaping"]])
def test_the_help_has_exactly_the_options_that_the_command_takes(
    words: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    ours = options(page(capsys, *words, "--help", "all"))
    monkeypatch.setattr(help_pages, "FEW_GROUPS", 1000)  # tyro's own help, then
    taken = options(page(capsys, *words, "--help"))
    assert len(taken) > 50
    assert ours - {"--help"} <= taken
    assert {option for option in taken - ours if "no-" not in option} <= {"--help"}


def test_the_first_page_of_the_bench_has_no_option_that_it_sets_itself(capsys: pytest.CaptureFixture[str]) -> None:
    text = page(capsys, "bench", "shaping", "--help")
    assert not {"--start", "--goal", "--headless", "--port", "--twin", "--dry-run"} & options(text)
    assert {"--planner", "--suite", "--threshold-m"} <= options(text)
    assert "[rollout, or the" in " ".join(text.split())


def test_an_unknown_page_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"no help on 'grippers'.*planning.*all"):
        parse(["shape", "--help", "grippers"])


def test_short_help_is_shown_whole(capsys: pytest.CaptureFixture[str]) -> None:
    text = page(capsys, "stop", "-h")
    assert "--run DIR" in text
    assert "GROUP" not in text


def test_other_errors_are_reported_and_not_taken_for_an_unknown_page() -> None:
    with pytest.raises(InputError, match=r"missing\.toml"):
        parse(["shape", "--config", "missing.toml", "--help", "planning"])


@pytest.mark.parametrize("flag", ["--speed-scale", "--gate.speed-scale"])
def test_the_speed_scale_has_a_short_name(flag: str) -> None:
    assert parse(["shape", flag, "0.05"]).run.gate.speed_scale == 0.05
    with pytest.raises(ConfigError, match=r"speed-scale is 0\.04"):
        parse(["shape", flag, "0.04"])
