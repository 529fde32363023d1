"""The journal of a run's task, stored in the run's folder."""

from pathlib import Path

from dlokit.communication.wire import codec
from dlokit.decision.journal import Journal
from dlokit.errors import CommunicationError, InputError
from dlokit.recording.disk import Disk, write_synced

NAME = "journal.msgpack"


class JournalFile:
    """Stores the latest journal of a run; a crash or power loss leaves the file intact."""

    def __init__(self, run_dir: Path, disk: Disk) -> None:
        self._path = run_dir / NAME
        self._disk = disk

    def keep(self, journal: Journal) -> None:
        """Replace the file soon. A full disk does not end the task, which then cannot be resumed from here."""
        self._disk.put(NAME, lambda: write_synced(self._path, codec.encode(journal)))


def read_journal(run_dir: Path) -> Journal:
    """The latest journal. Raises `InputError` when there is none, or none that this version can read."""
    path = run_dir / NAME
    try:
        return codec.decode(path.read_bytes(), Journal)
    except OSError:
        raise InputError(
            f"{run_dir} has no {NAME}: it is not a live run, or its goal was not set yet; start it again with "
            f"dlokit shape --config {run_dir / 'config.toml'}"
        ) from None
    except CommunicationError as error:
        raise InputError(f"{path} cannot be read ({error}): it is of another version; start the run again.") from error
