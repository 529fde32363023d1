"""Bags in the layouts of realsense-ros and the ZED's driver are played, or refused in a sentence."""

import asyncio
import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import ros2_messages as ros
from cable_pictures import CAMERA as PICTURED
from cable_pictures import bow, picture
from ros2_messages import Sent
from rosbags.rosbag1 import Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from trials import run_plan

from dlokit.app.commands import execute
from dlokit.communication.memory import MemoryTransport
from dlokit.errors import ConfigError, InputError, NoMorePictures
from dlokit.extras.bench.observers.cases import external_cases
from dlokit.extras.bench.observers.methods import choose
from dlokit.extras.bench.observers.pictures import PictureSettings
from dlokit.extras.bench.observers.runner import BenchPlan
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.geometry import compose, inverse, matrix, pose, transform
from dlokit.geometry.camera import back_project, centred_camera
from dlokit.skills.perception.colour import ColourConfig
from dlokit.types.image import CameraPictures, DepthImage, StereoImages
from dlokit.types.pose import Pose

MS, BEGIN_NS, PERIOD_NS = 1_000_000, 1_700_000_000_000_000_000, 33_333_333
LOOKS = 4
T_WORLD_LINK = pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0))
T_LINK_OPTICAL = pose((0.0, 0.015, 0.0), (0.99, 0.01, 0.0, 0.02))
T_WORLD_CAMERA = compose(T_WORLD_LINK, T_LINK_OPTICAL)
CAMERA = centred_camera(64, 48, 60.0, T_WORLD_CAMERA)
COLOUR, ALIGNED = "/camera/camera/color/image_raw", "/camera/camera/aligned_depth_to_color/image_raw"
OPTICAL = "camera_color_optical_frame"
REALSENSE = RecordedCameraConfig(colour=COLOUR, depth=ALIGNED)
ZED = "/zed/zed_node"
ZED_DEPTH = RecordedCameraConfig(colour=f"{ZED}/rgb/color/rect/image", depth=f"{ZED}/depth/depth_registered")
ZED_CLOUD = RecordedCameraConfig(cloud=f"{ZED}/point_cloud/cloud_registered")
ZED_PAIR = RecordedCameraConfig(colour=f"{ZED}/left/color/rect/image", right=f"{ZED}/right/color/rect/image")


def stamp(number: int) -> int:
    return BEGIN_NS + number * PERIOD_NS


