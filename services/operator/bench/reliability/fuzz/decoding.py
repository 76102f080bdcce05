"""Every type that is sent, against payloads that nobody should send: each is a message or is rejected by name."""

from __future__ import annotations

import resource
import sys
import warnings
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from crosspih_common.bus.codec import decode, encode, label_of
from crosspih_common.errors import ContractError
from crosspih_common.keys import topics
from crosspih_common.messages import Image
from services.operator.bench.reliability.fuzz.payloads import PayloadMaker, Sort

LABELS = ("", " ", "{} ²", "{} -1", "{} 1e9", "{} " + "9" * 5000, "{}/2 0", "crosspih.Nothing/1 0", "\x00", "x" * 999)
SORTS = (Sort.FITTING, Sort.MISFIT, Sort.BROKEN)


@dataclass
class Decoded:
    """The results of one key's payloads. `escaped` counts errors other than ContractError, by name."""

    key: str
    accepted: int = 0
    rejected: int = 0
    escaped: Counter[str] = field(default_factory=Counter)

    def add(self, other: Decoded) -> None:
        """Add the results of more payloads."""
        self.accepted += other.accepted
        self.rejected += other.rejected
        self.escaped += other.escaped

    @property
    def sent(self) -> int:
        """All of them."""
        return self.accepted + self.rejected + sum(self.escaped.values())


class Share(NamedTuple):
    """A number of payloads of one key: the part that one process decodes at a time. Equal shares draw
    equal payloads.
    """

    key: str
    first: int
    payloads: int
    seed: int


class ShareDone(NamedTuple):
    """The results of a share, and the peak memory of the process by then, MB."""

    share: Share
    decoded: Decoded
    process: int
    most_memory_mb: float


def shares(payloads: int, size: int, seed: int) -> list[Share]:
    """`payloads` of every key in shares, all keys' first shares first: a run that is stopped early has some of each."""
    return [
        Share(key, first, min(size, payloads - first), seed) for first in range(0, payloads, size) for key in kinds()
    ]


def decode_share(share: Share, process: int) -> ShareDone:
    """See `decode_all`."""
    decoded = decode_all(share.key, kinds()[share.key], share.payloads, share.seed, share.first)
    # kilobytes, on macOS bytes
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    return ShareDone(share, decoded, process, most)


def kinds() -> dict[str, type[Any]]:
    """The type of each key of the table, echoes of commands included."""
    return {topic.path: topic.type for topic in topics()}


def decode_all(key: str, kind: type[Any], count: int, seed: int, first: int = 0) -> Decoded:
    """Draw `count` payloads for a key and decode each; an accepted one must encode and decode to the same again.

    Equal `seed`, key and `first` draw equal payloads. A warning (an overflow in NumPy) counts as an error.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return _decoded(key, kind, range(first, first + count), f"{seed} {key} {first}")


def _decoded(key: str, kind: type[Any], numbers: range, seed: str) -> Decoded:
    rng = np.random.default_rng(list(seed.encode()))
    draw = _images(rng) if issubclass(kind, Image) else PayloadMaker(kind.model_json_schema(), seed).payload
    done, right = Decoded(key), label_of(kind)
    for index in numbers:
        label = f"{right} {index}" if index % 10 else LABELS[index // 10 % len(LABELS)].replace("{}", right)
        try:
            value = decode(kind, draw(SORTS[index % len(SORTS)]), label, key)
            again = decode(kind, encode(value), label, key)
        except ContractError:
            done.rejected += 1
        except Exception as error:  # the test is that there is none
            done.escaped[f"{type(error).__name__}: {error}"[:120]] += 1
        else:
            done.accepted += 1
            if not issubclass(kind, Image) and again != value:
                done.escaped["another message when encoded again"] += 1
    return done


def _images(rng: np.random.Generator) -> Any:
    """Pictures of a few pixels, and damaged copies with bytes lost or changed."""
    whole = encode(Image("camera_left", np.zeros((4, 6), dtype=np.uint8), 5, 0))

    def draw(sort: Sort) -> bytes:
        if sort is Sort.FITTING:
            return whole
        changed = bytearray(whole)
        for _ in range(int(rng.integers(1, 9))):
            changed[int(rng.integers(len(changed)))] = int(rng.integers(256))
        return bytes(changed[: int(rng.integers(len(changed)))] if sort is Sort.BROKEN else changed)

    return draw
