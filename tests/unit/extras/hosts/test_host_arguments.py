"""Arguments of `dlokit host` and `dlokit certs`."""

from pathlib import Path

import pytest

from dlokit.app.commands import execute, parse
from dlokit.errors import ConfigError, InputError
from dlokit.extras.hosts.host import HostArgs, hosts_of
from dlokit.extras.hosts.section import HostsSection
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import to_toml

RUNS = {"brain": ("decision", "cell"), "arm": ("robot",)}


def args(*words: str) -> HostArgs:
    parsed = parse(("host", *words))
    assert isinstance(parsed, HostArgs)
    return parsed


@pytest.fixture
def file(tmp_path: Path) -> str:
    hosts = HostsSection(endpoint="tls/10.0.0.1:7447", certificates="lab", runs=RUNS)
    path = tmp_path / "lab.toml"
    path.write_text(to_toml(RunConfig(hosts=hosts)), encoding="utf-8")
    return str(path)


def test_a_host_is_configured_by_a_file_or_by_options_which_override_it(file: str) -> None:
    hosts, main = hosts_of(args("arm", "--config", file))
    assert (hosts.endpoint, hosts.certificates, main) == ("tls/10.0.0.1:7447", "lab", "brain")
    hosts, main = hosts_of(args("arm", "--config", file, "--connect", "tls/10.0.0.2:1", "--certificates", "here"))
    assert (hosts.endpoint, hosts.certificates, main) == ("tls/10.0.0.2:1", "here", "brain")
    hosts, main = hosts_of(args("arm", "--connect", "tls/10.0.0.2:1", "--certificates", "here"))
    assert (hosts.endpoint, hosts.certificates, main) == ("tls/10.0.0.2:1", "here", "decision")


def test_a_host_without_a_place_to_connect_or_that_the_file_does_not_know_is_refused(file: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="endpoint is missing"):
        hosts_of(args("arm"))
    with pytest.raises(ConfigError, match="has no host 'army'; it has brain, arm"):
        hosts_of(args("army", "--config", file))
    with pytest.raises(ConfigError, match="has no folder `certificates`"):
        hosts_of(args("arm", "--connect", "tls/10.0.0.2:1"))
    with pytest.raises(ConfigError, match="brain is the host of the decision process"):
        execute(("host", "brain", "--config", file))
    with pytest.raises(ConfigError, match=r"arm\.key of host 'arm' is missing|ca\.pem of host 'arm' is missing"):
        execute(("host", "arm", "--connect", "tls/10.0.0.2:1", "--certificates", str(tmp_path)))
    (tmp_path / "alone.toml").write_text(to_toml(RunConfig()), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"has no section \[hosts\]"):
        hosts_of(args("arm", "--config", str(tmp_path / "alone.toml")))


def test_unencrypted_connections_need_a_password(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="not encrypted"):
        hosts_of(args("arm", "--connect", "tcp/10.0.0.2:1"))
    hosts = HostsSection(endpoint="tcp/10.0.0.1:7447", password_file="lab.password", runs=RUNS)
    (tmp_path / "plain.toml").write_text(to_toml(RunConfig(hosts=hosts)), encoding="utf-8")
    assert hosts_of(args("arm", "--config", str(tmp_path / "plain.toml")))[0].password_file == "lab.password"


def test_certificates_are_made_and_the_files_to_copy_are_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "lab"
    assert execute(("certs", str(folder), "--hosts", "brain=10.0.0.1", "arm,desk")) == 0
    said = capsys.readouterr().out
    assert f"copy to host arm: {folder}/ca.pem {folder}/arm.pem {folder}/arm.key" in said
    assert "nothing to do" not in said
    assert execute(("certs", str(folder), "--hosts", "arm")) == 0
    assert "nothing to do, all files exist" in capsys.readouterr().out
    with pytest.raises(InputError, match="cannot be used"):
        execute(("certs", str(folder / "ca.pem"), "--hosts", "arm"))
