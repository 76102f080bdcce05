"""What a recording says of an assembly, worked out once for all that shows it."""

from __future__ import annotations

from services.operator.report.model.facts import Facts, facts_of

__all__ = ["Facts", "facts_of"]
