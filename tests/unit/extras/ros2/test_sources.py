"""Messages of a camera's topics are paired by their stamps, each once, and mistakes in topics are named."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import ros2_messages as ros
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from dlokit.errors import CommunicationError, ConfigError, HardwareError
from dlokit.extras.ros2.link.frames import Endpoint, Graph
from dlokit.extras.ros2.pictures.sources import Moment, PictureSource, flaw_of, head_of
from dlokit.functional.cameras.picture_topics import PictureTopics
from dlokit.geometry import pose
from dlokit.geometry.camera import centred_camera
from dlokit.types.image import DepthImage, StereoImages

few = settings(max_examples=30, deadline=None, derandomize=True, database=None)
STORE = get_typestore(Stores.ROS2_JAZZY)
MS, PERIOD_NS = 1_000_000, 33_333_333
T = pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0))
CAMERA = centred_camera(8, 6, 10.0, T)
RGB = np.random.default_rng(0).integers(0, 255, (6, 8, 3), dtype=np.uint8)
DEPTH = np.full((6, 8), 912, dtype=np.uint16)
COLOUR, ALIGNED, INFO = "/cam/color/image_raw", "/cam/aligned/image_raw", "/cam/color/camera_info"
WITH_DEPTH = PictureTopics(colour=COLOUR, depth=ALIGNED)
PAIR = PictureTopics(colour="/l/image_rect", right="/r/image_rect")


class Feed:
    """A source and what it has made of the messages so far."""

    def __init__(self, topics: PictureTopics = WITH_DEPTH, *, infos: bool = True) -> None:
        self.source = PictureSource(topics, ros.DEFINITIONS.decode)
        self.moments: list[Moment] = []
        self.now_ns = 0
        if infos:
            for topic, kinds in self.source.kinds.items():
                if kinds == (ros.INFO,):
                    self.add(topic, ros.info(CAMERA, shift_m=0.1 if topic.startswith("/r") else 0.0))

    def add(self, topic: str, message: Any) -> Moment | None:
        moment = self.source.add(topic, message.__msgtype__, ros.cdr(message), self.now_ns)
        if moment is not None:
            self.moments.append(moment)
        return moment

    def colour(self, stamp_ns: int) -> Moment | None:
        return self.add(COLOUR, ros.image(RGB, "rgb8", stamp_ns=stamp_ns))

    def depth(self, stamp_ns: int) -> Moment | None:
        return self.add(ALIGNED, ros.image(DEPTH, "16UC1", stamp_ns=stamp_ns))

    @property
    def pairs_ms(self) -> list[tuple[int, int]]:
        return [(round(m.stamp_ns / MS), round(m.parts["depth"].head.stamp_ns / MS)) for m in self.moments]


@few
@given(stamp_ns=st.integers(0, 2**31 * 1_000_000_000 - 1), frame=st.text(max_size=40), little=st.booleans())
def test_the_head_of_a_message_is_read_without_decoding_it(stamp_ns: int, frame: str, little: bool) -> None:
    frame = frame.replace("\0", "")
    message = ros.image(RGB, "rgb8", stamp_ns=stamp_ns, frame=frame)
    data = bytes(STORE.serialize_cdr(message, ros.IMAGE, little_endian=little))
    head = head_of(data)
    assert (head.stamp_ns, head.frame_id) == (stamp_ns, frame.lstrip("/"))


@few
@given(cut=st.integers(0, 25), noise=st.binary(max_size=40))
def test_bytes_that_do_not_begin_as_a_message_are_refused(cut: int, noise: bytes) -> None:
    with pytest.raises(CommunicationError, match="do not begin as a message"):
        head_of(ros.cdr(ros.image(RGB, "rgb8", frame="a frame"))[: min(cut, 22)])
    try:
        head_of(noise)
    except CommunicationError:
        return


def test_pictures_of_one_stamp_are_a_moment_with_the_arrival_of_the_last_one() -> None:
    feed = Feed()
    feed.now_ns = 5
    assert feed.colour(1000 * MS) is None
    feed.now_ns = 9
    moment = feed.depth(1000 * MS)
    assert moment is not None
    assert (moment.stamp_ns, moment.arrived_ns, moment.frame_id) == (1000 * MS, 9, "camera")


def test_pictures_that_came_before_their_calibration_wait_for_it() -> None:
    feed = Feed(infos=False)
    feed.colour(1000 * MS)
    feed.depth(1000 * MS)
    assert not feed.moments
    feed.add(INFO, ros.info(CAMERA, stamp_ns=1000 * MS))
    feed.add(INFO, ros.info(CAMERA, stamp_ns=1033 * MS))
    assert feed.pairs_ms == [(1000, 1000)]


@few
@given(
    order=st.permutations(range(12)),
    offset_ms=st.integers(-14, 14),
    jitter=st.lists(st.integers(-2, 2), min_size=6, max_size=6),
)
def test_every_picture_is_paired_at_most_once_and_with_its_nearest(
    order: Sequence[int], offset_ms: int, jitter: Sequence[int]
) -> None:
    feed = Feed()
    for number in range(-6, 0):  # the period is known
        feed.colour(1_000_000 * MS + number * PERIOD_NS)
        feed.depth(1_000_000 * MS + number * PERIOD_NS + offset_ms * MS)
    feed.moments.clear()
    # Two streams whose messages are mixed, but in order in each.
    streams = [sorted(one for one in order if one % 2 == side) for side in (0, 1)]
    for one in order:
        side = one % 2
        number = streams[side].pop(0) // 2
        at_ns = 1_000_000 * MS + number * PERIOD_NS
        feed.colour(at_ns) if side == 0 else feed.depth(at_ns + (offset_ms + jitter[number]) * MS)
    assert len(feed.moments) == 6
    colours = [moment.stamp_ns for moment in feed.moments]
    depths = [moment.parts["depth"].head.stamp_ns for moment in feed.moments]
    assert colours == sorted(set(colours))
    assert depths == sorted(set(depths))
    assert all(abs(one - other) <= PERIOD_NS / 2 for one, other in zip(colours, depths, strict=True))


def test_before_the_period_is_known_only_equal_stamps_are_a_pair() -> None:
    feed = Feed()
    feed.colour(0)
    assert feed.depth(8 * MS) is None
    feed.colour(100 * MS)
    assert feed.depth(100 * MS + MS // 2) is not None


def test_pictures_more_than_half_a_period_apart_are_no_pair() -> None:
    feed = Feed()
    for number in range(10):
        feed.colour(number * 100 * MS)
        feed.depth(number * 100 * MS)
    feed.moments.clear()
    feed.colour(1000 * MS)
    assert feed.depth(1060 * MS) is None
    feed.colour(1100 * MS)
    assert feed.pairs_ms == [(1100, 1060)]


def test_a_lost_message_does_not_shift_the_following_pairs() -> None:
    feed = Feed()
    for number in range(20):
        if number % 3:
            feed.colour(number * PERIOD_NS)
        if number % 4:
            feed.depth(number * PERIOD_NS)
    assert [one for one, _ in feed.pairs_ms] == [other for _, other in feed.pairs_ms]
    assert len(feed.moments) == sum(1 for number in range(20) if number % 3 and number % 4)


def test_half_of_the_messages_lost_at_random_do_not_lengthen_the_period() -> None:
    feed, rng = Feed(), np.random.default_rng(0)
    for number in range(300):
        if rng.random() < 0.4:
            feed.colour(number * PERIOD_NS)
        if rng.random() < 0.4:
            feed.depth(number * PERIOD_NS)
    assert feed.moments
    assert all(one == other for one, other in feed.pairs_ms)


def test_memory_is_bounded_while_one_topic_is_silent() -> None:
    feed = Feed()
    for number in range(100):
        feed.colour(number * PERIOD_NS)
    # The newest are kept: a late partner of one of them still makes a pair, one of an older one does not.
    assert feed.depth(80 * PERIOD_NS) is None
    assert feed.depth(96 * PERIOD_NS) is not None


def test_pictures_wait_for_the_calibration() -> None:
    feed = Feed(infos=False)
    feed.colour(0)
    feed.depth(0)
    assert feed.source.no_pairs().startswith(f"no message has come on {INFO}")
    feed.add(INFO, ros.info(CAMERA))
    feed.colour(33 * MS)
    assert feed.depth(33 * MS) is not None


def test_damaged_and_foreign_messages_are_counted_and_ignored() -> None:
    feed = Feed()
    assert feed.source.add(COLOUR, ros.IMAGE, b"garbage", 0) is None
    assert feed.source.add("/elsewhere", ros.IMAGE, b"garbage", 0) is None
    assert feed.source.damaged == {COLOUR: 1}


def test_rates_are_those_of_the_last_arrivals() -> None:
    feed = Feed()
    for number in range(60):
        feed.now_ns = number * PERIOD_NS
        feed.colour(number * PERIOD_NS)
        if number % 5 == 0 and number < 10:
            feed.depth(number * PERIOD_NS + 100_000 * MS)
    rates_hz = feed.source.rates_hz()
    assert rates_hz[COLOUR] == pytest.approx(30.0, abs=0.1)
    assert rates_hz[ALIGNED] == pytest.approx(6.0, abs=0.1)
    feed.now_ns += 5_000 * MS
    feed.colour(70 * PERIOD_NS)
    assert feed.source.rates_hz()[ALIGNED] == 0.0


def test_no_pairs_is_explained_by_both_rates() -> None:
    feed = Feed()
    for number in range(30):
        feed.now_ns = number * PERIOD_NS
        feed.colour(number * PERIOD_NS)
        if number % 5 == 0:
            feed.depth(number * PERIOD_NS + 10_000 * MS)
    assert not feed.moments
    assert "no pairs: colour comes at 30 Hz, depth comes at 6 Hz, none within half a period (17 ms)" in (
        feed.source.no_pairs()
    )
    silent = Feed()
    silent.colour(0)
    assert silent.source.no_pairs().startswith(f"no message has come on {ALIGNED}")


def test_a_moment_of_colour_and_depth_is_decoded() -> None:
    feed = Feed()
    feed.colour(7 * MS)
    moment = feed.depth(7 * MS)
    assert moment is not None
    pictures = feed.source.pictures(moment, 42, T)
    assert isinstance(pictures, DepthImage)
    np.testing.assert_array_equal(pictures.pixels, RGB)
    np.testing.assert_allclose(pictures.depth_m, 0.912, rtol=1e-6)
    assert pictures.stamp_ns == 42
    assert pictures.calibration.T_world_camera is T
    np.testing.assert_array_equal(feed.source.camera_in_frame(moment).wxyz, [1.0, 0.0, 0.0, 0.0])


def test_a_moment_of_a_stereo_pair_is_decoded() -> None:
    feed = Feed(PAIR)
    feed.add("/l/image_rect", ros.image(RGB, "rgb8", frame="left"))
    moment = feed.add("/r/image_rect", ros.image(RGB[:, ::-1], "rgb8", frame="right"))
    assert moment is not None
    pictures = feed.source.pictures(moment, 42, T)
    assert isinstance(pictures, StereoImages)
    np.testing.assert_array_equal(pictures.right, RGB[:, ::-1])
    assert pictures.calibration.baseline_m == pytest.approx(0.1)
    assert moment.frame_id == "left"


POINTS = np.stack(
    [*np.meshgrid(np.linspace(-0.5, 0.5, 40), np.linspace(-0.4, 0.4, 30)), np.ones((30, 40))], axis=-1
).astype(np.float32)
GREYS = np.full((30, 40, 3), 99, dtype=np.uint8)


@pytest.mark.parametrize("with_info", [True, False])
def test_a_cloud_is_a_moment_with_or_without_a_calibration(with_info: bool) -> None:
    feed = Feed(PictureTopics(cloud="/cam/points"), infos=False)
    if with_info:
        feed.add("/cam/camera_info", ros.info(centred_camera(40, 30, 39.5, T)))
    moment = feed.add("/cam/points", ros.cloud(POINTS, GREYS))
    assert moment is not None
    found = feed.source.pictures(moment, 0, T).calibration
    # The points are on a grid for f = 39 px; a calibration counts before them.
    assert found.fx_px == pytest.approx(39.5 if with_info else 39.0, abs=1e-3)


def test_a_calibration_of_another_size_is_not_the_cloud_s() -> None:
    feed = Feed(PictureTopics(cloud="/cam/points"), infos=False)
    feed.add("/cam/camera_info", ros.info(centred_camera(80, 60, 78.0, T)))
    moment = feed.add("/cam/points", ros.cloud(POINTS, GREYS))
    assert moment is not None
    assert feed.source.pictures(moment, 0, T).calibration.fx_px == pytest.approx(39.0, abs=1e-3)


def test_depths_that_are_not_aligned_are_refused() -> None:
    feed = Feed()
    feed.colour(0)
    moment = feed.add(ALIGNED, ros.image(DEPTH, "16UC1", frame="camera_depth_optical_frame"))
    assert moment is not None
    with pytest.raises(HardwareError, match=r"must be aligned.*align_depth\.enable"):
        feed.source.pictures(moment, 0, T)
    feed.colour(50 * MS)
    moment = feed.add(ALIGNED, ros.image(DEPTH[:3], "16UC1", stamp_ns=50 * MS))
    assert moment is not None
    with pytest.raises(HardwareError, match=r"8 by 3 px, .* 8 by 6 px; depths must be aligned"):
        feed.source.pictures(moment, 0, T)


def test_a_message_whose_body_is_damaged_is_refused_by_its_topic() -> None:
    feed = Feed()
    feed.colour(0)
    moment = feed.source.add(ALIGNED, ros.IMAGE, ros.cdr(ros.image(DEPTH, "16UC1"))[:60], 0)
    assert moment is not None
    with pytest.raises(HardwareError, match=f"a message of {ALIGNED} is damaged"):
        feed.source.pictures(moment, 0, T)


def test_topics_that_make_no_camera_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"name --camera\.colour and --camera\.depth"):
        PictureSource(PictureTopics(depth="/d"), ros.DEFINITIONS.decode)


# Before a start

GRAPH = Graph(
    topics={
        COLOUR: [ros.IMAGE],
        ALIGNED: [ros.IMAGE],
        INFO: [ros.INFO],
        "/other/image": [ros.COMPRESSED],
        "/points": [ros.CLOUD],
        "/two": [ros.IMAGE, ros.CLOUD],
    },
    publishers={COLOUR: [Endpoint(node="/cam", type=ros.IMAGE, reliable=True, transient_local=False)]},
    subscriptions={},
)


def flaw(topic: str, graph: Graph = GRAPH) -> str | None:
    return flaw_of(topic, (ros.IMAGE, ros.COMPRESSED), graph, ros.DEFINITIONS)


def published(*endpoints: Endpoint) -> Graph:
    return Graph(topics=GRAPH.topics, publishers={COLOUR: list(endpoints)}, subscriptions={})


def test_sound_topics_have_no_flaw() -> None:
    assert flaw(COLOUR) is None
    assert PictureSource(WITH_DEPTH, ros.DEFINITIONS.decode).flaw(GRAPH, ros.DEFINITIONS) is None


def test_a_missing_topic_is_answered_with_those_of_its_types() -> None:
    assert flaw("/camera/image") == (
        "nothing publishes /camera/image; topics of sensor_msgs/msg/Image or sensor_msgs/msg/CompressedImage are "
        f"{ALIGNED}, {COLOUR}, /other/image, /two"
    )
    none = flaw_of("/x", ("sensor_msgs/msg/Imu",), GRAPH, ros.DEFINITIONS)
    assert none is not None
    assert none.endswith("no topic of sensor_msgs/msg/Imu is published")


@pytest.mark.parametrize(("topic", "found"), [("/points", ros.CLOUD), ("/two", f"{ros.IMAGE} and {ros.CLOUD}")])
def test_a_topic_of_another_type_is_named_with_candidates(topic: str, found: str) -> None:
    assert (flaw(topic) or "").startswith(f"{topic} has the type {found}, needed is sensor_msgs/msg/Image or ")
    assert COLOUR in (flaw(topic) or "")


def test_two_publishers_are_both_named() -> None:
    one = Endpoint(node="/cam", type=ros.IMAGE, reliable=True, transient_local=False)
    two = Endpoint(node="/player", type=ros.IMAGE, reliable=True, transient_local=False)
    assert "has 2 publishers, /cam and /player; it must have one" in (flaw(COLOUR, published(one, two)) or "")


def test_another_definition_is_named_by_its_hash() -> None:
    ours = ros.DEFINITIONS.hash_of(ros.IMAGE)
    endpoint = Endpoint(node="/cam", type=ros.IMAGE, reliable=True, transient_local=False, hash=ours)
    assert flaw(COLOUR, published(endpoint)) is None
    other = Endpoint(node="/cam", type=ros.IMAGE, reliable=True, transient_local=False, hash="RIHS01_00")
    assert f"(RIHS01_00, not {ours})" in (flaw(COLOUR, published(other)) or "")


def test_the_calibration_s_topic_is_checked_but_for_a_cloud() -> None:
    without = Graph(
        topics={"/points": [ros.CLOUD], COLOUR: [ros.IMAGE], ALIGNED: [ros.IMAGE]}, publishers={}, subscriptions={}
    )
    decode = ros.DEFINITIONS.decode
    assert f"nothing publishes {INFO}" in (PictureSource(WITH_DEPTH, decode).flaw(without, ros.DEFINITIONS) or "")
    assert PictureSource(PictureTopics(cloud="/points"), decode).flaw(without, ros.DEFINITIONS) is None


def test_a_compressed_topic_is_expected_to_be_compressed() -> None:
    topics = replace(WITH_DEPTH, colour=f"{COLOUR}/compressed", depth=f"{ALIGNED}/compressedDepth")
    kinds = PictureSource(topics, ros.DEFINITIONS.decode).kinds
    assert kinds[f"{COLOUR}/compressed"][0] == ros.COMPRESSED
    assert kinds[INFO] == (ros.INFO,)
