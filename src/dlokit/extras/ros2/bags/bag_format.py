"""Bags of ROS 2 (rosbag2: sqlite3 or MCAP) and of ROS 1 (.bag) as recorded pictures, by `rosbags`, without ROS."""

from pathlib import Path

from dlokit.errors import ConfigError
from dlokit.functional.cameras.recorded import PictureSeries, RecordedCameraConfig

_MAGIC = b"\x89MCAP0\r\n"
_STORAGES = (".mcap", ".db3")


class Rosbag2:
    """Bags: a folder with metadata.yaml, or one of its files (.mcap, .db3); or a .bag of ROS 1, as it is published."""

    def reads(self, path: Path) -> bool:
        """Whether a path looks like a bag of ROS; `opened` finds out whether it is one."""
        if path.is_dir():
            return (path / "metadata.yaml").exists() or bool(_files(path))
        return path.is_file() and (path.suffix in (".db3", ".bag", ".zstd") or _is_ros_mcap(path))

    def opened(self, path: Path, settings: RecordedCameraConfig) -> PictureSeries:
        """The pictures of a bag. Raises `ConfigError` when there are none that can be used."""
        from dlokit.extras.ros2.bags.bag_pictures import BagPictures  # needs libraries that other recordings do not

        return BagPictures(_storage(path), settings)


ROSBAG2 = Rosbag2()


def _storage(path: Path) -> Path:
    """The folder or file that rosbags reads. Raises `ConfigError` for what it does not."""
    if path.suffix == ".zstd":
        raise ConfigError(f"{path} is a compressed file of a bag; give its folder, which has metadata.yaml")
    if path.is_dir() and not (path / "metadata.yaml").exists():
        files = _files(path)
        if len(files) > 1:
            raise ConfigError(
                f"{path} has {len(files)} files of a bag and no metadata.yaml, as after a killed recorder; `ros2 bag "
                "reindex` writes it, or give one of the files"
            )
        return files[0]
    return path


def _files(folder: Path) -> list[Path]:
    found = (path for path in folder.iterdir() if path.suffix in _STORAGES)
    return sorted(path for path in found if path.suffix == ".db3" or _is_ros_mcap(path))


def _is_ros_mcap(path: Path) -> bool:
    """Whether a file is an MCAP file of profile ros2, and not the recording of a run."""
    with path.open("rb") as file:
        head = file.read(32)
    return head.startswith(_MAGIC) and head[21:25] == b"ros2"
