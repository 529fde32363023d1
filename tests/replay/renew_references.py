"""Renews the recorded runs that `test_references.py` replays: `make references`."""

import sys
import tempfile
from collections import Counter
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from dlokit.app.commands import execute
from dlokit.recording.channels import FILE_NAME

FOLDER = Path(__file__).with_name("references")

RUNS: dict[str, tuple[str, ...]] = {
    "farthest": ("--start", "random", "--goal", "I", "--seed", "1001", "--planner", "farthest"),
    "rollout": (
        *("--goal", "S", "--seed", "1002", "--planner", "rollout", "--max-actions", "1"),
        *("--planning.strategy.search.rollouts", "160", "--planning.strategy.search.finalists", "2"),
    ),
    "wire": (
        *("--start", "random", "--goal", "I", "--seed", "1003", "--dlo", "wire-a", "--randomised", "--infeasible"),
        *("try", "--observer", "cpd", "--planner", "farthest", "--control", "--max-actions", "1"),
    ),
}
"""Configurations by file name: each planner, two observers, shape servoing, a DLO with permanent deformation."""

PAIRS_OF_PICTURES = {"farthest": 2}
"""Number of image pairs that are kept: they are most of a recording, and perception cannot be replayed without."""

NOT_FED = ("cell/", "view/")
"""Channels that no replayed component reads."""
PICTURES = ("perception/images", "view/left", "view/right")


def renew(names: list[str]) -> None:
    """Run, and keep the messages that a replay needs."""
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            code = execute(["shape", "--headless", "--no-check-camera", "--out", folder, *RUNS[name]])
            assert code in (0, 3), f"the run {name} did not end by itself"
            keep(Path(folder) / FILE_NAME, FOLDER / f"{name}.mcap", PAIRS_OF_PICTURES.get(name, 0))


def keep(source: Path, target: Path, pairs: int) -> None:
    """Copy a recording without most of its images; the same messages give the same bytes."""
    with source.open("rb") as whole, target.open("wb") as part:
        reader, writer = make_reader(whole), Writer(part, compression=CompressionType.ZSTD)
        writer.start(library="dlokit")
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        numbers: dict[str, int] = {}
        pictures: Counter[str] = Counter()
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            topic = channel.topic
            pictures[topic] += topic in PICTURES
            if pictures[topic] > pairs or (topic.startswith(NOT_FED) and topic not in PICTURES):
                continue
            if topic not in numbers:
                of = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[topic] = writer.register_channel(topic, channel.message_encoding, of)
            writer.add_message(numbers[topic], message.log_time, message.data, message.publish_time, message.sequence)
        writer.finish()


if __name__ == "__main__":
    renew(sys.argv[1:] or list(RUNS))
