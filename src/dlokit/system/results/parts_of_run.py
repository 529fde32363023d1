"""What a run was made with: arm, camera, DLO, planner, observer, and the settings that were changed."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, cast

from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import KIND, to_plain


def parts_of_run(config: RunConfig) -> dict[str, str]:
    """The parts that a run was made with, by what they are. Raises as `RunConfig.mounts`."""
    models = [mount.model.title for mount in config.mounts]
    moved = "" if config.driver.name == "simulated" and not config.dry_run else f", driver {config.driver.name}"
    where = " (dry run: no arm moves)" if config.dry_run else " (twin run)" if config.mirrors_arm else ""
    dlo, believed = config.cell.dlo, config.model
    size = f"{believed.length_m:.3g} m long, {2000.0 * believed.radius_m:.3g} mm thick"
    name = f"{dlo.name.replace('_', ' ')}, " if config.camera.sees_cell else ""
    parts = {
        "arm": " and ".join(models) + moved + where,
        "camera": config.camera.name,
        "segmentation": config.perception.segmentation.name,
        "DLO": f"{name}{size}",
        "planner": config.planning.strategy.name,
        "observer": config.observer.strategy.name,
        "runtime": config.runtime,
    }
    if config.installation.fixtures:
        parts["fixtures"] = ", ".join(fixture.name for fixture in config.installation.fixtures)
    return parts


def changed_settings(config: RunConfig) -> dict[str, str]:
    """The settings that differ from their defaults, as text, by their path in `config.toml`.

    Of another strategy than the default, its name, and what differs from its own defaults.
    """
    return dict(_changed(config, RunConfig(), to_plain(config), ""))


def setting_text(config: RunConfig, path: str) -> str | None:
    """The setting at a path of `config.toml` as text, of a strategy its name; None where there is none."""
    value: Any = to_plain(config)
    for name in path.split("."):
        value = value.get(name) if isinstance(value, dict) else None
    return None if value is None else _text(value[KIND] if isinstance(value, dict) else value)


def _changed(value: Any, usual: Any, plain: Mapping[str, Any], where: str) -> Iterator[tuple[str, str]]:
    for name, written in plain.items():
        path = f"{where}{name}"
        if name == KIND:
            continue
        item, default = getattr(value, name), getattr(usual, name, None)
        if item == default and type(item) is type(default):
            continue
        if isinstance(written, dict):
            table = cast(dict[str, Any], written)
            if type(item) is not type(default):
                yield path, str(table.get(KIND, ""))
                default = _by_default(type(item))
            yield from _changed(item, default, table, f"{path}.")
        else:
            yield path, _text(written)


def _by_default(wanted: type[Any]) -> Any:
    """An object with all its defaults; None if it has a setting without one."""
    required = [
        field
        for field in dataclasses.fields(wanted)
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]
    return None if required else wanted()


def _text(plain: Any) -> str:
    if isinstance(plain, bool):
        return "yes" if plain else "no"
    if isinstance(plain, float):
        return f"{plain:.6g}"
    if isinstance(plain, list):
        items = cast(list[Any], plain)
        return ("; " if any(isinstance(item, dict) for item in items) else ", ").join(map(_text, items)) or "none"
    if isinstance(plain, dict):  # one of several tables, e.g. a fixture
        table = cast(dict[str, Any], plain)
        return ", ".join(f"{name} {_text(value)}" for name, value in table.items() if value not in ("", []))
    return str(plain)
