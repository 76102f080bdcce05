"""The messages of a cell's bus, by their stamps, and the state of the cell at any moment: live and in a recording."""

from __future__ import annotations

import threading
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import (
    AssemblyPhase,
    AssemblyResult,
    CameraCalibration,
    ContactState,
    ContactWrench,
    Event,
    HoleEstimate,
    Image,
    JointState,
    LeaseState,
    Phase,
    PoseData,
    PoseErrorEstimate,
    ServiceStatus,
    Touch,
    WithdrawResult,
)
from services.viewer.series import GrowingRows

KEPT_NS = 600 * 10**9  # live: how much of the cell's time is kept
SLACK_NS = 60 * 10**9  # older messages are removed at once when this much more has come
ItemT = TypeVar("ItemT")


@dataclass(frozen=True, slots=True)
class HoleBelieved:
    """Where the hole is believed to be, with its covariance (6, 6) if there is one, and the source of the estimate."""

    pose_base_hole: PoseData
    covariance: tuple[float, ...] | None
    by: str


@dataclass(frozen=True, slots=True)
class StampedPicture:
    """A picture that can be loaded: `stamp_ns` identifies it among its camera's pictures, `load` decodes it."""

    stamp_ns: int
    load: Callable[[], Image]


@dataclass(frozen=True, slots=True)
class PhaseSpan:
    """A phase of an assembly; for the current one `until_ns` is the moment asked about."""

    phase: Phase
    from_ns: int
    until_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class SceneMoment:
    """All that is shown of one moment; what had not been sent by then is None or empty.

    `joints_rad` (n,), `wrench` (6,) on the peg in the peg frame, N and Nm. `trial_ns` is when the current or last
    assembly began; touches, spans, belief and result belong to it.
    """

    stamp_ns: int
    trial_ns: int
    joints_rad: Array | None = None
    wrench: Array | None = None
    in_contact: bool = False
    contact: ContactState | None = None
    phase: AssemblyPhase | None = None
    spans: tuple[PhaseSpan, ...] = ()
    touches: tuple[Touch, ...] = ()
    belief: HoleBelieved | None = None
    result: AssemblyResult | None = None
    withdrawn: WithdrawResult | None = None
    camera: CameraCalibration | None = None
    lease: LeaseState | None = None
    pictures: dict[str, StampedPicture] = field(default_factory=dict)
    services: tuple[ServiceStatus, ...] = ()
    events: tuple[Event, ...] = ()


class StampedItems(Generic[ItemT]):
    """Items by their stamps, in order."""

    def __init__(self) -> None:
        self.stamps_ns: list[int] = []
        self.items: list[ItemT] = []

    def add(self, stamp_ns: int, item: ItemT) -> None:
        """Add an item; a late one is inserted by its stamp."""
        at = bisect_right(self.stamps_ns, stamp_ns)
        self.stamps_ns.insert(at, stamp_ns)
        self.items.insert(at, item)

    def at(self, stamp_ns: int) -> ItemT | None:
        """The newest item at that time."""
        index = bisect_right(self.stamps_ns, stamp_ns) - 1
        return None if index < 0 else self.items[index]

    def between(self, first_ns: int, last_ns: int) -> list[ItemT]:
        """The items of a span, both ends included."""
        return self.items[bisect_right(self.stamps_ns, first_ns - 1) : bisect_right(self.stamps_ns, last_ns)]

    def forget_before(self, stamp_ns: int) -> None:
        """Remove older items, except for the newest of them, which is still valid."""
        first = max(bisect_right(self.stamps_ns, stamp_ns) - 1, 0)
        del self.stamps_ns[:first], self.items[:first]


