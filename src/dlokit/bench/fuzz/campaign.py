"""Damaged messages, one after the other through the decoders, and what became of them."""

import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random

from dlokit.bench.fuzz.decoders import Decoder
from dlokit.bench.fuzz.mutations import mutated
from dlokit.communication.wire.codec import LARGEST_MESSAGE_BYTES
from dlokit.errors import CommunicationError

SOUND_EACH = 32
"""Sound messages of each decoder that are damaged again and again."""
ALLOWED_BYTES = 2 * LARGEST_MESSAGE_BYTES
ALLOWED_S = 5.0
"""Of the processor's time; a message that takes longer counts as a hang, one takes microseconds."""


@dataclass
class FuzzResult:
    """Counts of a campaign."""

    messages: int = 0
    refused: int = 0
    """With a `CommunicationError`; the others were understood, as damage to a number is."""
    slowest_s: float = 0.0
    """Of the processor's time."""
    largest_bytes: int = 0
    """Most memory that decoding one message asked for."""
    wrong: list[str] = field(default_factory=list[str])
    """Crashes, hangs, and memory beyond what is allowed: decoder, what, and the message in hexadecimal digits."""


def fuzz(
    decoders: list[Decoder], count: int, seed: int, told: Callable[[FuzzResult], None] = lambda result: None
) -> FuzzResult:
    """Damage and decode `count` messages, spread over the decoders; the same ones for the same seed."""
    rng = Random(seed)
    corpus = [[decoder.sound(rng) for _ in range(SOUND_EACH)] for decoder in decoders]
    result = FuzzResult()
    tracemalloc.start()
    try:
        for number in range(count):
            at = number % len(decoders)
            _decode(decoders[at], mutated(rng.choice(corpus[at]), rng), result)
            if number % 10_000 == 0:
                told(result)
    finally:
        tracemalloc.stop()
    return result


def _decode(decoder: Decoder, data: bytes, result: FuzzResult) -> None:
    tracemalloc.reset_peak()
    before_bytes, _ = tracemalloc.get_traced_memory()
    began_s = time.process_time()
    problem = ""
    try:
        decoder.decode(data)
    except CommunicationError:
        result.refused += 1
    except Exception as error:  # whatever else it is, it is what is looked for
        problem = f"{type(error).__name__}: {error}"
    seconds = time.process_time() - began_s
    asked_bytes = tracemalloc.get_traced_memory()[1] - before_bytes
    result.messages += 1
    result.slowest_s = max(result.slowest_s, seconds)
    result.largest_bytes = max(result.largest_bytes, asked_bytes)
    if seconds > ALLOWED_S:
        problem = problem or f"took {seconds:.1f} s"
    if asked_bytes > ALLOWED_BYTES:
        problem = problem or f"asked for {asked_bytes} bytes"
    if problem:
        result.wrong.append(f"{decoder.name}: {problem}: {data.hex()}")
