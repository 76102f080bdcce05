"""The sensor while it runs: records become stamped wrenches in N and Nm, and whatever is wrong with them is told."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.messages import Severity
from services.hardware.device_clock import DeviceClock, onward
from services.hardware.drivers.ati.config import AtiConfig
from services.hardware.drivers.ati.page import BoxPage, PageUnreadable, fetch_page, read_page
from services.hardware.drivers.ati.rdt import ROLL, START_REALTIME, RdtSocket, Records
from services.hardware.drivers.ati.status import judge
from services.hardware.drivers.registry import Tell
from services.hardware.protocols import WrenchSamples

SILENT_S = 0.2  # after so long without a record the box is looked for
TRY_S = 0.5
TELL_S = 2.0  # what goes on happening is told again no sooner
LATE_S = 0.5  # a record may come so much too late; one that is older still is of a box that was restarted


@dataclass(slots=True)
class RecordCounts:
    """What became of the records since the sensor was opened."""

    received: int = 0  # believed or not, none twice
    missed: int = 0  # by the gaps in the stream's sequence
    stale: int = 0  # twice, or overtaken by others: dropped
    malformed: int = 0  # datagrams that are no records
    disbelieved: int = 0  # by their status word: dropped
    reconnections: int = 0


class AtiWrench:
    """Implements WrenchDevice; stamps are `monotonic_ns` of this machine. `read` alone takes from the socket."""

    def __init__(
        self, config: AtiConfig, page: BoxPage, link: RdtSocket, internal_rate_hz: float, period_s: float, table: str,
        tell: Tell,
    ) -> None:  # fmt: skip
        self._config, self._page, self._link, self._table, self._tell = config, page, link, table, tell
        self.period_s = period_s
        self._internal_rate_hz = internal_rate_hz
        self._per_count = np.repeat([page.n_per_count, page.nm_per_count], 3)
        self.clock = DeviceClock(wrap_s=ROLL / internal_rate_hz, best_delay_s=config.best_delay_s)
        self.counts = RecordCounts()
        self._last: tuple[int, int] | None = None  # sequences of the stream and of the sensor
        self._last_ns: int | None = None
        self._status = 0
        self._told: dict[str, float] = {}
        self._missed_told = 0
        self._heard_s = time.monotonic()
        self._closing = threading.Event()
        self._seeker: threading.Thread | None = None
        self._lost, self._confirmed = False, True

    # -------------------------------------------------------------------------------------------------------- reading

    def read(self) -> WrenchSamples:
        """What has come since the last read; never waits. Looks for the box, beside, when nothing comes any more."""
        got = self._link.receive()
        self.counts.malformed += got.malformed
        now_s = time.monotonic()
        if len(got.records):
            self._heard_s = now_s
            if self._lost and not self._confirmed:  # what its counts mean now is being asked
                self.counts.disbelieved += len(got.records)
                self._seek()
                return _nothing()
            if self._lost:
                self._lost = False
                self._say(Severity.INFO, "sensor_back", "the ATI sensor's records come again", now_s, always=True)
            return self._samples(got, now_s)
        if now_s - self._heard_s > SILENT_S and not self._lost:
            self._lost, self._confirmed = True, False
            text = (
                f"no record of the ATI sensor at {self._config.host} for {SILENT_S:g} s: looking for it; cable, power, "
                "or another program that started its stream?"
            )
            self._say(Severity.WARNING, "sensor_silent", text, now_s, always=True)
        if self._lost:
            self._seek()
        return _nothing()

    def _samples(self, got: Records, now_s: float) -> WrenchSamples:
        records, arrived_ns = self._in_order(got.records, got.arrived_ns)
        device_s = records["ft"] / self._internal_rate_hz
        for device, arrived in zip(device_s.tolist(), arrived_ns.tolist(), strict=True):
            self.clock.observe(device, arrived)
        self.counts.received += len(records)
        believed = self._believed(records["status"], now_s)
        if believed is not None:
            records, device_s = records[believed], device_s[believed]
        if self.counts.missed > self._missed_told:
            text = f"{self.counts.missed} records of the ATI sensor missed so far, {self.counts.received} came"
            if self._say(Severity.WARNING, "samples_missed", text, now_s):
                self._missed_told = self.counts.missed
        if not len(records):
            return _nothing()
        stamps_ns = onward(self.clock.many_to_host_ns(device_s), self._last_ns)
        self._last_ns = int(stamps_ns[-1])
        return WrenchSamples(stamps_ns, records["counts"] * self._per_count)

    def _in_order(
        self, records: NDArray[np.void], arrived_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.void], NDArray[np.int64]]:
        """Without what came twice or too late; what is missing is counted."""
        rdt, ft = records["rdt"].astype(np.int64), records["ft"].astype(np.int64)
        follows = self._last is not None and rdt[0] == self._last[0] + 1 and ft[0] > self._last[1]
        if follows and (len(rdt) == 1 or (np.all(np.diff(rdt) == 1) and np.all(np.diff(ft) > 0))):
            self._last = int(rdt[-1]), int(ft[-1])
            return records, arrived_ns
        keep = np.zeros(len(records), dtype=bool)
        late = LATE_S * self._internal_rate_hz
        for k, now in enumerate(zip(rdt.tolist(), ft.tolist(), strict=True)):
            if self._last is not None:
                ahead, ft_ahead = _signed(now[0] - self._last[0]), _signed(now[1] - self._last[1])
                if -late <= ft_ahead <= 0:
                    self.counts.stale += 1
                    continue
                if ahead > 0 and ft_ahead > 0:
                    self.counts.missed += ahead - 1
                # else the stream began anew, of this box or of one that was restarted
            keep[k], self._last = True, now
        return records[keep], arrived_ns[keep]

    def _believed(self, status: NDArray[np.uint32], now_s: float) -> NDArray[np.bool_] | None:
        """Which records are believed, None: all. A status that is new is told."""
        if self._status == 0 and not status.any():
            return None
        believed = np.ones(len(status), dtype=bool)
        for word in np.unique(status).tolist():
            verdict = judge(word, self._table)
            if not verdict.believed:
                believed[status == word] = False
        self.counts.disbelieved += int(np.count_nonzero(~believed))
        newest = int(status[-1])
        if newest != self._status:
            verdict = judge(newest, self._table)
            if newest == 0:
                self._say(
                    Severity.INFO, "sensor_healthy", "the ATI sensor's status is healthy again", now_s, always=True
                )
            elif not verdict.believed:
                text = f"the ATI sensor says: {verdict.text}; its numbers are not believed until that is over"
                self._say(Severity.ERROR, "sensor_fault", text, now_s, always=True)
            elif verdict.overload:
                text = f"the ATI sensor says: {verdict.text}: more load than it can measure; take the load off"
                self._say(Severity.ERROR, "sensor_overload", text, now_s)
            else:
                self._say(Severity.WARNING, "sensor_status", f"the ATI sensor says: {verdict.text}", now_s)
            self._status = newest
        return believed

    def _say(self, severity: Severity, code: str, text: str, now_s: float, always: bool = False) -> bool:
        if not always and now_s - self._told.get(code, -TELL_S) < TELL_S:
            return False
        self._told[code] = now_s
        self._tell(severity, code, text)
        return True

    # --------------------------------------------------------------------------------------------------- coming back

    def forget_stream(self) -> None:
        """What comes next is not counted against what came last: it was not read for a while."""
        self._link.receive()
        self._last = None

    def _seek(self) -> None:
        if self._seeker is None or not self._seeker.is_alive():
            self._seeker = threading.Thread(target=self._seek_beside, name="ati-reconnect", daemon=True)
            self._seeker.start()

    def _seek_beside(self) -> None:
        """Until the box says that its counts mean the same as before, and records come: what came last may have been of
        another box, calibration or bias."""
        refused = False
        while not self._closing.is_set() and self._lost:
            asked_s = time.monotonic()
            try:
                timeout_s = min(1.0, self._config.timeout_s)
                page = read_page(fetch_page(self._config.host, self._config.http_port, timeout_s))
            except PageUnreadable:
                page = None
            if page is not None and page.same_numbers(self._page):
                if asked_s - self._heard_s > SILENT_S:
                    self.counts.reconnections += 1
                    self._link.send(START_REALTIME)
                self._confirmed = True
            elif page is not None and not refused:
                refused = True
                text = (
                    f"the ATI box is not as it was: calibration {page.calibration}, {page.units}, bias {page.bias}, "
                    "tool "
                    f"transformation {page.transformation}; it had {self._page.calibration}, {self._page.units}, "
                    f"{self._page.bias}, {self._page.transformation}. It is not believed: start the hardware service "
                    "again, and calibrate"
                )
                self._say(Severity.ERROR, "sensor_changed", text, asked_s, always=True)
            self._closing.wait(max(0.05, TRY_S - (time.monotonic() - asked_s)))

    def close(self) -> None:
        """Stop the stream and let go; a second call does nothing."""
        if not self._closing.is_set():
            self._closing.set()
            if self._seeker is not None:
                self._seeker.join()
            self._link.close()


def _nothing() -> WrenchSamples:
    return WrenchSamples(np.zeros(0, dtype=np.int64), np.zeros((0, 6)))


def _signed(difference: int) -> int:
    """Of two counters that roll over at 2**32: how far one is ahead of the other."""
    return (difference + ROLL // 2) % ROLL - ROLL // 2