class Timeline:
    """The messages of a cell. They may come from several threads."""

    def __init__(self, joints: int) -> None:
        self._lock = threading.Lock()
        self._joint_count = joints
        self.clear()

    def clear(self) -> None:
        """Forget everything: the cell was started again, and with it its clock."""
        with self._lock:
            self.joints, self.wrench = GrowingRows(self._joint_count), GrowingRows(7)
            self.first_ns, self.last_ns = -1, -1
            self._contacts: StampedItems[ContactState] = StampedItems()
            self._phases: StampedItems[AssemblyPhase] = StampedItems()
            self._touches: StampedItems[Touch] = StampedItems()
            self._beliefs: StampedItems[HoleBelieved] = StampedItems()
            self._results: StampedItems[AssemblyResult] = StampedItems()
            self._withdrawn: StampedItems[WithdrawResult] = StampedItems()
            self._cameras: StampedItems[CameraCalibration] = StampedItems()
            self._leases: StampedItems[LeaseState] = StampedItems()
            self._events: StampedItems[Event] = StampedItems()
            self._pictures: dict[str, StampedItems[StampedPicture]] = {}
            self._statuses: dict[str, StampedItems[ServiceStatus]] = {}
            self._trials: StampedItems[int] = StampedItems()

    def tick(self, stamp_ns: int) -> None:
        """Take a tick of the cell's clock."""
        with self._lock:
            self._tick(stamp_ns)

    def _tick(self, stamp_ns: int) -> None:
        if self.first_ns < 0 or stamp_ns < self.first_ns:
            self.first_ns = stamp_ns
        self.last_ns = max(self.last_ns, stamp_ns)

    def forget(self) -> None:
        """Remove what is older than KEPT_NS; cheap when there is nothing to remove."""
        with self._lock:
            if self.last_ns - self.first_ns < KEPT_NS + SLACK_NS:
                return
            self.first_ns = self.last_ns - KEPT_NS
            for rows in (self.joints, self.wrench):
                rows.forget_before(self.first_ns)
            told: tuple[StampedItems[Any], ...] = (
                self._contacts, self._phases, self._touches, self._beliefs, self._results, self._withdrawn,
                self._cameras, self._leases, self._events, self._trials, *self._pictures.values(),
                *self._statuses.values(),
            )  # fmt: skip
            for one in told:
                one.forget_before(self.first_ns)

    # ------------------------------------------------------------------------------------------------------- hearing

    def joint_state(self, heard: JointState) -> None:
        """Take encoder readings; those of an arm with another number of joints are ignored."""
        with self._lock:
            if len(heard.joints_rad) == self._joint_count:
                self._tick(heard.stamp_ns)
                self.joints.append(heard.stamp_ns, heard.joints_rad)

    def contact_wrench(self, heard: ContactWrench) -> None:
        """Take a contact wrench."""
        with self._lock:
            self._tick(heard.stamp_ns)
            self.wrench.append(heard.stamp_ns, (*heard.wrench, float(heard.in_contact)))

    def contact_state(self, heard: ContactState) -> None:
        """Take the contact state that the wrench is classified as."""
        with self._lock:
            self._contacts.add(heard.stamp_ns, heard)

    def phase(self, heard: AssemblyPhase) -> None:
        """Take a phase of an assembly; the first one ever, or after the last one's end, begins a trial."""
        with self._lock:
            self._tick(heard.stamp_ns)
            before = self._phases.at(heard.stamp_ns)
            ended = before is None or before.phase in (Phase.DONE, Phase.IDLE)
            if ended and heard.phase not in (Phase.DONE, Phase.IDLE):
                self._trials.add(heard.stamp_ns, heard.stamp_ns)
            self._phases.add(heard.stamp_ns, heard)

    def touch(self, heard: Touch) -> None:
        """Take a touch."""
        with self._lock:
            self._touches.add(heard.stamp_ns, heard)

    def hole(self, heard: HoleEstimate) -> None:
        """Take vision's measurement of the hole."""
        with self._lock:
            self._beliefs.add(heard.stamp_ns, HoleBelieved(heard.pose_base_hole, heard.covariance, "vision"))

    def estimate(self, heard: PoseErrorEstimate, by: str) -> None:
        """Take an estimate of the hole from touches or from the walls of the bore."""
        with self._lock:
            self._beliefs.add(heard.stamp_ns, HoleBelieved(heard.pose_base_hole, heard.covariance, by))

    def result(self, heard: AssemblyResult) -> None:
        """Take the result of an assembly."""
        with self._lock:
            self._results.add(heard.stamp_ns, heard)
            if heard.pose_base_hole is not None:
                by = "the seated peg" if heard.inserted else "the last estimate"
                self._beliefs.add(heard.stamp_ns, HoleBelieved(heard.pose_base_hole, heard.covariance, by))

    def withdraw(self, heard: WithdrawResult) -> None:
        """Take the result of a withdrawal."""
        with self._lock:
            self._withdrawn.add(heard.stamp_ns, heard)

    def calibration(self, heard: CameraCalibration) -> None:
        """Take the calibration of the cameras."""
        with self._lock:
            self._cameras.add(heard.stamp_ns, heard)

    def lease(self, heard: LeaseState) -> None:
        """Take the lease: who holds the arm."""
        with self._lock:
            self._leases.add(heard.stamp_ns, heard)

    def status(self, heard: ServiceStatus) -> None:
        """Take the status of a service."""
        with self._lock:
            self._statuses.setdefault(heard.service, StampedItems()).add(heard.stamp_ns, heard)

    def event(self, heard: Event) -> None:
        """Take an event for people."""
        with self._lock:
            self._events.add(heard.stamp_ns, heard)

    def picture(self, name: str, picture: StampedPicture) -> None:
        """Take a picture of a camera, or an annotated one, by its name."""
        with self._lock:
            self._pictures.setdefault(name, StampedItems()).add(picture.stamp_ns, picture)

    # -------------------------------------------------------------------------------------------------------- asking

    def at(self, stamp_ns: int) -> SceneMoment:
        """The state at that time."""
        with self._lock:
            trial_ns = self._trials.at(stamp_ns)
            since = self.first_ns if trial_ns is None else trial_ns
            wrench = self.wrench.at(stamp_ns)
            pictures = {name: said.at(stamp_ns) for name, said in self._pictures.items()}
            statuses = [said.at(stamp_ns) for said in self._statuses.values()]
            beliefs = self._beliefs.between(since, stamp_ns)
            results = self._results.between(since, stamp_ns)
            withdrawn = self._withdrawn.between(since, stamp_ns)
            joints = self.joints.at(stamp_ns)
            return SceneMoment(
                stamp_ns=stamp_ns,
                trial_ns=since,
                joints_rad=None if joints is None else joints.copy(),
                wrench=None if wrench is None else wrench[:6].copy(),
                in_contact=wrench is not None and bool(wrench[6]),
                contact=self._contacts.at(stamp_ns),
                phase=self._phases.at(stamp_ns) if trial_ns is not None else None,
                spans=self._spans(since, stamp_ns),
                touches=tuple(self._touches.between(since, stamp_ns)),
                belief=beliefs[-1] if beliefs else None,
                result=results[-1] if results else None,
                withdrawn=withdrawn[-1] if withdrawn else None,
                camera=self._cameras.at(stamp_ns),
                lease=self._leases.at(stamp_ns),
                pictures={name: picture for name, picture in pictures.items() if picture is not None},
                services=tuple(sorted((one for one in statuses if one), key=lambda one: one.service)),
                events=tuple(self._events.between(since, stamp_ns)[-8:]),
            )

    def _spans(self, first_ns: int, last_ns: int) -> tuple[PhaseSpan, ...]:
        low = bisect_right(self._phases.stamps_ns, first_ns - 1)
        high = bisect_right(self._phases.stamps_ns, last_ns)
        spans: list[PhaseSpan] = []
        for index in range(low, high):
            phase, begin = self._phases.items[index].phase, self._phases.stamps_ns[index]
            if spans and spans[-1].phase is phase:
                continue
            if spans:
                spans[-1] = PhaseSpan(spans[-1].phase, spans[-1].from_ns, begin)
            spans.append(PhaseSpan(phase, begin, last_ns))
        return tuple(spans)

    def wrenches(self, first_ns: int, last_ns: int) -> tuple[Array, Array]:
        """Times (k,), s since `first_ns`, and contact wrenches (k, 6), N and Nm, of a time span."""
        with self._lock:
            stamps, values = self.wrench.between(first_ns, last_ns)
            return np.asarray((stamps - first_ns) * 1e-9, float), np.array(values[:, :6])

    def trials_ns(self) -> tuple[int, ...]:
        """When each assembly began."""
        with self._lock:
            return tuple(self._trials.items)
