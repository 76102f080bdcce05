"""The paper's 26 contact states, with room for doubt."""

from __future__ import annotations

from enum import Enum

from pydantic import Field

from crosspih_common.messages.base import Deviations6, Frame, Message, Vector6


class ContactClassifier(str, Enum):
    """How a contact state is judged."""

    RULE = "rule"  # the paper's: signs, and n_z0 in its bands
    LIKELIHOOD = "likelihood"  # by the mechanics: how likely each set of touching edges makes the wrench


class ContactState(Message):
    """`case` is the paper's w1-w2-w3 (contacts, sense of alpha, case), or None: none of these, and why."""

    case: str | None
    count: int | None = Field(default=None, description="contacts by n_z0, 1 to 4")
    sense: int | None = Field(default=None, description="1: alpha < 0, 2: alpha > 0")
    n_z0: float = Field(description="|Fz| over |F|, signless as the paper prints it")
    confidence: float = Field(ge=0.0, le=1.0)
    reason: str = ""
    classifier: ContactClassifier = ContactClassifier.RULE


class ClassifyContacts(Message):
    """Ask for the states of compensated wrenches, each with its standard deviations; without a classifier, by the
    service's own.
    """

    frame: Frame = Frame.PEG
    wrenches: tuple[Vector6, ...] = Field(min_length=1, max_length=1000)
    wrench_sds: tuple[Deviations6, ...]
    classifier: ContactClassifier | None = None


class ContactStates(Message):
    """The states asked for, in the same order."""

    states: tuple[ContactState, ...]
