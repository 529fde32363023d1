"""Random damage to the bytes of a message, accidental or malicious."""

from collections.abc import Callable
from random import Random

Mutation = Callable[[bytearray, Random], bytearray]

_LENGTHS = (
    *(bytes((code,)) + b"\xff" * 4 for code in (0xC6, 0xC9, 0xDB, 0xDD, 0xDF)),  # announces 4 GiB
    *(bytes((code,)) + b"\xff" * 2 for code in (0xC5, 0xC8, 0xDA, 0xDC, 0xDE)),
    b"\xc9\x00\x00\x00\x10\x01",  # an array's extension
)
"""Headers of msgpack that announce more than follows."""


def mutated(data: bytes, rng: Random) -> bytes:
    """The message with one to three kinds of damage."""
    damaged = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        damaged = rng.choice(_MUTATIONS)(damaged, rng)
    return bytes(damaged)


def _flip(data: bytearray, rng: Random) -> bytearray:
    if data:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return data


def _overwrite(data: bytearray, rng: Random) -> bytearray:
    if data:
        data[rng.randrange(len(data))] = rng.randrange(256)
    return data


def _cut(data: bytearray, rng: Random) -> bytearray:
    return data[: rng.randrange(len(data) + 1)]


def _insert(data: bytearray, rng: Random) -> bytearray:
    at = rng.randrange(len(data) + 1)
    data[at:at] = rng.randbytes(rng.randint(1, 8))
    return data


def _repeat(data: bytearray, rng: Random) -> bytearray:
    begin = rng.randrange(len(data) + 1)
    part = bytes(data[begin : begin + rng.randint(1, 64)])
    at = rng.randrange(len(data) + 1)
    data[at:at] = part * rng.randint(1, 16)
    return data


def _remove(data: bytearray, rng: Random) -> bytearray:
    begin = rng.randrange(len(data) + 1)
    del data[begin : begin + rng.randint(1, 16)]
    return data


def _promise(data: bytearray, rng: Random) -> bytearray:
    at = rng.randrange(len(data) + 1)
    head = rng.choice(_LENGTHS)
    data[at : at + rng.choice((0, len(head)))] = head
    return data


def _nest(data: bytearray, rng: Random) -> bytearray:
    at = rng.randrange(len(data) + 1)
    data[at:at] = rng.choice((b"\x91", b"\x81\xa0", b"\x92")) * rng.choice((3, 40, 3000))
    return data


def _number(data: bytearray, rng: Random) -> bytearray:
    at = rng.randrange(len(data) + 1)
    size = rng.choice((1, 2, 4, 8))
    data[at : at + size] = rng.choice((b"\x00", b"\x7f", b"\x80", b"\xff")) * size
    return data


_MUTATIONS: tuple[Mutation, ...] = (_flip, _overwrite, _cut, _insert, _repeat, _remove, _promise, _nest, _number)
