"""The certificates in a folder, when they end, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import datetime, timezone
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import NameOID
from pydantic import BaseModel

from crosspih_common.security import Credentials
from crosspih_common.security.credentials import AUTHORITY, OTHERS_MAY
from services.operator.security.issuing import AUTHORITY_KEY

ENDS_SOON_DAYS = 30.0


class Certificate(BaseModel):
    """One row of `crosspih security show`."""

    name: str
    ends: datetime | None = None
    days_left: float | None = None
    wrong: str = ""
    note: str = ""


def look(folder: Path, services: Iterable[str], now: datetime | None = None) -> list[Certificate]:
    """The authority, then each service."""
    now = now or datetime.now(timezone.utc)
    authority, row = _read(folder / AUTHORITY, AUTHORITY.removesuffix(".pem"), now)
    if (folder / AUTHORITY_KEY).is_file():
        row.wrong = row.wrong or _open_to_others(folder / AUTHORITY_KEY)
        row.note = row.note or f"{AUTHORITY_KEY} signs new ones: keep it elsewhere once all are made"
    rows = [row]
    for service in services:
        files = Credentials(folder, service)
        certificate, row = _read(files.certificate, service, now)
        if certificate is not None and not row.wrong:
            row.wrong = next(_faults(certificate, authority, files), "")
        rows.append(row)
    return rows


def _read(file: Path, name: str, now: datetime) -> tuple[x509.Certificate | None, Certificate]:
    try:
        certificate = x509.load_pem_x509_certificate(file.read_bytes())
    except OSError as error:
        return None, Certificate(name=name, wrong=f"cannot be read: {error.strerror}")
    except ValueError:
        return None, Certificate(name=name, wrong=f"{file.name} is no certificate")
    ends = certificate.not_valid_after_utc
    left = (ends - now).total_seconds() / 86400.0
    row = Certificate(name=name, ends=ends, days_left=round(left, 1))
    if left <= 0.0:
        row.wrong = "expired"
    elif certificate.not_valid_before_utc > now:
        row.wrong = f"not valid before {certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC"
    elif left < ENDS_SOON_DAYS:
        row.note = "ends soon"
    return certificate, row


def _faults(
    certificate: x509.Certificate, authority: x509.Certificate | None, files: Credentials
) -> Iterator[str]:  # fmt: skip
    names = [attribute.value for attribute in certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]
    if names != [files.service]:
        yield f"is of {', '.join(map(str, names)) or 'nobody'}"
    if authority is not None:
        try:
            certificate.verify_directly_issued_by(authority)
        except (ValueError, TypeError, InvalidSignature):
            yield f"not signed by {AUTHORITY}"
    try:
        key = load_pem_private_key(files.key.read_bytes(), None)
    except OSError as error:
        yield f"{files.key.name} cannot be read: {error.strerror}"
        return
    except (ValueError, TypeError):
        yield f"{files.key.name} is no private key"
        return
    if key.public_key() != certificate.public_key():
        yield f"{files.key.name} is not its key"
    if fault := _open_to_others(files.key):
        yield fault


def _open_to_others(key: Path) -> str:
    return f"others may read {key.name}" if key.stat().st_mode & OTHERS_MAY else ""
