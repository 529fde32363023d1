"""What all tests against simulators of a device print."""

import os
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def load_printed(capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest) -> Iterator[None]:
    """What a figure means depends on the machine's load."""
    before = os.getloadavg()[0]
    yield
    with capsys.disabled():
        print(f"\n{request.node.name}: load {before:.1f} to {os.getloadavg()[0]:.1f}")
