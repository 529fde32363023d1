"""A camera that gives the pictures of a recording again, when they came."""

import asyncio
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import msgspec

from dlokit.communication.timing.clock import LoopClock
from dlokit.errors import HardwareError
from dlokit.functional.cameras.base import CameraContext
from dlokit.types.image import CameraCalibration, CameraPictures


@dataclass(frozen=True, kw_only=True)
class RecordedLook:
    """The pictures of one look, and when they came."""

    log_ns: int
    images: CameraPictures


class PlayedCamera(CameraContext):
    """A `Camera` for a run that is replayed: the pictures of one look each time it is asked, in their order.

    Recordings keep pictures at a rate; a look whose pictures were left out gets the ones before, with its own stamp.
    """

    def __init__(self, pictures: Iterator[RecordedLook], looks: Sequence[tuple[int, int]]) -> None:
        """`pictures` in order, read when they are needed; `looks`: the stamp of each, and when it was over [ns]."""
        super().__init__(is_open=True)
        self._pictures = pictures
        self._looks = iter(looks)
        self._last: RecordedLook | None = None
        self._next = next(pictures, None)
        self.left_out: set[int] = set()
        """Stamps of the looks whose own pictures are not there."""

    @property
    def empty(self) -> bool:
        """Whether there are no pictures at all."""
        return self._last is None and self._next is None

    @property
    def calibration(self) -> CameraCalibration:
        """That of the first pictures. Raises `HardwareError` when no pictures were recorded."""
        first = self._last or self._next
        if first is None:
            raise HardwareError("the recording holds no pictures; a run records them unless its camera was never asked")
        return first.images.calibration

    async def capture(self, timeout_s: float) -> CameraPictures:
        """The pictures of the next look; after the last one nothing ever comes, and the caller's time-out ends it."""
        clock = LoopClock()
        look = next(self._looks, None)
        if look is None:
            await asyncio.get_running_loop().create_future()
            raise HardwareError("no look was recorded after this one")
        stamp_ns, over_ns = look
        while self._next is not None and self._next.images.stamp_ns <= stamp_ns:
            self._last, self._next = self._next, next(self._pictures, None)
        if self._last is None:
            raise HardwareError("no pictures were recorded of the first look; replay a recording from its beginning")
        if self._last.images.stamp_ns == stamp_ns:
            await clock.sleep_until(self._last.log_ns)
            return self._last.images
        self.left_out.add(stamp_ns)
        await clock.sleep_until(over_ns)
        return msgspec.structs.replace(self._last.images, stamp_ns=stamp_ns)
