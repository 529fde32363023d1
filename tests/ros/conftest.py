"""What the tests with real ROS 2 share: environments from the package index, and networks of their own."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from ros_lab import DISTRIBUTIONS, RosEnvironment, RosNetwork, ros_network, why_no_namespace, why_silent


@pytest.fixture(scope="session")
def silent() -> dict[str, str]:
    """Why nodes on the loopback do not find each other, by distribution; empty where they do."""
    return {}


@pytest.fixture(params=DISTRIBUTIONS)
def ros_environment(request: pytest.FixtureRequest) -> RosEnvironment:
    """The environment of each distribution; skipped where it is not installed."""
    environment = RosEnvironment(request.param)
    if why_not := environment.why_not():
        pytest.skip(why_not)
    return environment


@pytest.fixture
def tf(ros_environment: RosEnvironment) -> None:
    """Skips where the environment has no tf2_msgs, which is generated for `make test-ros` alone."""
    if why_not := ros_environment.why_not("tf2_msgs"):
        pytest.skip(why_not)


@pytest.fixture
def lab(
    ros_environment: RosEnvironment, silent: dict[str, str], tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[RosNetwork]:
    """A network of the environment's distribution; skipped where none is possible.

    Where this machine gives no network of its own, nodes share its loopback, in a domain of their own.
    """
    namespace = not why_no_namespace()
    if not namespace:
        name = ros_environment.distribution
        if name not in silent:
            silent[name] = why_silent(ros_environment, tmp_path_factory.mktemp("try"), namespace=False)
        if silent[name]:
            pytest.skip(f"no namespace ({why_no_namespace()}), and on the loopback {silent[name]}")
    folder = tmp_path / "lab"
    folder.mkdir()
    with ros_network(ros_environment, folder, namespace=namespace) as network:
        yield network
