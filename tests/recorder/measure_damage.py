"""What damage costs: `python -m tests.recorder.measure_damage FILE` puts 64 random bytes in one place after another and
counts the messages that are then missing. FILE itself is not touched.
"""

from __future__ import annotations

import argparse
import random
import statistics
import tempfile
from pathlib import Path

from crosspih_common.recording import read_recording


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--places", type=int, default=100)
    parser.add_argument("--bytes", type=int, default=64)
    asked = parser.parse_args()
    whole, rng = asked.file.read_bytes(), random.Random(1)

    def count(path: Path) -> int:
        return sum(map(len, read_recording(path).samples.values()))

    every, lost = count(asked.file), []
    with tempfile.TemporaryDirectory() as folder:
        damaged = Path(folder) / "damaged.mcap"
        for _ in range(asked.places):
            data = bytearray(whole)
            at = rng.randrange(len(data) - asked.bytes)
            data[at : at + asked.bytes] = rng.randbytes(asked.bytes)
            damaged.write_bytes(data)
            lost.append(every - count(damaged))
    print(
        f"{asked.bytes} bytes damaged in each of {asked.places} places of {len(whole)}: of {every} messages "
        f"{statistics.median(lost):.0f} are lost in the median, {max(lost)} at most"
    )


if __name__ == "__main__":
    main()
