"""Which process runs on which host, and what each host may do on the others."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import pytest

from dlokit.communication.topics import CLOCK
from dlokit.communication.zenoh.access import HostRights
from dlokit.errors import ConfigError
from dlokit.extras.hosts.config import HostsConfig, lab_password
from dlokit.extras.hosts.placement import placed, rights_at_main
from dlokit.extras.hosts.section import HostsSection
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import from_toml, to_toml
from dlokit.system.table import TimeBase, processes_of_run

ROWS = processes_of_run(RunConfig(arms=2))
RUNS = {
    "brain": ("decision", "cell", "simulation", "observer"),
    "arms": ("robot", "second"),
    "eye": ("camera",),
    "desk": ("viewer",),
}


def hosts(runs: Mapping[str, tuple[str, ...]]) -> HostsSection:
    return HostsSection(endpoint="tls/10.0.0.1:7447", certificates="lab", runs=runs)


def rights() -> dict[str, HostRights]:
    return {each.host: each for each in rights_at_main(placed(hosts(RUNS), ROWS))}


def test_each_host_gets_its_rows_and_the_decision_process_comes_first() -> None:
    placement = placed(hosts(RUNS), ROWS)
    assert placement.main == "brain"
    assert [row.name for row in placement.own] == ["decision", "cell", "simulation", "observer"]
    assert {host: [row.name for row in share] for host, share in placement.others.items()} == {
        "arms": ["robot", "second"],
        "eye": ["camera"],
        "desk": ["viewer"],
    }


def test_a_process_that_a_run_does_not_need_may_be_placed() -> None:
    placement = placed(hosts(RUNS), processes_of_run(RunConfig(headless=True)))
    assert placement.others["desk"] == ()
    assert [row.name for row in placement.others["arms"]] == ["robot"]


WITHOUT_CELL = processes_of_run(RunConfig(dry_run=True, camera=RecordedCameraConfig(path="pictures")))
AT_THE_DEVICES = {"desk": ("decision", "simulation", "viewer"), "lab": ("robot", "camera", "observer")}


def test_without_a_cell_the_host_with_the_devices_has_the_clock_and_all_others_follow_it() -> None:
    placement = placed(hosts(AT_THE_DEVICES), WITHOUT_CELL)

    assert placement.clock_elsewhere
    assert {row.name: row.time_base for row in (*placement.own, *placement.others["lab"])} == {
        "decision": TimeBase.CELL,
        "simulation": TimeBase.CELL,
        "viewer": TimeBase.CELL,
        "robot": TimeBase.SHARED,
        "camera": TimeBase.MACHINE,
        "observer": TimeBase.MACHINE,
    }
    (lab,) = rights_at_main(placement)
    assert CLOCK.name in lab.publishes


def test_a_main_host_with_the_devices_follows_its_own_clock_and_no_other_host_may_publish_one() -> None:
    runs = {"lab": ("decision", "robot", "camera", "simulation"), "desk": ("observer", "viewer")}
    placement = placed(hosts(runs), WITHOUT_CELL)

    assert not placement.clock_elsewhere
    assert placement.own[0].time_base is TimeBase.MACHINE
    assert {row.time_base for row in placement.others["desk"]} == {TimeBase.CELL}
    assert all(CLOCK.name not in each.publishes for each in rights_at_main(placement))
    assert not placed(hosts(RUNS), ROWS).clock_elsewhere  # the cell has it


def test_devices_on_two_hosts_have_two_clocks_and_are_refused() -> None:
    runs = AT_THE_DEVICES | {"lab": ("robot", "observer"), "eye": ("camera",)}
    with pytest.raises(ConfigError, match="places robot on lab, camera on eye: without a simulated cell they must run"):
        placed(hosts(runs), WITHOUT_CELL)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"desk": ()}, "places viewer on no host"),
        ({"desk": ("viewer", "camera")}, "places camera on eye and on desk"),
        ({"desk": ("viewer", "brewer")}, "'brewer' on desk, which is not a process; use decision, cell"),
        ({"brain": RUNS["brain"][:1] + RUNS["brain"][2:], "eye": ("camera", "cell")}, "the simulated cell on eye"),
        ({"Desk 1": ()}, "'Desk 1' is not a valid host name"),
    ],
)
def test_an_invalid_placement_is_named(change: dict[str, tuple[str, ...]], said: str) -> None:
    with pytest.raises(Exception, match=said):
        placed(hosts(RUNS | change), ROWS)


@pytest.mark.parametrize(
    ("configured", "said"),
    [
        (partial(HostsConfig, endpoint="10.0.0.1"), "not a valid endpoint"),
        (partial(HostsConfig, endpoint="tls/10.0.0.1:7447"), "has no folder `certificates`"),
        (partial(HostsConfig, endpoint="tcp/10.0.0.1:7447"), "not encrypted"),
        (partial(HostsConfig, endpoint="tcp/10.0.0.1:7447", password_file="lab", wait_s=0.0), "wait_s"),
    ],
)
def test_an_open_endpoint_or_one_without_certificates_is_refused(
    configured: Callable[[], HostsConfig], said: str
) -> None:
    with pytest.raises(ConfigError, match=said):
        configured()


def test_a_host_publishes_the_topics_of_its_components_and_no_others() -> None:
    first, second = ("robot/state", "robot/protection"), ("robot/state/second", "robot/protection/second")
    assert rights()["arms"].publishes == (*first, *second)
    assert rights()["desk"].publishes == ("viewer/command", "viewer/frames", "viewer/page")
    assert "decision/heartbeat" not in {topic for each in rights().values() for topic in each.publishes}


def test_no_other_host_may_call_more_of_a_robot_than_to_stop_it() -> None:
    for each in rights().values():
        of_robots = {call for call in each.calls if call.startswith("robot")}
        assert of_robots == {"robot/stop", "robot.second/stop"}
        assert not each.trusted


def test_every_host_may_do_what_dlokit_stop_does() -> None:
    for each in rights().values():
        assert {"robot/stop", "robot.second/stop", "decision/stop_task"} <= set(each.calls)


def test_a_host_may_call_of_the_cell_only_what_its_own_drivers_do() -> None:
    of_the_cell = {
        host: {call.removeprefix("cell/") for call in each.calls if call.startswith("cell")}
        for host, each in rights().items()
    }
    assert of_the_cell == {
        "arms": {"follow", "renew", "grip", "brake", "stop", "enable", "recover"},
        "eye": {"capture", "capture_depth"},
        "desk": set(),
    }


def test_hosts_are_read_from_a_file_and_written_again() -> None:
    run = RunConfig(hosts=hosts(RUNS))
    assert from_toml(to_toml(run), RunConfig, "it") == run


def test_the_password_of_hosts_without_tls_is_read_from_a_file_of_its_owner_only(tmp_path: Path) -> None:
    file = tmp_path / "lab.password"
    lab = HostsConfig(endpoint="tcp/10.0.0.1:7447", password_file=str(file), runs=RUNS)
    with pytest.raises(ConfigError, match="cannot be read"):
        lab_password(lab)
    file.write_text("a long random password\n")
    file.chmod(0o644)
    with pytest.raises(ConfigError, match="others may read it"):
        lab_password(lab)
    file.chmod(0o600)
    password = lab_password(lab)
    file.write_text("a long random password")
    assert lab_password(lab) == password  # without the end of the line
    file.write_text("short")
    with pytest.raises(ConfigError, match="at least 16"):
        lab_password(lab)
