"""A lab's certificate authority, and a key with a certificate for each of its hosts.

A host authenticates with its certificate, whose common name is the host's name; other hosts grant rights by that
name. Elliptic keys (P-256), for both ends of TLS 1.3. The library `trustme` is for tests: it makes a new key with each
certificate, but a lab renews certificates for the keys that its hosts already have.
"""

import ipaddress
import os
from collections.abc import Callable, Iterable
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import TypeVar

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from dlokit.communication.zenoh.session import TlsFiles
from dlokit.errors import ConfigError, InputError
from dlokit.extras.hosts.config import AUTHORITY, LabHost, is_ip

AUTHORITY_DAYS = 3650
HOST_DAYS = 825
RENEWED_DAYS = 30
"""A certificate with less remaining validity is renewed."""
EARLY = timedelta(days=1)
"""Certificates are valid from one day before their creation, for hosts whose clock is behind."""

PrivateKey = ec.EllipticCurvePrivateKey
Read = TypeVar("Read")

_MAY_SIGN = x509.KeyUsage(
    digital_signature=False,
    content_commitment=False,
    key_encipherment=False,
    data_encipherment=False,
    key_agreement=False,
    key_cert_sign=True,
    crl_sign=True,
    encipher_only=False,
    decipher_only=False,
)
_TLS_ENDS = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])


def hosts_from_words(words: tuple[str, ...]) -> list[LabHost]:
    """Parse hosts as typed: ``decision=10.0.0.1,lab-pc viewer robot``, or ``viewer,robot``. Raises `InputError`."""
    hosts: list[LabHost] = []
    for word in words:
        name, equals, addresses = word.partition("=")
        if equals:
            hosts.append(LabHost(name=name, addresses=tuple(addresses.split(","))))
        else:
            hosts += [LabHost(name=each) for each in name.split(",")]
    names = [host.name for host in hosts]
    if len(set(names)) < len(names):
        raise InputError(f"a host is named twice among {', '.join(names)}: name each once, with all its addresses.")
    return hosts


