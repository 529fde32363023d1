"""Requirements on every segmentation that ships with dlokit; a new one is a row in `segmentations.OURS`."""

import pytest

from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.segmentations import OURS
from dlokit.testing import check_segmentation


@pytest.mark.parametrize("config", OURS, ids=lambda config: config.name)
def test_it_keeps_to_its_protocol(config: type[SegmentationConfig]) -> None:
    assert check_segmentation(config).overlap > 0.8
