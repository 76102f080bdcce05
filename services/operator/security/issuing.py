"""An authority and one certificate for each service, by `cryptography`: RFC 5280, keys on the curve P-256."""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from crosspih_common.security import Credentials
from crosspih_common.security.access import ROUTER
from crosspih_common.security.credentials import AUTHORITY

AUTHORITY_KEY = "ca.key"
AUTHORITY_NAME = "crosspih authority"
BACKDATED = timedelta(minutes=5)  # the clock of another machine may be slow
FOLDER_MODE, KEY_MODE, CERTIFICATE_MODE = 0o700, 0o600, 0o644
Key = ec.EllipticCurvePrivateKey


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _begun(
    subject: str, issuer: x509.Name, key: Key, start: datetime, end: datetime
) -> x509.CertificateBuilder:  # fmt: skip
    return (
        x509.CertificateBuilder()
        .subject_name(_name(subject))
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(start)
        .not_valid_after(end)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _usage(signs_others: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=True, key_cert_sign=signs_others, crl_sign=signs_others, content_commitment=False,
        key_encipherment=False, data_encipherment=False, key_agreement=False, encipher_only=False, decipher_only=False,
    )  # fmt: skip


@dataclass(frozen=True)
class Authority:
    """Signs certificates that are valid from `start` to `end`, UTC; its key is not needed any more once
    all are made.
    """

    key: Key
    certificate: x509.Certificate
    start: datetime
    end: datetime

    @classmethod
    def made(cls, start: datetime, end: datetime) -> Authority:
        """A new authority, itself valid for as long as what it signs."""
        key = ec.generate_private_key(ec.SECP256R1())
        certificate = (
            _begun(AUTHORITY_NAME, _name(AUTHORITY_NAME), key, start, end)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs_others=True), critical=True)
            .sign(key, hashes.SHA256())
        )
        return cls(key, certificate, start, end)

    def issue(self, service: str, hosts: Iterable[str]) -> tuple[x509.Certificate, Key]:
        """Issue a certificate with the service's name as common name; the router's lists the hosts at which it is
        reached.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
        names: list[x509.GeneralName] = [x509.DNSName(f"{service.replace('_', '-')}.crosspih.invalid")]
        if service == ROUTER:
            uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
            names = [_host(host) for host in hosts]
        begun = _begun(service, self.certificate.subject, key, self.start, self.end)
        certificate = (
            begun.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs_others=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
            .add_extension(x509.SubjectAlternativeName(names), critical=False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(self.key.public_key()), critical=False
            )
            .sign(self.key, hashes.SHA256())
        )  # fmt: skip
        return certificate, key


def _write(file: Path, content: bytes, mode: int) -> None:
    """Write a file that others can never read, not even for a moment: create it with its mode, then move
    it into place.
    """
    fresh = file.with_name(f".{file.name}.new")
    fresh.unlink(missing_ok=True)
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "wb") as stream:
        os.fchmod(descriptor, mode)
        stream.write(content)
    fresh.replace(file)


def _key_bytes(key: Key) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )  # fmt: skip


def write_pair(files: Credentials, certificate: x509.Certificate, key: Key) -> None:
    """A service's certificate and key, in their files."""
    _write(files.key, _key_bytes(key), KEY_MODE)
    _write(files.certificate, certificate.public_bytes(serialization.Encoding.PEM), CERTIFICATE_MODE)


def issue_all(
    folder: Path,
    services: Iterable[str],
    hosts: Iterable[str],
    days: float,
    start: datetime | None = None,
) -> datetime:
    """Create an authority and every service's certificate and key in a folder; returns when they end, in UTC.

    The folder gets mode 0700, keys 0600; files already in it are overwritten. `start`: now where it is not given.
    """
    start = (start or datetime.now(timezone.utc)).replace(microsecond=0)
    authority = Authority.made(start - BACKDATED, start + timedelta(days=days))
    folder.mkdir(parents=True, exist_ok=True, mode=FOLDER_MODE)
    folder.chmod(FOLDER_MODE)
    hosts = tuple(hosts)
    for service in services:
        write_pair(Credentials(folder, service), *authority.issue(service, hosts))
    _write(folder / AUTHORITY_KEY, _key_bytes(authority.key), KEY_MODE)
    _write(folder / AUTHORITY, authority.certificate.public_bytes(serialization.Encoding.PEM), CERTIFICATE_MODE)
    return authority.end
