"""dlokit: bring cables, ropes and wires into the shape you want with a robot and a camera.

    run = dlokit.shape(start="I", goal="S")          # one task in the simulated cell
    tracker = dlokit.Tracker(length_m=0.5)           # nodes of a DLO in your own point clouds
    recording = dlokit.open_run("runs/…")            # what a run recorded, as arrays
    with dlokit.live(start="I") as system:           # a live system, skill by skill
        system.perception.look()

The names in `__all__` are the public Python API, under semantic versioning; everything else may change.
"""

from importlib import import_module
from typing import Any

from dlokit.cache_folder import prepare_libraries

prepare_libraries()

_HOMES = {
    "DlokitError": "dlokit.errors",
    "InputError": "dlokit.errors",
    "Identified": "dlokit.extras.identification.identify",
    "Nodes": "dlokit.app.library.tracker",
    "Recording": "dlokit.app.library.recording",
    "Run": "dlokit.app.library.run",
    "Tracker": "dlokit.app.library.tracker",
    "identify": "dlokit.extras.identification.identify",
    "points_from_depth": "dlokit.app.library.tracker",
    "SkillFailure": "dlokit.errors",
    "SkillRejected": "dlokit.errors",
    "System": "dlokit.app.library.live",
    "judge": "dlokit.app.library.shape",
    "live": "dlokit.app.library.live",
    "open_run": "dlokit.app.library.recording",
    "shape": "dlokit.app.library.shape",
}
"""Modules of the public names, imported at first use. `__init__.pyi` has their types."""

__all__ = ["__version__", "bench", *_HOMES]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        # Looked up on access: the import takes as long as NumPy's, and every process would wait for it.
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("dlokit")
        except PackageNotFoundError:  # the sources are on the path, and no package is installed
            return "unknown"
    if name == "bench" or name in _HOMES:
        try:
            return import_module("dlokit.bench") if name == "bench" else getattr(import_module(_HOMES[name]), name)
        except ModuleNotFoundError as error:
            from dlokit.errors import missing_extra

            if (lacking := missing_extra(error, f"dlokit.{name}")) is None:
                raise
            raise lacking from error
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
