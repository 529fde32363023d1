"""The grid of transports, for every test in this folder that asks for `on_bus`."""

import pytest
from transport_grid import Grid, in_memory, over_zenoh


@pytest.fixture(
    params=[pytest.param(in_memory, id="memory"), pytest.param(over_zenoh, id="zenoh", marks=pytest.mark.live)]
)
def on_bus(request: pytest.FixtureRequest) -> Grid:
    return request.param