def rgb(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(1, 255, (48, 64, 3), dtype=np.uint8)


def depth_m(number: int) -> np.ndarray:
    return np.round(0.8 + 0.1 * np.random.default_rng(100 + number).random((48, 64)), 3).astype(np.float32)


def statics(*edges: tuple[str, str, Pose]) -> Sent:
    return Sent("/tf_static", ros.tf(*edges, stamp_ns=BEGIN_NS), BEGIN_NS)


def realsense(looks: int = LOOKS) -> list[Sent]:
    """Messages as realsense-ros publishes them, with pictures before their calibration and TF at the end."""
    sent: list[Sent] = []
    for number in range(looks):
        at_ns = stamp(number)
        depth = np.round(depth_m(number) * 1000.0).astype(np.uint16)
        sent += [
            Sent(COLOUR, ros.image(rgb(number), "rgb8", stamp_ns=at_ns, frame=OPTICAL), at_ns + 10 * MS),
            Sent("/camera/camera/color/camera_info", ros.info(CAMERA, stamp_ns=at_ns, frame=OPTICAL), at_ns + 11 * MS),
            Sent(ALIGNED, ros.image(depth, "16UC1", stamp_ns=at_ns, frame=OPTICAL), at_ns + 15 * MS),
        ]
    link = ("camera_link", OPTICAL, T_LINK_OPTICAL)
    return [*sent, statics(("base_link", "camera_link", T_WORLD_LINK), link)._replace(log_ns=stamp(looks))]


def zed() -> list[Sent]:
    """Messages as the ZED's driver publishes them: bgra8, rectified, depths in metres with NaN, an organised cloud in
    a frame with x forward."""
    optical, body = "zed_left_camera_optical_frame", "zed_left_camera_frame"
    at_origin = msgspec.structs.replace(CAMERA, T_world_camera=pose((0.0, 0.0, 0.0)))
    pixels = np.stack(np.meshgrid(np.arange(64), np.arange(48)), axis=-1).reshape(-1, 2)
    sent = [
        statics(
            ("base_link", body, compose(T_WORLD_CAMERA, pose((0.0, 0.0, 0.0), (0.5, 0.5, -0.5, 0.5)))),
            (body, optical, pose((0.0, 0.0, 0.0), (0.5, -0.5, 0.5, -0.5))),
        )
    ]
    for number in range(LOOKS):
        at_ns = stamp(number)
        bgra = np.dstack([rgb(number)[..., ::-1], np.full((48, 64), 255, dtype=np.uint8)])
        depth = depth_m(number)
        depth[0, 0] = np.nan
        points = back_project(pixels, depth.ravel(), at_origin).reshape(48, 64, 3)
        forward = np.stack([points[..., 2], -points[..., 0], -points[..., 1]], axis=-1).astype(np.float32)
        made: dict[str, Any] = {
            f"{ZED}/rgb/color/rect/image": ros.image(bgra, "bgra8", stamp_ns=at_ns, frame=optical),
            f"{ZED}/rgb/color/rect/camera_info": ros.info(CAMERA, stamp_ns=at_ns, frame=optical),
            f"{ZED}/left/color/rect/image": ros.image(bgra, "bgra8", stamp_ns=at_ns, frame=optical),
            f"{ZED}/left/color/rect/camera_info": ros.info(CAMERA, stamp_ns=at_ns, frame=optical),
            f"{ZED}/right/color/rect/image": ros.image(bgra[:, ::-1], "bgra8", stamp_ns=at_ns, frame="zed_right"),
            f"{ZED}/right/color/rect/camera_info": ros.info(CAMERA, stamp_ns=at_ns, frame="zed_right", shift_m=0.12),
            f"{ZED}/depth/depth_registered": ros.image(depth, "32FC1", stamp_ns=at_ns, frame=optical),
            f"{ZED}/point_cloud/cloud_registered": ros.cloud(forward, rgb(number), stamp_ns=at_ns, frame=body),
        }
        sent += [Sent(topic, message, at_ns + 20 * MS) for topic, message in made.items()]
    return sent


@dataclass(frozen=True)
class Played:
    pictures: list[CameraPictures]
    end: str
    """What the camera says after the last ones."""


def play(config: RecordedCameraConfig, path: Path) -> Played:
    camera = replace(config, path=str(path)).build(MemoryTransport())
    pictures: list[CameraPictures] = []

    async def main() -> str:
        while True:
            try:
                pictures.append(await camera.capture(1.0))
            except NoMorePictures as end:
                return str(end)

    return Played(pictures, asyncio.run(main()))


def assert_camera(found: CameraPictures) -> None:
    np.testing.assert_allclose(matrix(found.calibration.T_world_camera), matrix(T_WORLD_CAMERA), atol=1e-6)
    assert found.calibration.fx_px == pytest.approx(60.0, abs=1e-3)


@pytest.mark.parametrize(
    ("storage", "compression"),
    [
        (StoragePlugin.MCAP, CompressionMode.NONE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    ],
    ids=lambda value: value.name.lower(),
)
def test_a_bag_of_realsense_is_played(tmp_path: Path, storage: StoragePlugin, compression: CompressionMode) -> None:
    path = ros.write_bag(tmp_path / "bag", realsense(), storage=storage, compression=compression)
    played = play(REALSENSE, path)
    assert [one.stamp_ns for one in played.pictures] == [stamp(number) for number in range(LOOKS)]
    assert "but for" not in played.end
    for number, one in enumerate(played.pictures):
        assert isinstance(one, DepthImage)
        np.testing.assert_array_equal(one.pixels, rgb(number))
        np.testing.assert_allclose(one.depth_m, depth_m(number), atol=1e-6)
        assert_camera(one)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3], ids=lambda value: value.name.lower())
def test_a_file_of_a_bag_is_played_alone(tmp_path: Path, storage: StoragePlugin) -> None:
    folder = ros.write_bag(tmp_path / "bag", realsense(), storage=storage)
    (folder / "metadata.yaml").unlink()
    (file,) = folder.iterdir()
    for path in (file, folder):
        assert len(play(REALSENSE, path).pictures) == LOOKS


