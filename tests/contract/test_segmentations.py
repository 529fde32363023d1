"""Requirements on every segmentation that ships with dlokit; a new one is a row in `segmentations.OURS`."""

import re

import pytest

from dlokit.extras.checks.command import SegmentationCheckArgs, run
from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.config import OURS


@pytest.mark.parametrize("config", OURS, ids=lambda config: config.name)
def test_it_keeps_to_its_protocol(config: type[SegmentationConfig], capsys: pytest.CaptureFixture[str]) -> None:
    code = run(SegmentationCheckArgs(segmentation=config.name))
    said = capsys.readouterr().out
    assert code == 0, said
    assert f"{config.name}: 12 checks passed" in said
    found = re.search(r"finds (\d+)% of the rope", said)
    assert found is not None
    assert int(found[1]) > 80
