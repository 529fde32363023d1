"""The section `[hosts]` of a configuration file: of before it named its kind, and where its annexe is missing."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest

from dlokit.communication.strategies import NamedConfig, StrategyKind
from dlokit.errors import ConfigError
from dlokit.extras.hosts.section import HostsSection
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import from_toml, to_toml
from dlokit.system.job import with_absolute_files

HOSTS = HostsSection(endpoint="tls/10.0.0.1:7447", certificates="lab", runs={"main": ("decision",)})
WRITTEN = """
[hosts]
endpoint = "tls/10.0.0.1:7447"
certificates = "lab"
runs = { main = ["decision"] }
"""


def test_a_file_from_before_the_section_named_its_kind_is_read() -> None:
    assert from_toml(WRITTEN, RunConfig, "lab.toml").hosts == HOSTS


def test_the_section_is_written_and_read_again() -> None:
    run = RunConfig(hosts=HOSTS)
    assert from_toml(to_toml(run), RunConfig, "config.toml") == run


def test_its_folder_is_made_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    absolute = with_absolute_files(RunConfig(hosts=HOSTS)).hosts
    assert isinstance(absolute, HostsSection)
    assert absolute.certificates == str(tmp_path / "lab")


NONE: StrategyKind[NamedConfig] = StrategyKind("[hosts]", "dlokit.hosts_that_nobody_installed", ())


@dataclass(frozen=True)
class WithoutAnnexe:
    hosts: Annotated[NamedConfig | None, NONE] = None


def test_without_the_annexe_the_section_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"lab\.toml: hosts: no installed package has settings for \[hosts\]"):
        from_toml(WRITTEN, WithoutAnnexe, "lab.toml")
    assert from_toml("", WithoutAnnexe, "lab.toml") == WithoutAnnexe()