@pytest.mark.parametrize("config", [ZED_DEPTH, ZED_CLOUD, ZED_PAIR], ids=["depth", "cloud", "pair"])
def test_a_bag_of_a_zed_is_played(tmp_path: Path, config: RecordedCameraConfig) -> None:
    played = play(config, ros.write_bag(tmp_path / "bag", zed()))
    assert len(played.pictures) == LOOKS
    for number, one in enumerate(played.pictures):
        assert_camera(one)
        np.testing.assert_array_equal(one.reference, rgb(number))
        if isinstance(one, StereoImages):
            np.testing.assert_array_equal(one.right, rgb(number)[:, ::-1])
            assert one.calibration.baseline_m == pytest.approx(0.12)
        else:
            assert one.depth_m[0, 0] == 0.0
            np.testing.assert_allclose(one.depth_m[1:], depth_m(number)[1:], atol=1e-6)


def test_the_pose_of_a_moving_camera_is_that_of_each_picture(tmp_path: Path) -> None:
    moving = [
        Sent(
            "/tf",
            ros.tf(("base_link", "camera_link", pose((0.1 * number, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0))), stamp_ns=at_ns),
            at_ns,
        )
        for number in range(LOOKS + 1)
        for at_ns in (stamp(number) - PERIOD_NS // 2,)
    ]
    link = statics(("camera_link", OPTICAL, pose((0.0, 0.0, 0.0))))
    path = ros.write_bag(tmp_path / "bag", [*realsense()[:-1], link, *moving])
    found = [one.calibration.T_world_camera.position_m[0] for one in play(REALSENSE, path).pictures]
    np.testing.assert_allclose(found, [0.05, 0.15, 0.25, 0.35], atol=1e-6)


def test_another_frame_may_be_the_world(tmp_path: Path) -> None:
    path = ros.write_bag(tmp_path / "bag", realsense())
    (first, *_) = play(replace(REALSENSE, frame="camera_link"), path).pictures
    np.testing.assert_allclose(first.calibration.T_world_camera.position_m, [0.0, 0.015, 0.0], atol=1e-9)


def test_the_pose_of_a_file_counts_and_the_difference_is_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    beside = compose(T_WORLD_CAMERA, pose((0.012, 0.0, 0.0)))
    write_calibration(tmp_path / "c.toml", msgspec.structs.replace(CAMERA, T_world_camera=beside))
    path = ros.write_bag(tmp_path / "bag", realsense())
    (first, *_) = play(replace(REALSENSE, calibration=str(tmp_path / "c.toml")), path).pictures
    np.testing.assert_allclose(matrix(first.calibration.T_world_camera), matrix(beside), atol=1e-9)
    assert "by TF, camera_color_optical_frame is 12.0 mm and 0.00° away from it" in caplog.text


def test_a_file_with_the_pose_replaces_tf(tmp_path: Path) -> None:
    write_calibration(tmp_path / "c.toml", CAMERA)
    path = ros.write_bag(tmp_path / "bag", realsense()[:-1])
    played = play(replace(REALSENSE, calibration=str(tmp_path / "c.toml")), path)
    assert_camera(played.pictures[0])


def test_damaged_pictures_are_left_out_and_named(tmp_path: Path) -> None:
    sent = realsense()
    broken = sent[3].message
    broken.data = broken.data[:-5]
    played = play(REALSENSE, ros.write_bag(tmp_path / "bag", sent))
    assert [one.stamp_ns for one in played.pictures] == [stamp(0), stamp(2), stamp(3)]
    assert f"but for 1 that cannot be used ({COLOUR} at {stamp(1) / 1e9:.3f} s)" in played.end


TRACKDLO = RecordedCameraConfig(
    colour="/camera/color/image_raw", depth="/camera/aligned_depth_to_color/image_raw", frame=OPTICAL
)
"""Topics and frame of the bags of TrackDLO (Xiang et al., RA-L 2023, doi 10.13012/B2IDB-2916472_V1)."""


def trackdlo(*, info: str) -> list[Sent]:
    """Messages as in TrackDLO's bags: realsense-ros of ROS 1, without a transform of the camera."""
    at = {COLOUR: TRACKDLO.colour, ALIGNED: TRACKDLO.depth, "/camera/camera/color/camera_info": info}
    return [one._replace(topic=at[one.topic]) for one in realsense()[:-1]]


@pytest.mark.parametrize("info", ["/camera/color/camera_info", "/camera/aligned_depth_to_color/camera_info"])
@pytest.mark.parametrize("compression", [None, Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4])
def test_a_bag_of_ros_1_is_played_as_it_is_published(
    tmp_path: Path, info: str, compression: Writer.CompressionFormat | None
) -> None:
    path = ros.write_ros1_bag(tmp_path / "rope.bag", trackdlo(info=info), compression=compression)
    played = play(TRACKDLO, path)
    assert [one.stamp_ns for one in played.pictures] == [stamp(number) for number in range(LOOKS)]
    for number, one in enumerate(played.pictures):
        assert isinstance(one, DepthImage)
        np.testing.assert_array_equal(one.pixels, rgb(number))
        np.testing.assert_allclose(one.depth_m, depth_m(number), atol=1e-6)
        np.testing.assert_array_equal(matrix(one.calibration.T_world_camera), np.eye(4))
        assert one.calibration.fx_px == CAMERA.fx_px


@pytest.mark.parametrize("topic", ["/tf_static", "/tf"])
def test_the_pose_in_a_bag_of_ros_1_is_that_of_its_tf(tmp_path: Path, topic: str) -> None:
    *pictures, transform = realsense()
    path = ros.write_ros1_bag(tmp_path / "bag.bag", [transform._replace(topic=topic), *pictures])
    assert_camera(play(REALSENSE, path).pictures[0])


def test_a_damaged_picture_of_ros_1_is_left_out(tmp_path: Path) -> None:
    sent = trackdlo(info="/camera/color/camera_info")
    sent[3].message.encoding = "yuv422"
    assert len(play(TRACKDLO, ros.write_ros1_bag(tmp_path / "rope.bag", sent)).pictures) == LOOKS - 1


def test_a_bag_may_be_repeated(tmp_path: Path) -> None:
    path = ros.write_bag(tmp_path / "bag", realsense())
    camera = replace(REALSENSE, path=str(path), repeat=True).build(MemoryTransport())

    async def main() -> list[int]:
        return [(await camera.capture(1.0)).stamp_ns for _ in range(2 * LOOKS)]

    stamps = asyncio.run(main())
    assert all(later > earlier for earlier, later in pairwise(stamps))


# Mistakes


@dataclass(frozen=True)
class Mistake:
    make: Callable[[Path], Path]
    """Writes the bag in a folder."""
    words: tuple[str, ...]
    """Words of the error."""
    config: RecordedCameraConfig = REALSENSE


def bag(sent: Sequence[Sent]) -> Callable[[Path], Path]:
    return lambda folder: ros.write_bag(folder / "bag", sent)


def damaged(folder: Path) -> Path:
    path = ros.write_bag(folder / "bag", realsense())
    file = path / "bag.mcap"
    file.write_bytes(file.read_bytes()[:-200])
    return path


def no_database(folder: Path) -> Path:
    (folder / "x.db3").write_bytes(b"no database" * 100)
    return folder / "x.db3"


def no_bag(folder: Path) -> Path:
    (folder / "metadata.yaml").write_text("something: [else")
    return folder


def missing_file(folder: Path) -> Path:
    path = ros.write_bag(folder / "bag", realsense())
    (path / "bag.mcap").unlink()
    return path


def without_metadata(folder: Path) -> Path:
    for name in ("a_0.db3", "a_1.db3"):
        (folder / name).write_bytes(b"")
    return folder


def named(name: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        (folder / name).write_bytes(b"")
        return folder / name

    return make


def by_librealsense(folder: Path) -> Path:
    pixels = ros.image(rgb(0), "rgb8", stamp_ns=BEGIN_NS)
    return ros.write_ros1_bag(folder / "rs.bag", [Sent("/device_0/sensor_1/Color_0/image/data", pixels, BEGIN_NS)])


def retimed(sent: Sequence[Sent], topic: str, shift_ns: int) -> list[Sent]:
    for one in sent:
        if one.topic == topic:
            header = one.message.header
            stamp_ns = header.stamp.sec * 10**9 + header.stamp.nanosec + shift_ns
            one.message.header = ros.header(stamp_ns, header.frame_id)
    return list(sent)


def uncalibrated() -> list[Sent]:
    sent = realsense()
    for one in sent:
        if one.topic.endswith("camera_info"):
            one.message.k = np.zeros(9)
    return sent


MISTAKES: dict[str, Mistake] = {
    "no topics": Mistake(
        bag(realsense()),
        (
            f"--camera.colour {COLOUR} (rgb8 64 by 48 px, frame '{OPTICAL}')",
            f"--camera.depth {ALIGNED} (16UC1 64 by 48 px",
        ),
        RecordedCameraConfig(),
    ),
    "no topics of a ZED": Mistake(
        bag(zed()),
        (
            f"--camera.cloud {ZED}/point_cloud/cloud_registered (64 by 48 points",
            f"--camera.right {ZED}/right/color/rect/image (bgra8",
        ),
        RecordedCameraConfig(),
    ),
    "another topic": Mistake(
        bag(realsense()), ("nothing publishes /cam", f"--camera.colour {COLOUR}"), replace(REALSENSE, colour="/cam")
    ),
    "a topic of another type": Mistake(
        bag(realsense()), ("has the type tf2_msgs/msg/TFMessage",), replace(REALSENSE, depth="/tf_static")
    ),
    "no calibration": Mistake(
        bag([one for one in realsense() if not one.topic.endswith("camera_info")]),
        ("nothing publishes /camera/camera/color/camera_info",),
    ),
    "a camera that is not calibrated": Mistake(bag(uncalibrated()), ("the camera is not calibrated in ROS",)),
    "no pose": Mistake(
        bag(realsense()[:-1]), ("'base_link' is in no transform", f"'{OPTICAL}' is in no", "--camera.calibration")
    ),
    "two trees": Mistake(
        bag(
            [*realsense()[:-1], statics(("base_link", "tool", T_WORLD_LINK), ("camera_link", OPTICAL, T_LINK_OPTICAL))]
        ),
        ("in the tree of 'base_link' (base_link, tool)", "in the tree of 'camera_link'", "--camera.frame"),
    ),
    "no pairs": Mistake(bag(retimed(realsense(30), ALIGNED, 10**10)), ("colour comes at 30 Hz", "half a period")),
    "no messages": Mistake(
        bag([Sent(COLOUR, ros.image(rgb(0), "rgb8"), 1), *[one for one in realsense() if one.topic != COLOUR]]),
        ("no pairs",),
    ),
    "a damaged bag": Mistake(damaged, ("cannot be read as a bag of ROS 2", "ros2 bag reindex")),
    "no database": Mistake(no_database, ("cannot be read as a bag of ROS 2",)),
    "no bag": Mistake(no_bag, ("cannot be read as a bag of ROS 2",)),
    "a missing file": Mistake(missing_file, ("cannot be read as a bag of ROS 2", "missing")),
    "no metadata": Mistake(without_metadata, ("2 files of a bag and no metadata.yaml",)),
    "no bag of ROS 1": Mistake(named("x.bag"), ("cannot be read as a bag of ROS 1", "rosbag reindex")),
    "librealsense": Mistake(by_librealsense, ("play it with --camera realsense --camera.file",)),
    "one compressed file": Mistake(named("x.db3.zstd"), ("give its folder",)),
    "no file of a bag": Mistake(named("x.txt"), ("is no bag of ROS, and --camera.colour is for one",)),
    "a file without a pose": Mistake(
        bag(realsense()), ("calibration /nowhere.toml cannot be used",), replace(REALSENSE, calibration="/nowhere.toml")
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES.values(), ids=MISTAKES.keys())
def test_mistakes_are_named_before_the_first_picture(tmp_path: Path, mistake: Mistake) -> None:
    with pytest.raises(ConfigError) as error:
        replace(mistake.config, path=str(mistake.make(tmp_path))).build(MemoryTransport())
    assert all(words in str(error.value) for words in mistake.words), str(error.value)
    assert "\n" not in str(error.value)


def test_another_definition_in_a_bag_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = ros.write_bag(tmp_path / "bag", realsense(), storage=StoragePlugin.MCAP)
    file = path / "bag.mcap"
    file.write_bytes(file.read_bytes().replace(b"float64[9] k", b"float32[9] k"))
    with pytest.raises(ConfigError, match="another definition of sensor_msgs/msg/CameraInfo"):
        replace(REALSENSE, path=str(file)).build(MemoryTransport())


def rope_bag(folder: Path, frames: int = 8) -> Path:
    """A bag of ROS 1 in TrackDLO's layout: a blue rope that moves over a dark table."""
    sent: list[Sent] = []
    for number in range(frames):
        seen, at_ns = picture(0.003 * number), stamp(number)
        pixels = np.repeat(seen.pixels[..., :1], 3, axis=2)  # grey: a noise of colours would have the rope's hue, too
        pixels[pixels[..., 0] == 230] = (20, 60, 200)
        depth = np.round(seen.depth_m * 1000.0).astype(np.uint16)
        camera = ros.info(PICTURED, stamp_ns=at_ns, frame=OPTICAL)
        sent += [
            Sent("/camera/aligned_depth_to_color/camera_info", camera, at_ns),
            Sent(TRACKDLO.colour, ros.image(pixels, "rgb8", stamp_ns=at_ns, frame=OPTICAL), at_ns + MS),
            Sent(TRACKDLO.depth, ros.image(depth, "16UC1", stamp_ns=at_ns, frame=OPTICAL), at_ns + 2 * MS),
        ]
    return ros.write_ros1_bag(folder / "rope.bag", sent)


BLUE = ColourConfig(lowest_hue_deg=180.0, highest_hue_deg=260.0, least_saturation=90, least_value=30)
ROPE = (
    *("--camera.colour", TRACKDLO.colour, "--camera.depth", TRACKDLO.depth, "--camera.frame", OPTICAL),
    # TrackDLO's limits of hue, saturation and value are 90 90 30 to 130 255 255, in steps of two degrees.
    *("--segmentation", "colour", "--segmentation.lowest-hue-deg", "180", "--segmentation.highest-hue-deg", "260"),
    *("--segmentation.least-saturation", "90", "--segmentation.least-value", "30"),
)


def test_a_rope_in_a_bag_of_ros_1_is_tracked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = ("--camera", "recorded", "--camera.path", str(rope_bag(tmp_path)), "--rate-hz", "1000")
    code = execute(["track", *bag, *ROPE, "--nodes", "21", "--headless", "--out", str(tmp_path / "out")])
    assert code == 0
    assert "8 of 8 frames followed" in capsys.readouterr().out
    with (tmp_path / "out" / "nodes.csv").open() as file:
        rows = list(csv.DictReader(file))
    found = np.array([[float(row[axis]) for axis in ("x_m", "y_m", "z_m")] for row in rows]).reshape(8, 21, 3)
    for number, nodes in enumerate(found):
        true = transform(inverse(PICTURED.T_world_camera), bow(0.003 * number))
        assert np.linalg.norm(nodes[:, None] - true[None], axis=2).min(axis=1).max() < 0.006


def test_a_rope_in_a_bag_of_ros_1_is_a_sequence_of_the_bench_of_observers(tmp_path: Path) -> None:
    (case,) = external_cases((rope_bag(tmp_path),), PictureSettings(camera=TRACKDLO, segmentation=BLUE))
    plan = BenchPlan(cases=(case,), methods=choose(("map",)).methods[:1], seeds=1, frames=None)
    (trial,) = run_plan(plan)
    assert trial.frames == 8
    assert "node error" not in trial.figures, "the true nodes are not known"
    assert trial.figures["cloud error"] < 0.004
    assert trial.figures["length error"] < 0.05


def test_pictures_in_which_nothing_is_found_are_refused_with_what_to_do(tmp_path: Path) -> None:
    red = PictureSettings(camera=TRACKDLO, segmentation=ColourConfig(lowest_hue_deg=0.0, highest_hue_deg=2.0))
    with pytest.raises(InputError, match=r"rope.bag: no two pictures show the DLO .* choose --segmentation"):
        external_cases((rope_bag(tmp_path, frames=2),), red)
