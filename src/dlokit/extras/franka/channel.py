"""Shared memory between the driver, the streaming process, the hand process and the guardian. Standard library only.

All processes map one file. Orders and heartbeats are single 64-bit words: each has one writer, or all writers write the
same value, so that no process needs a lock or waits. Values that belong together are in blocks with one writer each: a
sequence number that is odd while the block is written, and a check sum.

Heartbeats and leases are on ``CLOCK_MONOTONIC``, which all processes of a machine share.
"""

import enum
import mmap
import os
import stat
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

JOINTS = 7
MOST_SAMPLES = 48_000
"""Longest trajectory: 240 s of samples 5 ms apart, longer than any motion that the gate accepts."""
_MAGIC = 0x646C6F6B_00000001
_SHARED_FOLDER = Path("/dev/shm")
_TRIES = 50


class Word(enum.IntEnum):
    """The words, with the writer of each."""

    MAGIC = 0
    LATCH = enum.auto()  # `Latch`; set by any process, cleared by the driver at a person's request
    DRIVER_BEAT_NS = enum.auto()  # driver: the commander is alive
    LEASE_NS = enum.auto()  # driver: longest age of its heartbeat during a motion
    FOLLOW_ID = enum.auto()  # driver: number of the newest trajectory
    FOLLOW_SAMPLES = enum.auto()  # driver
    FOLLOW_SUM = enum.auto()  # driver: check sum of the trajectory
    BRAKE_ID = enum.auto()  # driver: brake every motion with this number or a smaller one
    RECOVER_ID = enum.auto()  # driver: number of the newest request to clear the arm's errors
    CLOSE = enum.auto()  # driver: all processes end
    STREAM_PID = enum.auto()  # driver: the process to kill; guardian: 0 after it has killed it
    STREAM_BEAT_NS = enum.auto()  # streaming process
    STREAM_SILENCE_NS = enum.auto()  # streaming process: the guardian kills it when silent for longer; 0: it does not
    STATE_NS = enum.auto()  # streaming process: when the newest state was read
    RECOVERED_ID = enum.auto()  # streaming process
    GUARD_BEAT_NS = enum.auto()  # guardian
    KILLS = enum.auto()  # guardian: number of streaming processes that it has killed
    HAND_BEAT_NS = enum.auto()  # hand process
    GRIP_ID = enum.auto()  # driver: number of the newest grip
    GRIP_KIND = enum.auto()  # driver: `GripKind`
    GRIP_WIDTH_UM = enum.auto()  # driver
    GRIP_FORCE_MN = enum.auto()  # driver
    HOLD_ID = enum.auto()  # driver: stop every grip with this number or a smaller one


class Latch(enum.IntEnum):
    """Why the arm waits for a person."""

    NONE = 0
    PERSON = 1
    COLLISION = 2
    USER_STOP = 3
    GUIDING = 4
    ARM_ERROR = 5


class StreamPhase(enum.IntEnum):
    """The activity of the streaming process."""

    CONNECTING = 0
    IDLE = 1
    MOVING = 2
    BRAKING = 3
    FAULT = 4
    """The arm reports errors; it needs `recover`."""
    LOST = 5
    """No connection; this process ends."""
    HOLDING = 6
    """The set-points of a motion are at rest; the arm settles there, then its own controller takes over."""


class MotionEnding(enum.IntEnum):
    """How a motion ended."""

    NONE = 0
    ARRIVED = 1
    BRAKED = 2
    """Braked at an order."""
    LEASE = 3
    """The driver's heartbeat was too old."""
    ARM = 4
    """The arm itself ended it: its errors name the cause."""
    TRACKING = 5
    """The arm was too far from its set-points."""
    UNGUARDED = 6
    """The guardian is silent."""
    REFUSED = 7
    """The arm was not ready to move."""
    DAMAGED = 8
    """The trajectory arrived damaged."""


class GripKind(enum.IntEnum):
    """The command to the hand."""

    MOVE = 0
    GRASP = 1
    HOME = 2


