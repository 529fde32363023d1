import numpy as np
import pytest

from dlokit.types.fixtures import FixtureFinding, FixtureSight


@pytest.mark.parametrize(
    ("sight", "text"),
    [
        (FixtureSight.AS_BELIEVED, "A stands where it is believed to be"),
        (FixtureSight.MOVED, "A stands 15 mm (x +9, y -12) off its place"),
        (FixtureSight.OTHER_SIZE, "A has another size: it looks +4 mm wider and -10 mm higher"),
        (FixtureSight.MISSING, "A is missing at (0.512, -0.034) m"),
        (FixtureSight.NOT_SEEN, "A is not seen"),
    ],
)
def test_a_finding_names_the_fixture_and_what_is_wrong_with_it(sight: FixtureSight, text: str):
    finding = FixtureFinding(
        name="A",
        sight=sight,
        place_world=np.array([0.512, -0.034]),
        offset_m=np.array([0.009, -0.012]),
        larger_m=np.array([0.004, -0.010]),
    )
    assert finding.text == text


def test_an_unknown_thing_is_named_by_its_place_and_size():
    thing = FixtureFinding(
        name="",
        sight=FixtureSight.UNKNOWN,
        place_world=np.array([0.5, 0.1]),
        offset_m=np.zeros(2),
        larger_m=np.array([0.012, 0.031]),
    )
    assert thing.text == "an unknown thing, 12 mm wide and 31 mm high, is at (0.500, 0.100) m"
