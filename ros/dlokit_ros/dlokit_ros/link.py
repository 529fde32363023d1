"""The link to dlokit: its frames, its socket, and the stop. It uses Python's standard library only.

A frame is two unsigned 32-bit numbers, little-endian: the sizes of header and payload; then the header, a JSON object
in UTF-8 with a `kind`; then the payload, the CDR bytes of one ROS message, or nothing. `dlokit.extras.ros2.frames` is
dlokit's implementation of the same.
"""

import collections
import contextlib
import json
import os
import socket
import stat
import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, BinaryIO

VERSION = 1  # of the link; both sides must have the same
MOST_HEADER, MOST_PAYLOAD = 2**20, 2**26  # [bytes]
MOST_WAITING = 2**26  # payload that may wait to be sent [bytes]
SILENT_S = 3.0  # a peer that is silent for so long counts as dead
STOP_WITHIN_S = 5.0  # for all robot processes together
LONGEST_FOLDER = 107 - 60  # a socket's path has at most 107 bytes on Linux, of which dlokit reserves 60 for its name
_SIZES = struct.Struct("<II")
_FIELDS = {
    "welcome": {"version": int, "dlokit": str},
    "refused": {"why": str},
    "beat": {"real_ns": int, "monotonic_ns": int},
    "advertise": {"topic": str, "type": str, "transient_local": bool, "depth": int},
    "subscribe": {"topic": str, "type": str, "depth": int},
    "publish": {"topic": str},
}
_DEFAULTS = {"advertise": {"depth": 1}, "subscribe": {"depth": 10}}


class LinkError(Exception):
    """The link cannot be used: a refusal, a damaged frame, or a folder of another user."""


def encode(header: dict[str, Any], payload: bytes = b"") -> bytes:
    """The bytes of a frame. Raises `LinkError` when it is too large."""
    encoded = json.dumps(header, separators=(",", ":")).encode()
    _check(len(encoded), len(payload))
    return b"".join((_SIZES.pack(len(encoded), len(payload)), encoded, payload))


def read(stream: BinaryIO) -> tuple[dict[str, Any], bytes]:
    """Wait for the next frame of dlokit. Raises `LinkError` for a bad one, `EOFError` when the link was closed."""
    sizes = _SIZES.unpack(_read_exactly(stream, _SIZES.size))
    _check(*sizes)
    text, payload = _read_exactly(stream, sizes[0]), _read_exactly(stream, sizes[1])
    try:
        header = json.loads(text.decode())
        kind, fields = header["kind"], _FIELDS[header["kind"]]
        header = {**_DEFAULTS.get(kind, {}), **header}
        if flaws := [name for name, type_ in fields.items() if type(header[name]) is not type_]:
            raise ValueError(f"{' and '.join(flaws)} of {kind!r} has another type")
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        raise LinkError(f"a frame's header cannot be read: {error!r}") from error
    return header, payload


def _check(header: int, payload: int) -> None:
    if not 0 < header <= MOST_HEADER or payload > MOST_PAYLOAD:
        allowed = f"allowed are {MOST_HEADER} and {MOST_PAYLOAD}"
        raise LinkError(f"a frame has {header} bytes of header and {payload} of payload; {allowed}")


def _read_exactly(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise EOFError("dlokit has closed the link")
    return data


class Outbox:
    """Frames that wait to be sent, so that ROS never waits for dlokit."""

    def __init__(self, most_waiting: int = MOST_WAITING) -> None:
        """Above `most_waiting` bytes of payload, the oldest messages are dropped."""
        self.dropped = 0  # messages: dlokit reads too slowly, or they are too large
        self._most, self._waiting = most_waiting, 0
        self._frames: collections.deque[tuple[bytes, int]] = collections.deque()  # with the size of the payload
        self._changed = threading.Condition()

    def put(self, header: dict[str, Any], payload: bytes = b"") -> None:
        """Append a frame."""
        try:
            frame = encode(header, payload)
        except LinkError:
            self.dropped += 1
            return
        with self._changed:
            self._frames.append((frame, len(payload)))
            self._waiting += len(payload)
            while self._waiting > self._most:
                oldest = next(index for index, (_, size) in enumerate(self._frames) if size)
                self._waiting -= self._frames[oldest][1]
                del self._frames[oldest]
                self.dropped += 1
            self._changed.notify()

    def send_to(self, link: socket.socket) -> None:
        """Send frames until the outbox or the link is closed; close the link."""
        with contextlib.suppress(OSError):
            while frame := self._next():
                link.sendall(frame)
        shut(link)

    def close(self) -> None:
        """End `send_to`."""
        with self._changed:
            self._frames.append((b"", 0))
            self._changed.notify()

    def _next(self) -> bytes:
        with self._changed:
            self._changed.wait_for(lambda: self._frames)
            frame, size = self._frames.popleft()
            self._waiting -= size
            return frame


def shut(link: socket.socket) -> None:
    """Wake the threads that wait for a link."""
    with contextlib.suppress(OSError):
        link.shutdown(socket.SHUT_RDWR)


def runtime_folder(chosen: str = "") -> Path:
    """dlokit's folder of sockets: `chosen`, or the place where dlokit would make it; it may not exist yet.

    Raises `LinkError` where other users may enter it.
    """
    chosen = chosen or os.environ.get("DLOKIT_RUNTIME_DIR", "")
    folder = Path(chosen).absolute() if chosen else Path(f"/tmp/dlokit-{os.getuid()}")
    if len(os.fsencode(folder)) > LONGEST_FOLDER:
        raise LinkError("the path of the runtime folder is too long for a socket: set DLOKIT_RUNTIME_DIR to another")
    with contextlib.suppress(FileNotFoundError):
        facts = folder.lstat()
        if not stat.S_ISDIR(facts.st_mode) or facts.st_uid != os.getuid() or facts.st_mode & 0o077:
            raise LinkError(f"{folder} must be a folder of user {os.getuid()} with mode 700: start both as one user")
    return folder


def press_stop(folder: Path, within_s: float = STOP_WITHIN_S) -> tuple[bool, str]:
    """Stop every arm of dlokit in parallel: whether all confirm that they stand, and their answers.

    Each robot process answers at a socket of its own: no other process of dlokit is needed.
    """
    sockets = sorted(folder.glob("*.stop"))
    with ThreadPoolExecutor(max(len(sockets), 1)) as pool:
        answers = [answer for answer in pool.map(lambda path: _press(path, within_s), sockets) if answer is not None]
    if not answers:
        return False, f"no robot process of dlokit runs: none answers at a stop socket in {folder}"
    return all(confirmed for confirmed, _ in answers), "; ".join(text for _, text in answers)


def _press(path: Path, within_s: float) -> tuple[bool, str] | None:
    """The answer of a robot process; None if none listens: a killed one has left its socket."""
    arm = path.stem.partition("-")[2]
    try:
        with socket.socket(socket.AF_UNIX) as link, link.makefile("rb") as stream:
            link.settimeout(within_s / 2)  # half of it to connect
            link.connect(str(path))
            link.sendall(b"stop\n")
            answer = json.loads(stream.readline(MOST_HEADER))
            return answer["confirmed"] is True, f"{arm}: {answer['text']}"
    except (FileNotFoundError, ConnectionRefusedError):
        return None
    except (OSError, ValueError, LookupError, TypeError) as error:
        return False, f"{arm}: NOT confirmed, press the arm's emergency stop ({error!r})"
