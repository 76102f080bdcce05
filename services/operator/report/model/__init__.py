"""The facts about an assembly, computed once from its recording for all that shows them."""

from __future__ import annotations

from services.operator.report.model.facts import Facts, facts_of

__all__ = ["Facts", "facts_of"]
