"""`check_segmentation`: whether a segmentation keeps to its protocol."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from dlokit.communication.wire import codec
from dlokit.extras.checks.checks import Check, findings, require_none
from dlokit.extras.checks.settings import settings_checks
from dlokit.skills.perception.base import Segmentation, SegmentationConfig
from dlokit.skills.perception.config import SEGMENTATIONS
from dlokit.types.arrays import BoolArray, UInt8Array
from dlokit.types.image import Image

HEIGHT_PX, WIDTH_PX = 240, 320
ROPE_RGB, TABLE_RGB = (235, 200, 120), (45, 45, 50)
"""Colours of the picture: a light rope on a dark table, as in the cell."""

Build = Callable[[], Segmentation]


def picture(*, rope: bool = True, seed: int = 0) -> tuple[Image, BoolArray]:
    """A light rope on a dark table, with noise: RGB (height, width, 3), and the rope's pixels (height, width)."""
    x = np.arange(WIDTH_PX)
    centre = HEIGHT_PX / 2 + 50 * np.sin(x / 40.0)
    truth = rope & (np.abs(np.arange(HEIGHT_PX)[:, None] - centre[None]) < 4.0)
    pixels = np.where(truth[..., None], ROPE_RGB, TABLE_RGB).astype(np.float64)
    pixels += np.random.default_rng(seed).normal(0.0, 3.0, pixels.shape)
    return _image(np.clip(pixels, 0, 255).astype(np.uint8)), truth


def _image(pixels: UInt8Array) -> Image:
    return Image(stamp_ns=1, pixels=pixels)


def _builds(build: Build) -> Iterator[str]:
    if not callable(getattr(build(), "mask", None)):
        yield f"build() gives a {type(build()).__name__} without mask"


def _shape(build: Build) -> Iterator[str]:
    image, _ = picture()
    grey = _image(image.pixels.mean(axis=2).astype(np.uint8))
    for what, seen in (("an RGB picture", image), ("a grey picture", grey)):
        mask = build().mask(seen).pixels
        if mask.shape != (HEIGHT_PX, WIDTH_PX) or mask.dtype != np.bool_:
            yield f"of {what} the mask is {mask.shape} {mask.dtype} where {(HEIGHT_PX, WIDTH_PX)} bool is wanted"


def _finds(build: Build) -> Iterator[str]:
    image, truth = picture()
    found = overlap(build().mask(image).pixels, truth)
    if found < LEAST_OVERLAP:
        yield f"of a light rope on a dark table it finds {found:.0%} (intersection over union)"


def overlap(mask: BoolArray, truth: BoolArray) -> float:
    """Intersection over union of two masks."""
    union = np.count_nonzero(mask | truth)
    return float(np.count_nonzero(mask & truth) / union) if union else 1.0


def _nothing(build: Build) -> Iterator[str]:
    image, _ = picture(rope=False)
    fraction = float(build().mask(image).pixels.mean())
    if fraction > MOST_OF_NOTHING:
        yield f"in a picture without a DLO {fraction:.1%} of the pixels are in the mask"


def _pure(build: Build) -> Iterator[str]:
    segmentation, (image, _) = build(), picture()
    first = segmentation.mask(image).pixels
    segmentation.mask(picture(seed=1)[0])
    if not np.array_equal(segmentation.mask(image).pixels, first):
        yield "the same picture gives another mask after another picture: something is remembered"
    if not np.array_equal(build().mask(image).pixels, first):
        yield "the same picture gives another mask from another instance: something is random or shared"


def _untouched(build: Build) -> Iterator[str]:
    image, _ = picture()
    before = codec.encode(image)
    build().mask(image)
    if codec.encode(image) != before:
        yield "the picture is changed by the call"
    build().mask(codec.decode(before, Image))  # messages from the bus are read-only


LEAST_OVERLAP = 0.8
"""Least intersection over union on the picture of the checks."""
MOST_OF_NOTHING = 0.01
"""Largest fraction of an empty picture in the mask."""

BUILDS: Check[Build] = Check(
    name="builds", wanted="build() of the settings gives an object with mask(image)", run=_builds
)

SEGMENTATION_CHECKS: tuple[Check[Build], ...] = (
    Check(name="mask", wanted="a bool mask (height, width) of RGB and of grey pictures", run=_shape),
    Check(name="finds", wanted=f"at least {LEAST_OVERLAP:.0%} of a light rope on a dark table", run=_finds),
    Check(
        name="empty picture",
        wanted=f"at most {MOST_OF_NOTHING:.0%} of a picture without a DLO in the mask",
        run=_nothing,
    ),
    Check(name="pure", wanted="the same picture gives the same mask; keep nothing between calls", run=_pure),
    Check(
        name="arguments untouched", wanted="the picture stays as it is, and may be read-only: copy it", run=_untouched
    ),
)
"""The requirements on a segmentation; those on its settings are in `settings`."""


@dataclass(frozen=True, kw_only=True)
class SegmentationReport:
    """Result for a segmentation that passed every check."""

    name: str
    passed: tuple[str, ...]
    """Names of the checks."""
    overlap: float
    """Intersection over union on the picture of the checks."""
    picture_p50_s: float
    """Half of the pictures took less processor time [s]; 320 by 240 pixels."""

    def __str__(self) -> str:
        return (
            f"{self.name}: {len(self.passed)} checks passed; finds {self.overlap:.0%} of the rope; a picture of "
            f"{WIDTH_PX} x {HEIGHT_PX} pixels takes {self.picture_p50_s * 1e3:.1f} ms (p50)"
        )


def check_segmentation(
    segmentation: SegmentationConfig | type[SegmentationConfig], *, pictures: int = 10
) -> SegmentationReport:
    """Try every requirement of the segmentation protocol on built-in pictures.

    `segmentation` is a configuration class, checked with its defaults, or an instance of one; it need not be
    installed. `pictures` are timed for the report. Raises `CheckFailed`, which lists all findings.
    """
    kind = segmentation if isinstance(segmentation, type) else type(segmentation)
    found = findings(settings_checks("segmentation", dict(SEGMENTATIONS.installed())), kind)

    def build() -> Segmentation:
        return (segmentation() if isinstance(segmentation, type) else segmentation).build()

    cannot = findings((BUILDS,), build)
    found += cannot or findings(SEGMENTATION_CHECKS, build)
    require_none(f"segmentation {kind.__module__}:{kind.__qualname__}", found)
    return _report(kind.name, build, pictures)


def _report(name: str, build: Build, pictures: int) -> SegmentationReport:
    built, (image, truth) = build(), picture()
    mask = built.mask(image).pixels
    took_s: list[float] = []
    for seed in range(pictures):
        seen, _ = picture(seed=seed)
        begin = time.process_time()
        built.mask(seen)
        took_s.append(time.process_time() - begin)
    passed = (*settings_checks("segmentation", {}), BUILDS, *SEGMENTATION_CHECKS)
    return SegmentationReport(
        name=name,
        passed=tuple(check.name for check in passed),
        overlap=overlap(mask, truth),
        picture_p50_s=float(np.median(took_s)),
    )
