"""Where libraries keep compiled code and lists of fonts; `import dlokit` chooses it before they are loaded."""

import os
import stat
from collections.abc import MutableMapping
from importlib.util import find_spec

_SOURCES = os.path.dirname(__file__)


def prepare_libraries(environ: MutableMapping[str, str] = os.environ) -> None:
    """Set the variables without which a library fails on this machine; the user's values that work are kept.

    Where the user's cache folder cannot be written, a private temporary one takes its place: Numba, Matplotlib and Mesa
    ask for ``XDG_CACHE_HOME``. A notebook's backend that is not installed here keeps Matplotlib from loading.
    """
    if not _may_write(_user_cache(environ)) and (private := _private_folder()):
        environ["XDG_CACHE_HOME"] = private
        environ.setdefault("MPLCONFIGDIR", os.path.join(private, "matplotlib"))
    module, _, backend = environ.get("MPLBACKEND", "").partition("://")
    if module == "module" and find_spec(backend.partition(".")[0]) is None:
        environ["MPLBACKEND"] = "agg"


def compiled_code_folder(environ: MutableMapping[str, str] = os.environ, sources: str = _SOURCES) -> str:
    """The folder in which Numba keeps compiled code; `sources` stands for the folders beside the modules.

    Raises `MachineError` where there is none.
    """
    chosen = environ.get("NUMBA_CACHE_DIR")
    folders = [*([os.path.abspath(chosen)] if chosen else []), sources, os.path.join(_user_cache(environ), "numba")]
    for folder in filter(_may_write, folders):  # in Numba's order
        return folder
    from dlokit.errors import MachineError  # `import dlokit` loads nothing that it does not need

    tried = ", ".join(folders)
    raise MachineError(
        f"There is no folder for compiled code: none of {tried} can be written. Set NUMBA_CACHE_DIR to one that can."
    )


def _user_cache(environ: MutableMapping[str, str]) -> str:
    return environ.get("XDG_CACHE_HOME") or os.path.join(environ.get("HOME") or os.path.expanduser("~"), ".cache")


def _may_write(folder: str) -> bool:
    """Whether files can be written in a folder, which may have to be created first."""
    if not os.path.isabs(folder):  # "~" of a user without a home
        return False
    while not os.path.lexists(folder):
        folder = os.path.dirname(folder)
    return os.path.isdir(folder) and os.access(folder, os.W_OK | os.X_OK)


def _private_folder() -> str | None:
    """A folder for this user alone in the folder for temporary files; None where another user has taken its name."""
    import tempfile  # seldom needed

    try:
        folder = os.path.join(tempfile.gettempdir(), f"dlokit-cache-{os.getuid()}")
        os.makedirs(folder, mode=0o700, exist_ok=True)
        found = os.lstat(folder)
    except OSError:
        return None
    # Compiled code is executed: nobody else may put any there.
    private = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
    return folder if private else None
