"""The journal of a run's task, in its folder."""

import logging
from pathlib import Path

from dlokit.communication.wire import codec
from dlokit.decision.journal import Journal
from dlokit.errors import CommunicationError, InputError

NAME = "journal.msgpack"

log = logging.getLogger(__name__)


class JournalFile:
    """Keeps the newest journal of a run; a crash leaves it whole."""

    def __init__(self, run_dir: Path) -> None:
        self._path = run_dir / NAME

    def keep(self, journal: Journal) -> None:
        """Replace the file. A disk that is full does not end the task; it only cannot be resumed from here."""
        part = self._path.with_suffix(".part")
        try:
            part.write_bytes(codec.encode(journal))
            part.replace(self._path)
        except OSError as error:
            log.warning("the journal cannot be written: %s", error)


def read_journal(run_dir: Path) -> Journal:
    """What was kept last. Raises `InputError` when there is nothing, or nothing that this version understands."""
    path = run_dir / NAME
    try:
        return codec.decode(path.read_bytes(), Journal)
    except OSError:
        raise InputError(
            f"{run_dir} holds no {NAME}: it is no live run, or its goal was not set yet; start it anew with "
            f"dlokit shape --config {run_dir / 'config.toml'}"
        ) from None
    except CommunicationError as error:
        raise InputError(
            f"{path} cannot be understood ({error}): it is another version's; start the run anew."
        ) from error
