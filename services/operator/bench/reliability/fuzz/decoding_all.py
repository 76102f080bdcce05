"""Every key's payloads over all cores, with a bar; when stopped or out of time, the results so far."""

from __future__ import annotations

import math
import multiprocessing
import os
import time
from collections import Counter
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures import TimeoutError as FutureTimeoutError
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field

from rich.console import Console

from crosspih_common.provenance import ResultStore, folder_version, result_key
from services.operator.bench.cells.bar import Bar
from services.operator.bench.cells.local_executor import usable_cores
from services.operator.bench.cells.stopping import end_with_parent
from services.operator.bench.reliability.fuzz.decoding import Decoded, Share, ShareDone, decode_share, kinds, shares
from services.operator.bench.reliability.fuzz.rests_on import drawn_by

SHARE = 2000


@dataclass
class AllDecoded:
    """The results of each key's payloads, row by row. `grown_mb`: by how much the peak memory of a process grew after
    each key had its first share, the largest of all processes. `whole`: nothing is left to do.
    """

    rows: dict[str, Decoded] = field(default_factory=lambda: {key: Decoded(key) for key in kinds()})
    grown_mb: float = 0.0
    whole: bool = False
    failure: str = ""

    @property
    def sent(self) -> int:
        """All payloads."""
        return sum(row.sent for row in self.rows.values())


def _decode(share: Share) -> ShareDone:
    return decode_share(share, os.getpid())


def share_key(share: Share) -> str:
    """The key under which its result is stored: other decoding code, or other payloads, give another key."""
    code = folder_version("crosspih_common")
    return result_key({"fuzz": "decoded", "code": code, "drawn_by": drawn_by(), **share._asdict()})


def decode_every_key(
    console: Console, payloads: int, seed: int, until: float, store: ResultStore | None = None
) -> tuple[AllDecoded, bool]:
    """Decode `payloads` of each key until the time `until` (`time.time`). Returns the results, and whether it was
    interrupted. Shares in the store are taken from there.
    """
    done, open_shares = AllDecoded(), []
    for share in shares(payloads, SHARE, seed):
        known = store.get(share_key(share)) if store is not None else None
        if known is None:
            open_shares.append(share)
        else:
            done.rows[share.key].add(
                Decoded(share.key, known["accepted"], known["rejected"], Counter(known["escaped"]))
            )
    done.whole = not open_shares
    if done.whole or time.time() >= until:
        return done, False
    memory: dict[int, float] = {}
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(usable_cores(), context, initializer=end_with_parent)
    waiting: set[Future[ShareDone]] = set()
    interrupted = False
    with Bar(console) as progress:
        bar = progress.add_task("payloads decoded", total=payloads * len(done.rows), completed=done.sent)

        def take(future: Future[ShareDone]) -> None:
            waiting.discard(future)
            share, decoded, process, most_mb = future.result()
            done.rows[share.key].add(decoded)
            if share.first > 0:
                done.grown_mb = max(done.grown_mb, most_mb - memory.setdefault(process, most_mb))
            if store is not None:
                store.put(share_key(share), vars(decoded), code=folder_version("crosspih_common"))
            progress.advance(bar, share.payloads)
            for what in decoded.escaped:
                progress.console.print(f"{share.key}: {what}", style="red", markup=False, highlight=False)

        try:
            waiting |= {pool.submit(_decode, share) for share in open_shares}
            left_s = None if math.isinf(until) else max(until - time.time(), 0.0)
            for future in as_completed(set(waiting), left_s):
                take(future)
            done.whole = True
        except FutureTimeoutError:
            progress.console.print("the time is up; what was decoded by now is counted", highlight=False)
        except KeyboardInterrupt:
            interrupted = True
        except BrokenProcessPool:
            done.failure = "a process that decoded has ended by itself: its memory or a defect in what reads payloads"
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        # the shares at work when it ended are done by now
        for future in [one for one in waiting if one.done() and not one.cancelled() and one.exception() is None]:
            take(future)
    return done, interrupted
