"""Packages with entry points, as installed by pip, for tests."""

from pathlib import Path


def install(folder: Path, package: str, group: str, entries: dict[str, str], modules: dict[str, str]) -> None:
    """Write a package to a folder of the import path: its `modules` by name, its entry points by name."""
    info = folder / f"{package.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    lines = [f"{name} = {target}" for name, target in entries.items()]
    (info / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines, ""]))
    for name, source in modules.items():
        (folder / f"{name}.py").write_text(source)
