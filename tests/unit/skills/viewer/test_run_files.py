from pathlib import Path

import pytest

from dlokit.skills.viewer.serving.address import RunFiles


@pytest.fixture
def files(tmp_path: Path) -> RunFiles:
    folder = tmp_path / "run"
    (folder / "task-2").mkdir(parents=True)
    (folder / "report.html").write_bytes(b"<p>all</p>")
    (folder / "task-2" / "goal.csv").write_bytes(b"x,y,z\n")
    (folder / "start.npy").write_bytes(b"hidden")
    (folder / "truth.npz").write_bytes(b"hidden")
    (tmp_path / "report.html").write_bytes(b"another run's")
    (folder / "result.json").symlink_to(folder / "start.npy")
    (folder / "task-3").symlink_to(tmp_path)
    return RunFiles(folder)


def test_reports_and_goals_of_the_run_and_its_tasks_are_served(files: RunFiles) -> None:
    assert files.read("report.html") == (b"<p>all</p>", "text/html; charset=utf-8")
    assert files.read("task-2/goal.csv") == (b"x,y,z\n", "text/csv; charset=utf-8")


@pytest.mark.parametrize(
    "name",
    [
        "start.npy",
        "truth.npz",
        "../report.html",
        "task-2/../start.npy",
        "task-2/report.html",
        "/etc/passwd",
        "task-2",
        "",
        "report.html\n",
        "result.json",
        "task-3/report.html",
    ],
)
def test_nothing_else_is_served(files: RunFiles, name: str) -> None:
    assert files.read(name) is None