class StreamState(NamedTuple):
    """The state that the streaming process publishes."""

    read_ns: int
    """When the state was read [ns of the machine's monotonic clock]."""
    robot_ms: int
    """The arm's own clock [ms]."""
    phase: int
    motion_id: int
    """Number of the running or of the last motion."""
    ending: int
    """`MotionEnding` of the motion `motion_id`; NONE while it runs."""
    mode: int
    """ArmMode by libfranka's number."""
    errors: int
    """Bits of `reflexes.NAMES`, of the last motion that the arm ended."""
    turns: int
    """Turns of the loop in the motion."""
    largest_error_rad: float
    """Largest distance of a joint from its set-point in the motion [rad]."""
    mean_error_rad: float
    """Mean over the turns of that distance [rad]."""
    took_s: float
    """Duration of the motion on the arm's clock [s]."""
    q: tuple[float, ...]  # (7,) [rad]
    dq: tuple[float, ...]  # (7,) [rad/s]
    tau: tuple[float, ...]  # (7,) [N·m]
    wrench: tuple[float, ...]  # (6,) on the tool, in the base frame [N, N·m]
    T_base_tool: tuple[float, ...]  # (16,) row by row
    T_flange_tool: tuple[float, ...]  # (16,) row by row
    tool_kg: float
    load_kg: float


class HandState(NamedTuple):
    """The state that the hand process publishes."""

    read_ns: int
    grip_id: int
    """Number of the running or of the last grip."""
    running: int
    cancelled: int
    """Whether the last grip was stopped, by an order or a missing heartbeat."""
    width_m: float
    largest_width_m: float
    """0 before the hand was homed."""
    before_m: float
    """Width before the last grip [m]."""


_STATE = struct.Struct(f"=8q3d{3 * JOINTS + 6 + 32 + 2}d")
_HAND = struct.Struct("=4q3d")
_HEAD = struct.Struct("=QQ")  # sequence number, check sum
_WORD = struct.Struct("q")  # native: one store, as of a word
_TEXT_BYTES = 512
_STATE_AT = 512
_HAND_AT = 2048
_TEXT_AT = 2560
_TRAJECTORY_AT = 4096
_SAMPLE_BYTES = 8 * (1 + 2 * JOINTS)
SIZE = _TRAJECTORY_AT + MOST_SAMPLES * _SAMPLE_BYTES
assert 8 * len(Word) <= _STATE_AT
assert _STATE_AT + _HEAD.size + _STATE.size <= _HAND_AT
assert _HAND_AT + _HEAD.size + _HAND.size <= _TEXT_AT
assert _TEXT_AT + _HEAD.size + _TEXT_BYTES <= _TRAJECTORY_AT


class ChannelError(Exception):
    """The shared memory cannot be used; the text names the cause and the remedy."""


@dataclass(frozen=True)
class Samples:
    """A trajectory in the channel: doubles in the machine's byte order."""

    times: bytes  # (K,) [s]
    q: bytes  # (K, 7) [rad]
    dq: bytes  # (K, 7) [rad/s]


def path_of(address: str, folder: Path = _SHARED_FOLDER) -> Path:
    """The file of the arm at a network address; the same for every user and every run."""
    name = "".join(letter if letter.isalnum() else "-" for letter in address)
    return folder / f"dlokit-franka-{name}"


def write_urdf(path: Path, urdf: str) -> None:
    """Store the arm's own description beside the mapped file `path`, for the driver."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW
    with os.fdopen(os.open(f"{path}.urdf", flags, 0o600), "w", encoding="utf-8") as file:
        file.write(urdf)


def read_urdf(path: Path) -> str:
    """The arm's own description from the last connection; empty if it sent none."""
    try:
        return Path(f"{path}.urdf").read_text(encoding="utf-8")
    except FileNotFoundError:
        return ""


