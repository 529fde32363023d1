"""Files of a folder come in the order of their numbers."""

from pathlib import Path

import pytest

from dlokit.recording.channels import in_order
from dlokit.recording.reader import files_of


@pytest.mark.parametrize(
    "names",
    [
        ("colour_1.png", "colour_2.png", "colour_10.png"),
        ("colour_0001.png", "colour_0002.png", "colour_0010.png"),
        ("a1.png", "a2.png", "b1.png", "b1c2.png"),
        ("01.png", "1.png", "1x.png"),
    ],
)
def test_names_are_ordered_by_the_numbers_in_them(names: tuple[str, ...]):
    assert in_order(Path(name) for name in reversed(names)) == [Path(name) for name in names]


def test_the_thousandth_file_of_a_recording_is_the_last_one(tmp_path: Path):
    for name in ("recording.mcap", "recording.001.mcap", "recording.101.mcap", "recording.1000.mcap"):
        (tmp_path / name).touch()
    assert [path.name for path in files_of(tmp_path / "recording.mcap")][-2:] == [
        "recording.101.mcap",
        "recording.1000.mcap",
    ]
