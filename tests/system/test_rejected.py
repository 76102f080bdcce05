"""Garbage and foreign messages on the running cell's keys: counted, told with both names, and survived."""

from __future__ import annotations

import pytest

from crosspih_common.bus import open_zenoh
from crosspih_common.bus.codec import encode, label_of, label_with_seq
from crosspih_common.keys import EVENTS, FT_CALIBRATION, IDENTIFY_PAYLOAD, LOCATE, STATUS, WRENCH_RAW
from crosspih_common.messages import (
    CellClock,
    Event,
    FtCalibration,
    IdentifyPayload,
    RawWrenchBatch,
    ServiceStatus,
    Severity,
    Strategy,
)
from services.operator.assembly.session import Session
from tests.force_torque.made_calibrations import FORGED
from tests.system.running_cell import DEADLINE_S, RunningCell

# (what is sent, its label, what the event must name)
GARBAGE = (b"\xff\x00 not JSON", label_with_seq(RawWrenchBatch, 0), "crosspih.RawWrenchBatch/1")
FOREIGN = (encode(CellClock(boot_id="x", realtime=False)), label_with_seq(CellClock, 0), "crosspih.CellClock/1")
NEWER = (b"{}", "crosspih.RawWrenchBatch/2 0", "crosspih.RawWrenchBatch/2")
NAMELESS = (b"{}", "", "no type name")
WANTED = "crosspih.RawWrenchBatch/1"


@pytest.mark.parametrize("sent", [GARBAGE, FOREIGN, NEWER, NAMELESS], ids=["garbage", "type", "version", "no-label"])
def test_a_wrong_message_is_counted_and_told_with_both_names(
    cell: RunningCell, session: Session, sent: tuple[bytes, str, str]
) -> None:
    payload, label, name = sent
    statuses = session.bus.latest(STATUS, depth=64)
    events = session.bus.latest(EVENTS, depth=64)
    key = WRENCH_RAW.key(cell.name)

    def newest_rejected() -> int:
        status = statuses.wait_for(lambda one: one.service == "force_torque", DEADLINE_S)
        assert status is not None
        return status.rejected

    def told(event: Event) -> bool:
        named = name in event.text and WANTED in event.text and key in event.text
        return event.service == "force_torque" and event.code == "rejected" and named

    def counted(status: ServiceStatus) -> bool:
        rejected = sum(row.rejected for row in status.traffic if row.key == key)
        return status.service == "force_torque" and status.rejected > before and rejected > 0

    before = newest_rejected()
    with open_zenoh(cell.endpoint) as outsider:
        sender = outsider.sender(key, recover=False, history=0)
        # told at most once a second, so a single one may be counted in silence
        for _ in range(60):
            sender.put(payload, label)
            if (event := events.wait_for(told, 0.5)) is not None:
                break
    assert event is not None, events.values()
    assert event.severity is Severity.WARNING
    assert statuses.wait_for(counted, DEADLINE_S) is not None


def test_a_command_that_is_garbage_is_refused_with_the_reason(cell: RunningCell, session: Session) -> None:
    with open_zenoh(cell.endpoint) as outsider:
        answer = outsider.query(LOCATE.key(cell.name), b"not JSON", "crosspih.LocateHole/1", 30.0)
    assert answer.is_error
    assert answer.payload.startswith(b"contract\n") and b"LocateHole" in answer.payload


def test_a_number_that_is_none_is_refused_by_its_server(cell: RunningCell, session: Session) -> None:
    with open_zenoh(cell.endpoint) as outsider:
        answer = outsider.query(
            LOCATE.key(cell.name).replace("vision/locate", "arm/dwell"),
            b'{"stamp_ns":-1,"seq":-1,"duration_s":NaN}',
            "crosspih.Dwell/1",
            30.0,
        )
    assert answer.is_error and b"duration_s" in answer.payload


def test_a_forged_calibration_is_nobodys(cell: RunningCell, session: Session) -> None:
    """The planner would never calibrate again by itself, and every assembly would end: so it is not to be believed."""
    key, events = FT_CALIBRATION.key(cell.name), session.bus.latest(EVENTS, depth=64)
    latest = session.bus.latest(FT_CALIBRATION)
    said: list[str] = []
    session.bus.on_forged = said.append
    with open_zenoh(cell.endpoint) as outsider:
        sender = outsider.sender(key, recover=True, history=1)
        for _ in range(60):
            sender.put(encode(FORGED), label_with_seq(FtCalibration, 0))
            told = events.wait_for(  # the recorder says so too
                lambda event: (event.service, event.code) == ("planning", "forged_state") and key in event.text, 0.5
            )
            if told is not None and said:
                break
        assert told is not None and outsider.author in told.text
    assert said and outsider.author in said[0]
    assert latest.wait_for(lambda one: one.weight_n == FORGED.weight_n, 0.0) is None


def test_a_fabricated_identify_changes_no_calibration(cell: RunningCell, session: Session) -> None:
    before = cell.calibration_file.read_bytes() if cell.calibration_file.exists() else None
    with open_zenoh(cell.endpoint) as outsider:
        answer = outsider.query(
            IDENTIFY_PAYLOAD.key(cell.name), encode(IdentifyPayload(readings=())), label_of(IdentifyPayload), 30.0
        )
    assert answer.is_error and answer.payload.startswith(b"not_yours\n")
    assert (cell.calibration_file.read_bytes() if cell.calibration_file.exists() else None) == before


def test_the_cell_still_assembles(session: Session) -> None:
    figures, result = session.trial(1000, Strategy.FUSED, record=False)
    assert figures.inserted, result
