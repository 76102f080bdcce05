"""What a check says."""

from __future__ import annotations

from enum import Enum

from pydantic import BaseModel, ConfigDict


class Verdict(str, Enum):
    """How a check ended."""

    PASS = "pass"
    FAIL = "fail"
    SKIPPED = "skipped"  # it could not be asked; another line says why


class Check(BaseModel):
    """One line of the table: what was looked at, what was found, and what mends it."""

    model_config = ConfigDict(frozen=True)

    name: str
    verdict: Verdict
    found: str
    mend: str = ""


def passed(name: str, found: str) -> Check:
    """All is well."""
    return Check(name=name, verdict=Verdict.PASS, found=found)


def failed(name: str, found: str, mend: str) -> Check:
    """Something is wrong."""
    return Check(name=name, verdict=Verdict.FAIL, found=found, mend=mend)


def skipped(name: str, why: str) -> Check:
    """It was not asked."""
    return Check(name=name, verdict=Verdict.SKIPPED, found=why)


def fails(checks: list[Check]) -> list[Check]:
    """Those that failed."""
    return [check for check in checks if check.verdict is Verdict.FAIL]