def make_certificates(folder: Path, hosts: list[LabHost]) -> list[str]:
    """Write the missing files: the authority, and each host's key and certificate; returns one line per action.

    Existing keys are never overwritten. A certificate is renewed when the addresses of its host change, or within a
    month of its end. Raises `InputError` if the folder cannot be used.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        authority_key, authority, done = _authority(folder)
        for host in hosts:
            done += _host(folder, host, authority_key, authority)
    except OSError as error:
        raise InputError(f"{folder} cannot be used: {error}; name a folder that you may write to.") from error
    return done


def host_files(folder: Path, host: str) -> TlsFiles:
    """The files of a host in the folder of its lab. Raises `ConfigError` when one is missing or invalid."""
    authority, certificate, key = folder / f"{AUTHORITY}.pem", folder / f"{host}.pem", folder / f"{host}.key"
    for path in (authority, certificate, key):
        if not os.access(path, os.R_OK):
            raise ConfigError(
                f"the certificate file {path} of host {host!r} is missing or unreadable: create it with "
                f"`dlokit certs {folder} --hosts {host}` in the folder that has {AUTHORITY}.key, and copy it here."
            )
    _check(certificate, authority, host)
    return TlsFiles(
        authority=str(authority.absolute()), certificate=str(certificate.absolute()), key=str(key.absolute())
    )


def _check(path: Path, authority: Path, host: str) -> None:
    certificate = _read(path, x509.load_pem_x509_certificate)
    (common_name,) = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    if common_name.value != host:
        raise ConfigError(f"{path} is the certificate of {common_name.value!r}, not of {host!r}: copy the right one.")
    try:
        certificate.verify_directly_issued_by(_read(authority, x509.load_pem_x509_certificate))
    except (ValueError, TypeError, InvalidSignature) as error:
        raise ConfigError(
            f"{path} was not signed by the authority in {authority}: copy both from the same lab."
        ) from error
    now = datetime.now(UTC)
    if not certificate.not_valid_before_utc <= now <= certificate.not_valid_after_utc:
        raise ConfigError(
            f"{path} is valid from {certificate.not_valid_before_utc:%Y-%m-%d} to "
            f"{certificate.not_valid_after_utc:%Y-%m-%d}, and today is {now:%Y-%m-%d}: set this machine's clock, or "
            f"renew the certificate with `dlokit certs`."
        )


def _authority(folder: Path) -> tuple[PrivateKey, x509.Certificate, list[str]]:
    key_path, path = folder / f"{AUTHORITY}.key", folder / f"{AUTHORITY}.pem"
    if path.exists() and not key_path.exists():
        raise InputError(
            f"{folder} has {path.name} but not {key_path.name}: add hosts in the folder where the lab was created."
        )
    key = _key(key_path)
    if path.exists():
        return key, _read(path, x509.load_pem_x509_certificate), []
    extensions = (
        (x509.BasicConstraints(ca=True, path_length=0), True),
        (_MAY_SIGN, True),
        (x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False),
    )
    authority = _signed(path, _named("dlokit lab"), key, AUTHORITY_DAYS, key, _named("dlokit lab"), extensions)
    return key, authority, [f"{path} and {key_path}: the authority"]


def _host(folder: Path, host: LabHost, authority_key: PrivateKey, authority: x509.Certificate) -> list[str]:
    path, addresses = folder / f"{host.name}.pem", host.addresses
    key = _key(folder / f"{host.name}.key")
    if path.exists():
        before = _read(path, x509.load_pem_x509_certificate)
        known = _addresses_of(before)
        addresses = addresses or tuple(known - {host.name})
        left = before.not_valid_after_utc - datetime.now(UTC)
        if {*addresses, host.name} == known and left > timedelta(days=RENEWED_DAYS):
            return []
    names = [x509.IPAddress(ipaddress.ip_address(each)) if is_ip(each) else x509.DNSName(each) for each in addresses]
    extensions = (
        (x509.SubjectAlternativeName([x509.DNSName(host.name), *names]), False),
        (x509.BasicConstraints(ca=False, path_length=None), True),
        (_TLS_ENDS, False),
        (x509.AuthorityKeyIdentifier.from_issuer_public_key(authority_key.public_key()), False),
    )
    _signed(path, _named(host.name), key, HOST_DAYS, authority_key, authority.subject, extensions)
    return [f"{path}: host {host.name}" + (f", reached at {', '.join(addresses)}" if addresses else "")]


def _signed(
    path: Path,
    subject: x509.Name,
    key: PrivateKey,
    days: int,
    issuer_key: PrivateKey,
    issuer: x509.Name,
    extensions: Iterable[tuple[x509.ExtensionType, bool]],
) -> x509.Certificate:
    """Write and return a certificate; each extension has a flag whether readers without support must refuse it."""
    now = datetime.now(UTC)
    certificate = x509.CertificateBuilder(
        issuer_name=issuer,
        subject_name=subject,
        public_key=key.public_key(),
        serial_number=x509.random_serial_number(),
        not_valid_before=now - EARLY,
        not_valid_after=now + timedelta(days=days),
        extensions=[x509.Extension(each.oid, critical, each) for each, critical in extensions],
    ).sign(issuer_key, hashes.SHA256())
    part = path.with_suffix(".part")
    part.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    part.replace(path)
    return certificate


def _named(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _addresses_of(certificate: x509.Certificate) -> set[str]:
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return {*names.get_values_for_type(x509.DNSName), *map(str, names.get_values_for_type(x509.IPAddress))}


def _key(path: Path) -> PrivateKey:
    """Read or create the key in a file; a new file is readable only for its owner from the first byte on."""
    if path.exists():
        key = _read(path, partial(serialization.load_pem_private_key, password=None))
        if not isinstance(key, PrivateKey):
            raise ConfigError(f"{path} is a key of another kind: keys of `dlokit certs` are elliptic (P-256).")
        return key
    key = ec.generate_private_key(ec.SECP256R1())
    data = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(data)
    return key


def _read(path: Path, load: Callable[[bytes], Read]) -> Read:
    try:
        return load(path.read_bytes())
    except (ValueError, TypeError) as error:
        raise ConfigError(f"{path} cannot be read: {error}; move it away, and create it again.") from error
