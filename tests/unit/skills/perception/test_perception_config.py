from dlokit.skills.perception.colour import ColourConfig
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.system.configuration.toml_config import from_toml, to_toml


def test_the_settings_survive_a_file_with_either_segmentation():
    for config in (PerceptionConfig(), PerceptionConfig(segmentation=ColourConfig(least_value=3))):
        assert from_toml(to_toml(config), PerceptionConfig, "test") == config
