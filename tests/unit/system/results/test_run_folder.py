import subprocess
import sys
from datetime import datetime
from pathlib import Path

import pytest

from dlokit.errors import InputError
from dlokit.system.results.run_folder import CLAIM, claim_run_folder, new_run_folder, release_claim

STARTED = datetime(2026, 3, 1, 14, 5, 9)


def test_a_folder_is_named_after_time_and_run(tmp_path: Path) -> None:
    folder = new_run_folder(tmp_path / "runs", "I to S", STARTED)

    assert folder == tmp_path / "runs" / "20260301-140509-I-to-S"
    assert folder.is_dir()


def test_runs_of_the_same_second_get_folders_of_their_own(tmp_path: Path) -> None:
    folders = [new_run_folder(tmp_path, "shape", STARTED) for _ in range(3)]

    assert [folder.name for folder in folders] == [f"20260301-140509-shape{end}" for end in ("", "-2", "-3")]


def test_a_name_cannot_leave_the_folder(tmp_path: Path) -> None:
    folder = new_run_folder(tmp_path, "../../goals/my goal.npy:3", STARTED)

    assert folder.parent == tmp_path
    assert folder.name == "20260301-140509-goals-my-goal.npy-3"
    assert new_run_folder(tmp_path, "..", STARTED).name.endswith("-run")


def test_the_users_folder_is_taken_when_new_or_empty(tmp_path: Path) -> None:
    assert claim_run_folder(tmp_path / "a" / "b").is_dir()
    assert claim_run_folder(tmp_path / "a" / "b").is_dir()  # of a command that ended before it wrote anything


@pytest.mark.live
def test_of_two_runs_one_gets_an_empty_folder(tmp_path: Path) -> None:
    claims = "import sys; from dlokit.system.results.run_folder import claim_run_folder; from pathlib import Path; "
    claims += f"claim_run_folder(Path({str(tmp_path)!r})); print('claimed', flush=True); sys.stdin.read()"
    with subprocess.Popen((sys.executable, "-c", claims), stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"claimed\n"
        with pytest.raises(InputError, match="claimed by another run"):
            claim_run_folder(tmp_path)
        release_claim(tmp_path)  # of a folder that is not ours
        assert (tmp_path / CLAIM).exists()
    assert claim_run_folder(tmp_path).is_dir()  # the other one has ended without a file


def test_the_users_folder_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text("{}")

    with pytest.raises(InputError, match=r"not empty.*result\.json"):
        claim_run_folder(tmp_path)


def test_a_file_is_refused_as_a_folder(tmp_path: Path) -> None:
    path = tmp_path / "runs"
    path.write_text("")

    with pytest.raises(InputError, match="is a file"):
        claim_run_folder(path)
    with pytest.raises(InputError, match=r"Cannot create|is a file"):
        new_run_folder(path, "shape", STARTED)


def test_a_name_too_long_for_a_file_system_is_cut(tmp_path: Path) -> None:
    assert new_run_folder(tmp_path, "deep/" * 200, STARTED).is_dir()
