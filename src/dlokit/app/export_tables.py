"""A recording as files of numbers: a file a topic, `.npz` or `.csv`, and its pictures as they were recorded."""

import csv
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlokit.communication.topics import STEREO_IMAGES
from dlokit.recording.channels import RECORDED, topic_of
from dlokit.recording.columns import Column, columns
from dlokit.recording.reader import RawRecording, Recorded, picture_file, read_recording

MOST_COLUMNS = 512
"""Fields of more numbers a message are left out of `.csv` files: covariances and depth."""
PICTURES = {"view/left": "left", "view/right": "right"}


def write_npz(path: Path, folder: Path) -> list[str]:
    """Write `<topic>.npz` for each topic, and the pictures; returns what is left out: nothing."""
    for name, found in _tables(path):
        arrays: dict[str, NDArray[Any]] = {}
        for column in found:
            arrays[column.name] = column.values
            if column.first is not None:
                arrays[f"{column.name}.first"] = column.first
        np.savez_compressed(folder / f"{name}.npz", **arrays)  # type: ignore[arg-type]
    _write_pictures(path, folder)
    return []


def write_csv(path: Path, folder: Path) -> list[str]:
    """Write `<topic>.csv` for each topic, and the pictures; returns the fields that are too long for a line."""
    left_out: list[str] = []
    for name, found in _tables(path):
        kept = [column for column in found if column.first is None and _width(column) <= MOST_COLUMNS]
        left_out += [f"{name}.{column.name}" for column in found if column not in kept]
        with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([heading for column in kept for heading in _headings(column)])
            writer.writerows(_lines(kept))
    _write_pictures(path, folder)
    return left_out


def _tables(path: Path) -> Iterable[tuple[str, list[Column]]]:
    by_topic: defaultdict[str, list[Recorded]] = defaultdict(list)
    for one in read_recording(path, _WithoutPictures()):
        by_topic[one.topic].append(one)
    for topic, messages in by_topic.items():
        yield topic.replace("/", "_"), columns(messages)


class _WithoutPictures:
    """Every topic that holds no pictures: those are files of their own."""

    def __contains__(self, channel: object) -> bool:
        topic = topic_of(str(channel))
        return topic is not None and topic.row in RECORDED and topic.row != STEREO_IMAGES.name


def _width(column: Column) -> int:
    return int(np.prod(column.values.shape[1:]))


def _headings(column: Column) -> list[str]:
    shape = column.values.shape[1:]
    if not shape:
        return [column.name]
    return ["_".join((column.name, *map(str, index))) for index in np.ndindex(*shape)]


def _lines(kept: list[Column]) -> Iterable[list[Any]]:
    for number in range(len(kept[0].values)):
        yield [value for column in kept for value in np.ravel(column.values[number]).tolist()]


def _write_pictures(path: Path, folder: Path) -> None:
    for channel, record in RawRecording(path=path):
        if channel in PICTURES:
            picture = picture_file(record.data)
            side = folder / "pictures" / PICTURES[channel]
            side.mkdir(parents=True, exist_ok=True)
            (side / f"{record.publish_time:020d}.{picture.format}").write_bytes(picture.data)
