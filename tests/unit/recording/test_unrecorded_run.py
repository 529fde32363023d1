"""A run without a recording, as the cases of a bench: the commands that read recordings say how to get one."""

from pathlib import Path

import pytest

from dlokit.app.commands import execute
from dlokit.errors import InputError


@pytest.mark.parametrize(
    "words",
    [["view"], ["info"], ["replay", "--into", "observer"], ["export", "--to", "npz"]],
    ids=lambda words: words[0],
)
def test_a_case_of_a_bench_says_how_it_is_recorded(words: list[str], tmp_path: Path) -> None:
    case = tmp_path / "I-to-S-0-rollout-map"
    case.mkdir()
    (case / "config.toml").write_text("")
    out = ["--out", str(tmp_path / "out")] if words[0] == "export" else []
    with pytest.raises(InputError) as refused:
        execute([words[0], str(case), *words[1:], *out])
    assert f"dlokit shape --record --config {case / 'config.toml'}" in str(refused.value)
    assert "the bench with --record" in str(refused.value)


def test_a_folder_without_a_run_has_nothing_to_repeat(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"give the recording\.mcap of a run's folder"):
        execute(["info", str(tmp_path)])
