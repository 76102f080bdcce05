"""Every type that travels, against what nobody should send: each payload is a message or is rejected by name."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from crosspih_common.bus.codec import decode, encode, label_of
from crosspih_common.errors import ContractError
from crosspih_common.keys import topics
from crosspih_common.messages import Image
from services.operator.bench.fuzz.payloads import PayloadMaker, Sort

LABELS = ("", " ", "{} ²", "{} -1", "{} 1e9", "{} " + "9" * 5000, "{}/2 0", "crosspih.Nothing/1 0", "\x00", "x" * 999)
SORTS = (Sort.FITTING, Sort.MISFIT, Sort.BROKEN)


@dataclass
class Decoded:
    """What became of one key's payloads. `escaped` counts errors that are no ContractError, by name."""

    key: str
    accepted: int = 0
    rejected: int = 0
    escaped: Counter[str] = field(default_factory=Counter)

    @property
    def sent(self) -> int:
        """All of them."""
        return self.accepted + self.rejected + sum(self.escaped.values())


def kinds() -> dict[str, type[Any]]:
    """The type of each key of the table, echoes of commands included."""
    return {topic.path: topic.type for topic in topics()}


def decode_all(key: str, kind: type[Any], count: int, seed: int) -> Decoded:
    """Draw `count` payloads for a key and decode each; what was accepted must encode and decode to the same again."""
    rng = np.random.default_rng((seed, sum(key.encode())))
    draw = _images(rng) if issubclass(kind, Image) else PayloadMaker(kind.model_json_schema(), seed).payload
    done, right = Decoded(key), label_of(kind)
    for index in range(count):
        label = f"{right} {index}" if index % 10 else LABELS[index // 10 % len(LABELS)].replace("{}", right)
        try:
            value = decode(kind, draw(SORTS[index % len(SORTS)]), label, key)
            again = decode(kind, encode(value), label, key)
        except ContractError:
            done.rejected += 1
        except Exception as error:  # that there is none is what is looked for
            done.escaped[f"{type(error).__name__}: {error}"[:120]] += 1
        else:
            done.accepted += 1
            if not issubclass(kind, Image) and again != value:
                done.escaped["another message when encoded again"] += 1
    return done


def _images(rng: np.random.Generator) -> Any:
    """Pictures of some pixels, and what is left of them after bytes were lost or changed."""
    whole = encode(Image("camera_left", np.zeros((4, 6), dtype=np.uint8), 5, 0))

    def draw(sort: Sort) -> bytes:
        if sort is Sort.FITTING:
            return whole
        changed = bytearray(whole)
        for _ in range(int(rng.integers(1, 9))):
            changed[int(rng.integers(len(changed)))] = int(rng.integers(256))
        return bytes(changed[: int(rng.integers(len(changed)))] if sort is Sort.BROKEN else changed)

    return draw
