"""Pictures of a run at any time."""

from pathlib import Path

import numpy as np
import pytest

from dlokit.errors import InputError
from dlokit.extras.export.pictures import RecordedPictures, Shot, pictures_of, resized
from dlokit.recording.reader import RawRecording, picture_file
from dlokit.recording.views import from_jpeg

REFERENCES = Path(__file__).parents[3] / "replay" / "references"
RUN, WITHOUT = REFERENCES / "farthest.mcap", REFERENCES / "wire.mcap"
TAKEN = [
    (record.log_time, record.publish_time, record.data)
    for name, record in RawRecording(path=RUN)
    if name == "view/left"
]


def test_without_a_truth_the_pictures_are_the_recorded_ones_and_their_rate_is_told() -> None:
    with pictures_of(RUN) as pictures:
        (first_ns, stamp_ns, data), (second_ns, _, _) = TAKEN
        assert pictures.first_ns == first_ns
        assert pictures.origin.startswith(f"2 recorded ones, {1e9 / (second_ns - first_ns):.2g} per second")
        shot = pictures.at(second_ns - 1)
        np.testing.assert_array_equal(shot.views["left"], from_jpeg(picture_file(data).data))
        assert shot.age_s == pytest.approx((second_ns - 1 - stamp_ns) / 1e9)
        assert set(shot.views) == {"left", "right"}
        assert not np.array_equal(pictures.at(second_ns).views["left"], shot.views["left"])


def test_a_recording_without_pictures_is_refused_with_a_remedy() -> None:
    with pytest.raises(
        InputError, match=r"contains no view/left, view/right, .* cannot be rendered: so\. .*--no-images"
    ):
        RecordedPictures(WITHOUT, "so")


def test_resized_pictures_are_even_and_keep_their_proportions() -> None:
    shot = Shot(
        views={"colour": np.full((31, 41, 3), 7, dtype=np.uint8)},
        depth_m=np.full((31, 41), 0.5, dtype=np.float32),
        age_s=0.2,
    )
    own, small = resized(shot, None), resized(shot, 20)
    assert own.views["colour"].shape == (32, 40, 3)
    assert small.views["colour"].shape == (16, 20, 3)
    assert small.depth_m is not None
    assert small.depth_m.shape == (16, 20)
    assert np.all(small.views["colour"] == 7)
    assert np.all(small.depth_m == np.float32(0.5))
    assert small.age_s == 0.2
