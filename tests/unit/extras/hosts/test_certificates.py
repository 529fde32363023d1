"""Keys and certificates of a lab: made once, kept, checked before they are used."""

import stat
from pathlib import Path

import pytest
from cryptography import x509

from dlokit.errors import ConfigError, InputError
from dlokit.extras.hosts.certificates import host_files, hosts_from_words, make_certificates
from dlokit.extras.hosts.config import LabHost


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_a_host_is_named_by_its_certificate_and_reached_at_its_addresses(tmp_path: Path) -> None:
    make_certificates(tmp_path, hosts_from_words(("decision=10.0.0.1,lab-pc.local", "robot,viewer")))
    names = certificate(tmp_path / "decision.pem").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["decision", "lab-pc.local"]
    assert [str(each) for each in names.get_values_for_type(x509.IPAddress)] == ["10.0.0.1"]
    for host in ("decision", "robot", "viewer"):
        certificate(tmp_path / f"{host}.pem").verify_directly_issued_by(certificate(tmp_path / "ca.pem"))
        assert host_files(tmp_path, host).key == str(tmp_path / f"{host}.key")


def test_keys_are_for_their_owner_alone(tmp_path: Path) -> None:
    make_certificates(tmp_path / "lab", [LabHost(name="robot")])
    assert stat.S_IMODE((tmp_path / "lab").stat().st_mode) == 0o700
    for name in ("ca.key", "robot.key"):
        assert stat.S_IMODE((tmp_path / "lab" / name).stat().st_mode) == 0o600


def test_a_second_time_adds_hosts_and_changes_nothing_else(tmp_path: Path) -> None:
    make_certificates(tmp_path, [LabHost(name="robot", addresses=("10.0.0.3",))])
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    done = make_certificates(tmp_path, hosts_from_words(("robot", "viewer")))
    assert len(done) == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name in before} == before
    host_files(tmp_path, "viewer")


def test_a_host_with_a_new_address_gets_a_certificate_for_its_existing_key(tmp_path: Path) -> None:
    make_certificates(tmp_path, [LabHost(name="robot", addresses=("10.0.0.3",))])
    key = (tmp_path / "robot.key").read_bytes()
    make_certificates(tmp_path, [LabHost(name="robot", addresses=("10.0.0.4",))])
    names = certificate(tmp_path / "robot.pem").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert [str(each) for each in names.get_values_for_type(x509.IPAddress)] == ["10.0.0.4"]
    assert (tmp_path / "robot.key").read_bytes() == key


def test_a_folder_without_the_authoritys_key_makes_no_hosts(tmp_path: Path) -> None:
    make_certificates(tmp_path, [LabHost(name="robot")])
    (tmp_path / "ca.key").unlink()
    with pytest.raises(InputError, match=r"has ca\.pem but not ca\.key"):
        make_certificates(tmp_path, [LabHost(name="viewer")])


@pytest.mark.parametrize("words", [("ca",), ("Robot",), ("robot=",), ("robot", "robot"), ("../robot",), ("a=b_c",)])
def test_an_invalid_host_is_refused(words: tuple[str, ...]) -> None:
    with pytest.raises(InputError):
        hosts_from_words(words)


def test_files_that_are_missing_or_of_another_host_or_lab_are_named(tmp_path: Path) -> None:
    make_certificates(tmp_path / "lab", hosts_from_words(("robot,viewer",)))
    make_certificates(tmp_path / "other", hosts_from_words(("robot",)))
    with pytest.raises(ConfigError, match=r"desk\.pem of host 'desk' is missing"):
        host_files(tmp_path / "lab", "desk")
    (tmp_path / "lab" / "robot.pem").write_bytes((tmp_path / "lab" / "viewer.pem").read_bytes())
    with pytest.raises(ConfigError, match="is the certificate of 'viewer', not of 'robot'"):
        host_files(tmp_path / "lab", "robot")
    (tmp_path / "lab" / "robot.pem").write_bytes((tmp_path / "other" / "robot.pem").read_bytes())
    with pytest.raises(ConfigError, match="was not signed by the authority"):
        host_files(tmp_path / "lab", "robot")
