import pytest

from dlokit.errors import ConfigError
from dlokit.skills.viewer.config import ViewerConfig


def test_a_port_that_does_not_exist_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"--port is 70000.*0 .* 65535"):
        ViewerConfig(port=70000)


def test_rates_and_sizes_must_be_positive() -> None:
    with pytest.raises(ConfigError, match="draw-rate-hz"):
        ViewerConfig(draw_rate_hz=0.0)
    with pytest.raises(ConfigError, match="picture-width-px"):
        ViewerConfig(picture_width_px=0)


def test_a_goal_area_must_run_from_low_to_high() -> None:
    with pytest.raises(ConfigError, match="goal-y-m"):
        ViewerConfig(goal_y_m=(0.3, -0.3))
