"""The topics of a camera in ROS 2: of a running one, or of one in a bag."""

from dataclasses import dataclass

from dlokit.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class PictureTopics:
    """Topics of a camera in ROS 2: colour with depth, colour with right, or cloud.

    A camera's calibration is on the topic `camera_info` beside its pictures.
    """

    colour: str = ""
    """Topic of the colour pictures, or of the left ones of a stereo pair."""
    depth: str = ""
    """Topic of the depths, aligned to colour, in millimetres (16UC1) or metres (32FC1)."""
    right: str = ""
    """Topic of the right pictures of a stereo pair."""
    cloud: str = ""
    """Topic of the point cloud (PointCloud2) with colours."""
    calibration: str = ""
    """File with the camera's pose T_world_camera, as calibration.toml of recorded pictures. Without it, the pose is
    that of the camera's frame in TF."""

    @property
    def named(self) -> dict[str, str]:
        """The topics that are set, by setting."""
        every = {"colour": self.colour, "depth": self.depth, "right": self.right, "cloud": self.cloud}
        return {setting: topic for setting, topic in every.items() if topic}

    def check_topics(self) -> None:
        """Raise `ConfigError` when the topics do not make a camera."""
        if set(self.named) not in ({"colour", "depth"}, {"colour", "right"}, {"cloud"}):
            found = " and ".join(f"--camera.{setting}" for setting in self.named) or "none"
            raise ConfigError(
                f"the topics of the camera are {found}; name --camera.colour and --camera.depth (aligned to colour), "
                "--camera.colour and --camera.right (a stereo pair), or --camera.cloud. `dlokit doctor ros2` lists "
                "what is published."
            )
