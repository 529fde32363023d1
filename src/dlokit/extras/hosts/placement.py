"""Assigns processes to hosts, and defines the rights of each host."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from dlokit.communication.skill import Skill
from dlokit.communication.topic import Topic
from dlokit.communication.topics import CLOCK, all_topics
from dlokit.communication.zenoh.access import HostRights
from dlokit.decision.api import STOP_TASK
from dlokit.description.arm.mounts import INSTANCES
from dlokit.errors import ConfigError
from dlokit.extras.hosts.config import HostsConfig
from dlokit.functional.cell import api as cell
from dlokit.skills.robot import api as robot
from dlokit.system.table import CAMERA, CELL, DECISION, ROBOT, SECOND, ProcessRow, TimeBase, process_table

AGENT = "host"
"""Component through which the main host starts processes on another host: `host.NAME`."""
_ARM = (cell.FOLLOW, cell.RENEW, cell.GRIP, cell.BRAKE, cell.STOP, cell.ENABLE, cell.RECOVER)
DRIVEN: Mapping[str, tuple[Skill[..., Any], ...]] = {
    ROBOT.name: _ARM,
    SECOND.name: _ARM,
    CAMERA.name: (cell.CAPTURE, cell.CAPTURE_DEPTH),
}
"""The cell's skills that a process calls, as its device."""


@dataclass(frozen=True, kw_only=True)
class Placement:
    """The process rows of a run by host."""

    main: str
    """Host of the decision process, to which the other hosts connect."""
    own: tuple[ProcessRow, ...]
    """Its rows, the decision process first."""
    others: Mapping[str, tuple[ProcessRow, ...]]
    """Rows of each other host; empty for a host that only observes."""

    @property
    def clock_elsewhere(self) -> bool:
        """Whether the main host follows the clock of another, with arm and camera, in a run without a cell."""
        return self.own[0].time_base is TimeBase.CELL and all(row.name != CELL.name for row in self.own)


def placed(hosts: HostsConfig, rows: tuple[ProcessRow, ...]) -> Placement:
    """Assign the rows of a run; the first row is the decision process. Raises `ConfigError`.

    Without a cell, all machines follow the clock of the machine with arm and camera: its drivers stamp by it.
    """
    where = _host_by_process(hosts)
    nowhere = [row.name for row in rows if row.name not in where]
    if nowhere:
        raise ConfigError(f"[hosts.runs] places {', '.join(nowhere)} on no host: add each to the list of one host.")
    main = where[rows[0].name]
    if where.get(CELL.name, main) != main:
        raise ConfigError(
            f"[hosts.runs] places the simulated cell on {where[CELL.name]}: it must run on {main}, where "
            f"{DECISION.name} runs and its ground truth is evaluated after the run."
        )
    if all(row.name != CELL.name for row in rows):
        rows = _by_clock_of_devices(rows, where)
    return Placement(
        main=main,
        own=tuple(row for row in rows if where[row.name] == main),
        others={host: tuple(row for row in rows if where[row.name] == host) for host in hosts.runs if host != main},
    )


def _by_clock_of_devices(rows: tuple[ProcessRow, ...], where: Mapping[str, str]) -> tuple[ProcessRow, ...]:
    """The rows, following the clock of the host with all devices. Raises `ConfigError` if two hosts have devices."""
    at = {row.name: where[row.name] for row in rows if row.name in DRIVEN}
    if len(set(at.values())) > 1:
        places = ", ".join(f"{name} on {host}" for name, host in at.items())
        raise ConfigError(
            f"[hosts.runs] places {places}: without a simulated cell they must run on one host, by whose clock "
            "pictures and states of the arm are stamped; name them in the list of one host."
        )

    def base(row: ProcessRow) -> TimeBase:
        if row.name == ROBOT.name:
            return TimeBase.SHARED
        return TimeBase.MACHINE if where[row.name] == at[ROBOT.name] else TimeBase.CELL

    return tuple(replace(row, time_base=base(row)) for row in rows)


def main_host(hosts: HostsConfig) -> str:
    """The host of the decision process. Raises `ConfigError` when no host has it."""
    where = _host_by_process(hosts)
    if DECISION.name not in where:
        raise ConfigError(f"[hosts.runs] places {DECISION.name} on no host: add it to the list of one host.")
    return where[DECISION.name]


def _host_by_process(hosts: HostsConfig) -> dict[str, str]:
    known = [row.name for row in process_table()]
    where: dict[str, str] = {}
    for host, names in hosts.runs.items():
        for name in names:
            if name not in known:
                raise ConfigError(
                    f"[hosts.runs] places {name!r} on {host}, which is not a process; use {', '.join(known)}."
                )
            if name in where:
                raise ConfigError(f"[hosts.runs] places {name} on {where[name]} and on {host}: name it once.")
            where[name] = host
    return where


def rights_at_main(placement: Placement) -> tuple[HostRights, ...]:
    """Rights of each other host: publish for its components, stop arm and task, call its devices in the cell.

    Only the main host may call anything else, in particular motions of the robot, and only it may send the heartbeats
    that keep the robot's lease.
    """
    stops = (*(robot.STOP.at(instance) for instance in INSTANCES), STOP_TASK)
    return tuple(
        HostRights(
            host=host,
            publishes=tuple(topic.name for topic in (*_topics_of(share), *_clock_of(share))),
            serves=(f"{AGENT}.{host}", *_components(share)),
            calls=_keys_of((*stops, *(skill for row in share for skill in DRIVEN.get(row.name, ())))),
        )
        for host, share in placement.others.items()
    )


def _keys_of(skills: Iterable[Skill[..., Any]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(f"{skill.component}/{skill.name}" for skill in skills))


def _components(share: tuple[ProcessRow, ...]) -> tuple[str, ...]:
    return tuple(component for row in share for component in row.components)


def _clock_of(share: tuple[ProcessRow, ...]) -> tuple[Topic[Any], ...]:
    return (CLOCK,) if any(row.time_base is TimeBase.SHARED for row in share) else ()


def _topics_of(share: tuple[ProcessRow, ...]) -> list[Topic[Any]]:
    found: list[Topic[Any]] = []
    for address in _components(share):
        kind, _, instance = address.partition(".")
        found += [topic.at(instance) for topic in all_topics() if topic.publisher == kind]
    return found
