"""Stands for the package visiontransfer, by its documentation: one camera that sends the arrays it is given."""

import enum
from collections.abc import Callable
from typing import Any

import numpy as np
from hand_clock import HandClock
from numpy.typing import NDArray

WITHOUT_ANSWER_S = 0.005


class ImageType(enum.IntEnum):
    IMAGE_LEFT = 1
    IMAGE_DISPARITY = 2


class ImageSet:
    """The pictures of one exposure; disparities in 1/`subpixels` px, 0xFFF where there is no match."""

    def __init__(
        self,
        pictures: dict[ImageType, NDArray[Any]],
        Q: NDArray[np.float32],
        *,
        subpixels: int = 16,
        exposure_us: int = 8000,
        device_ahead_s: float = 100.0,
        now_ns: int = 0,
    ) -> None:
        self._pictures, self._Q = pictures, Q
        self._subpixels, self._exposure_us = subpixels, exposure_us
        self._taken_us = round(now_ns / 1e3 + device_ahead_s * 1e6)

    def has_image_type(self, what: ImageType) -> bool:
        return what in self._pictures

    def get_pixel_data(self, what: ImageType, force8bit: bool = False) -> NDArray[Any]:
        found = self._pictures[what]
        return (found // 16).astype(np.uint8) if force8bit and found.dtype == np.uint16 else found.copy()

    def get_qmatrix(self) -> NDArray[np.float32]:
        return self._Q

    def get_width(self) -> int:
        return self._pictures[ImageType.IMAGE_LEFT].shape[1]

    def get_height(self) -> int:
        return self._pictures[ImageType.IMAGE_LEFT].shape[0]

    def get_subpixel_factor(self) -> int:
        return self._subpixels

    def get_timestamp(self) -> tuple[int, int]:
        return self._taken_us // 1_000_000, self._taken_us % 1_000_000

    def get_exposure_time(self) -> int:
        return self._exposure_us


class DeviceInfo:
    def __init__(self, address: str, serial: str) -> None:
        self._address, self._serial = address, serial

    def get_ip_address(self) -> str:
        return self._address

    def get_serial_number(self) -> str:
        return self._serial


class FakeVisiontransfer:
    """The module: `send` makes each image set of the time [ns], or returns None while the camera is silent.

    An image set arrives `latency_s` after it was taken; each question without an answer takes a while.
    """

    ImageType = ImageType

    def __init__(self, send: Callable[[int], ImageSet | None], *devices: DeviceInfo, latency_s: float) -> None:
        self._send = send
        self._latency_s = latency_s
        self.clock = HandClock()
        self.devices = list(devices or [DeviceInfo("192.168.10.10", "N42")])
        self.connected = 0

    def DeviceEnumeration(self) -> "FakeVisiontransfer":
        return self

    def discover_devices(self) -> list[DeviceInfo]:
        return self.devices

    def AsyncTransfer(self, device: DeviceInfo) -> "FakeVisiontransfer":
        self.connected += 1
        return self

    def collect_received_image_set(self, timeout: float = -1) -> ImageSet | None:
        assert timeout == 0, "a call that blocks would stop all threads"
        sent = self._send(self.clock())
        self.clock.advance(WITHOUT_ANSWER_S if sent is None else self._latency_s)
        return sent

    def disconnect(self) -> None:
        self.connected -= 1
