"""The processes of a worker's stack as the kernel sees them. Linux."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from deploy.launcher import StateDirectory


class ProcessResources(BaseModel):
    """What a process holds: resident memory, open descriptors, threads."""

    model_config = ConfigDict(frozen=True)

    memory_mb: float
    descriptors: int
    threads: int


def held_by(pid: int) -> ProcessResources | None:
    """The resources of one process; None where it has ended."""
    folder = Path(f"/proc/{pid}")
    try:
        fields = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines() if ":" in line)
        descriptors = sum(1 for _ in (folder / "fd").iterdir())
        return ProcessResources(
            memory_mb=round(int(fields["VmRSS"].split()[0]) / 1024, 1), descriptors=descriptors,
            threads=int(fields["Threads"]),
        )  # fmt: skip
    except (OSError, KeyError):
        return None


def held_by_services(project: str) -> dict[str, ProcessResources]:
    """The resources of each service of a running stack; empty where the launcher's state cannot be read."""
    state = StateDirectory(project).read()
    if state is None:
        return {}
    found = {row.service: held_by(row.pid) for row in state.services if row.pid is not None}
    return {service: held for service, held in found.items() if held is not None}


def restarts_of(project: str) -> dict[str, int]:
    """How often the launcher has restarted each service."""
    state = StateDirectory(project).read()
    return {} if state is None else {row.service: row.restarts for row in state.services}
