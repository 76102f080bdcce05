"""The paper's 26 contact states, with room for doubt."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.messages.base import Message


class ContactState(Message):
    """`case` is the paper's w1-w2-w3 (contacts, sense of alpha, case), or None: none of these, and why."""

    case: str | None
    count: int | None = Field(default=None, description="contacts by n_z0, 1 to 4")
    sense: int | None = Field(default=None, description="1: alpha < 0, 2: alpha > 0")
    n_z0: float = Field(description="|Fz| over |F|, signless as the paper prints it")
    confidence: float = Field(ge=0.0, le=1.0)
    reason: str = ""