class Channel:
    """The mapped file. Methods never block, and take microseconds."""

    def __init__(self, path: Path) -> None:
        """Map the file, and create it if it is missing. Raises `ChannelError`."""
        self._map = mmap.mmap(self._opened(path), SIZE)
        self._words = memoryview(self._map)[: 8 * len(Word)].cast("q")
        if self[Word.MAGIC] == 0:
            self[Word.MAGIC] = _MAGIC
        if self[Word.MAGIC] != _MAGIC:
            raise ChannelError(f"{path} was made by another version of dlokit; end its processes and delete the file")

    def _opened(self, path: Path) -> int:
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
            found = os.fstat(self._file)
            if found.st_uid != os.getuid() or not stat.S_ISREG(found.st_mode):
                raise PermissionError("it belongs to another user")
            if found.st_size < SIZE:
                os.ftruncate(self._file, SIZE)
        except OSError as error:
            raise ChannelError(
                f"the shared memory {path} cannot be used: {error}; does another user of this computer drive this arm?"
            ) from error
        return self._file

    @property
    def file(self) -> int:
        """The file descriptor, for a lock on the whole arm."""
        return self._file

    def close(self) -> None:
        """Unmap; the file is kept, and with it a latched stop."""
        self._words.release()
        self._map.close()
        os.close(self._file)

    def __enter__(self) -> Self:
        """Return the channel itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Unmap."""
        self.close()

    def __getitem__(self, word: Word) -> int:
        """A word."""
        return self._words[word]

    def __setitem__(self, word: Word, value: int) -> None:
        """Set a word: one store of 8 bytes, seen whole or not at all."""
        self._words[word] = value

    def write_state(self, state: StreamState) -> None:
        """Publish a state; only the streaming process calls this."""
        self._write(
            _STATE_AT,
            _STATE.pack(
                *state[:11],
                *state.q,
                *state.dq,
                *state.tau,
                *state.wrench,
                *state.T_base_tool,
                *state.T_flange_tool,
                *state[-2:],
            ),
        )
        self[Word.STATE_NS] = state.read_ns

    def read_state(self) -> StreamState | None:
        """The newest state; None before the first one, or while its writer is frozen in the middle of one."""
        packed = self._read(_STATE_AT, _STATE.size)
        if packed is None:
            return None
        values = _STATE.unpack(packed)
        rows: list[tuple[float, ...]] = []
        at = 11
        for length in (JOINTS, JOINTS, JOINTS, 6, 16, 16):
            rows.append(values[at : at + length])
            at += length
        return StreamState(*values[:11], *rows, *values[at:])

    def write_hand(self, state: HandState) -> None:
        """Publish the hand's state; only the hand process calls this."""
        self._write(_HAND_AT, _HAND.pack(*state))

    def read_hand(self) -> HandState | None:
        """The newest state of the hand, as `read_state`."""
        packed = self._read(_HAND_AT, _HAND.size)
        return None if packed is None else HandState(*_HAND.unpack(packed))

    def write_text(self, text: str) -> None:
        """Store the text that explains why a process ends."""
        raw = text.encode("utf-8")[:_TEXT_BYTES]
        self._write(_TEXT_AT, raw.ljust(_TEXT_BYTES, b"\0"))

    def read_text(self) -> str:
        """The last text; empty without one."""
        raw = self._read(_TEXT_AT, _TEXT_BYTES)
        return "" if raw is None else raw.rstrip(b"\0").decode("utf-8", "replace")

    def post(self, samples: Samples, follow_id: int) -> None:
        """Write a trajectory; only the driver calls this, between motions. Raises `ChannelError` if it is too long."""
        count = len(samples.times) // 8
        if count > MOST_SAMPLES:
            raise ChannelError(f"{count} samples; at most {MOST_SAMPLES} fit: split the motion")
        packed = samples.times + samples.q + samples.dq
        self._map[_TRAJECTORY_AT : _TRAJECTORY_AT + len(packed)] = packed
        self[Word.FOLLOW_SAMPLES] = count
        self[Word.FOLLOW_SUM] = _sum(packed)
        self[Word.FOLLOW_ID] = follow_id

    def posted(self) -> Samples | None:
        """The trajectory; None if it is damaged."""
        count = self[Word.FOLLOW_SAMPLES]
        if not 0 < count <= MOST_SAMPLES:
            return None
        packed = self._map[_TRAJECTORY_AT : _TRAJECTORY_AT + count * _SAMPLE_BYTES]
        if _sum(packed) != self[Word.FOLLOW_SUM]:
            return None
        times, rows = 8 * count, 8 * count * JOINTS
        return Samples(times=packed[:times], q=packed[times : times + rows], dq=packed[times + rows :])

    def _write(self, at: int, payload: bytes) -> None:
        sequence = _WORD.unpack_from(self._map, at)[0] | 1
        _WORD.pack_into(self._map, at, sequence)
        self._map[at + _HEAD.size : at + _HEAD.size + len(payload)] = payload
        _WORD.pack_into(self._map, at + 8, _sum(payload))
        _WORD.pack_into(self._map, at, sequence + 1)

    def _read(self, at: int, size: int) -> bytes | None:
        for _ in range(_TRIES):
            before, check = _HEAD.unpack_from(self._map, at)
            payload = self._map[at + _HEAD.size : at + _HEAD.size + size]
            if before and not before & 1 and _HEAD.unpack_from(self._map, at)[0] == before and _sum(payload) == check:
                return payload
        return None


def _sum(payload: bytes) -> int:
    return zlib.crc32(payload)
