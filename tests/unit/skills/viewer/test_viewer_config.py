import pytest

from dlokit.errors import ConfigError
from dlokit.skills.viewer.config import ViewerConfig


def test_a_port_that_does_not_exist_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"port is 70000.*0 to 65535"):
        ViewerConfig(port=70000)
