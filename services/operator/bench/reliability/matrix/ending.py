"""Ends one process in one phase of `crosspih assemble`, in a worker's own cell, and observes the effects."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.errors import CrosspihError, NoService
from crosspih_common.keys import ABORT, RECORD_STOP
from crosspih_common.messages import AbortAssembly, Phase, StopRecording
from crosspih_common.modules import module_command
from crosspih_common.recording import RecordingError, read_recording
from deploy.launcher import StateDirectory
from deploy.launcher.health import Health
from services.operator.assembly.session import NEEDED, Session
from services.operator.bench.reliability.kills.victim import Victim
from services.operator.bench.reliability.kills.watching import Watch
from services.operator.bench.reliability.matrix.judging import HEALTHY_S, RESULT_S, MatrixObservation, TapeFigures, gone
from services.operator.bench.reliability.matrix.plan import OPERATOR, STOPPED_S, MatrixCase, ProcessEnding

RIPE_DEADLINE_S = 240.0
WHOLE_DEADLINE_S = 180.0
RECORDER_DEADLINE_S = 60.0
_POLL_S = 0.05


def end_process(session: Session, payload: dict[str, Any]) -> dict[str, Any]:
    """The work of a CellTask: `payload` is a Case and the recordings' folder, the result a Seen, as plain data."""
    case, folder = MatrixCase.model_validate(payload["case"]), Path(payload["folder"])
    with Session() as own:  # messages of this case alone
        own.wait_for_services(WHOLE_DEADLINE_S, (*NEEDED, "recorder"))
        run = _Run(own, case, folder)
        try:
            return run.run().model_dump(mode="json")
        finally:
            run.make_whole()


class _Run:
    def __init__(self, session: Session, case: MatrixCase, folder: Path) -> None:
        self._session, self._case, self._folder = session, case, folder
        self._stack = StateDirectory(session.cell.workcell.name)
        self._watch = Watch(session)
        self._victim = Victim(session, self._watch, case.victim)
        self._before = set(folder.glob("*.mcap"))
        self._healthy_s: float | None = None
        self._operator: subprocess.Popen[str] | None = None
        self._said: tuple[str, str] = ("", "")
        self._begun_wall_ns = time.time_ns()

    def run(self) -> MatrixObservation:
        """One case. Raises NoService when the stack cannot be seen."""
        case, watch, victim = self._case, self._watch, self._victim
        strategy = case.moment.strategy.value
        self._operator = operator = subprocess.Popen(
            module_command(
                "services.operator", "assemble", "--json", "--seed", str(case.seed), "--strategy", strategy
            ),
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        reader = threading.Thread(target=self._read, args=(operator,), name="operator-says", daemon=True)
        reader.start()
        if not victim.wait_ripe(case.moment, lambda: operator.poll() is not None, RIPE_DEADLINE_S):
            operator.terminate()
            reader.join(RESULT_S)
            return MatrixObservation(signalled=False, detail=self._said[1].strip()[-400:])
        victim.end(case.ending.number, operator.pid if case.victim == OPERATOR else None)
        recovery = threading.Thread(target=self._recover, name="recovery", daemon=True)
        recovery.start()
        if gone(case):
            reader.join(RESULT_S)
            told = watch.wait(lambda: any(phase.phase is Phase.DONE for phase in watch.since()), RESULT_S)
        else:
            reader.join(RESULT_S)
            told = not reader.is_alive()
        result_s = watch.since_signal_s() if told else None
        recovery.join(HEALTHY_S + STOPPED_S)
        return self._seen(result_s)

    def _read(self, operator: subprocess.Popen[str]) -> None:
        self._said = operator.communicate()

    def _recover(self) -> None:
        """Continue a process that was stopped, and wait until it is healthy again."""
        stopped = self._case.ending is ProcessEnding.STOP
        if stopped:
            time.sleep(STOPPED_S)
            self._victim.then(signal.SIGCONT)
        if self._case.victim != OPERATOR and self._victim.wait_healthy(HEALTHY_S, same_process=stopped):
            self._healthy_s = self._watch.since_signal_s()

    # ----------------------------------------------------------------------------------------------------- the end

    def _seen(self, result_s: float | None) -> MatrixObservation:
        operator, (said, shown) = self._operator, self._said
        assert operator is not None
        figures: dict[str, Any] = {}
        with suppress(ValueError):
            figures = json.loads(said)
        done = [phase for phase in self._watch.since() if phase.phase is Phase.DONE]
        told = done[-1].text if done else shown.strip()[-400:]
        return MatrixObservation(
            signalled=True,
            result_s=result_s,
            inserted=bool(figures["inserted"]) if figures else bool(done) and done[-1].text == "inserted",
            failure=figures.get("failure"),
            detail=figures.get("failure_detail") or told,
            backed_off=bool(figures.get("backed_off")),
            status=operator.poll(),
            healthy_s=self._healthy_s,
            tape=self._tape(tuple(figures.get("recording_warnings", ()))),
            tip_before_m=self._victim.tip_before_m(),
        )

    def _tape(self, warnings: tuple[str, ...]) -> TapeFigures | None:
        if gone(self._case):
            with suppress(CrosspihError):  # nobody else ends this process
                self._session.bus.call(RECORD_STOP, StopRecording(), RECORDER_DEADLINE_S)
        new = sorted(set(self._folder.glob("*.mcap")) - self._before)
        recording = trouble = None
        for path in (one for one in new if ".part" not in one.name):
            try:
                found = read_recording(path)
            except RecordingError as error:
                trouble = str(error)
                continue
            if found.cell == self._session.cell.workcell.name:  # cells side by side share the folder
                recording = found
        if recording is None:
            said = () if trouble is None else (trouble,)
            return (
                TapeFigures(parts=1, gap_s=0.0, missing=0, finished=False, warnings=(*warnings, *said))
                if said
                else None
            )
        # without the states that were there before: each is repeated when the recording begins, with its old stamp
        stamps = np.sort([sample.wall_ns for samples in recording.samples.values() for sample in samples])
        stamps = stamps[stamps >= self._begun_wall_ns]
        return TapeFigures(
            parts=len(recording.parts),
            gap_s=float(np.diff(stamps).max(initial=0)) * 1e-9,
            missing=sum(recording.gaps_that_matter().values()),
            finished=recording.finished,
            warnings=warnings,
        )

    def make_whole(self) -> None:
        """Wait until nothing runs and nothing is recorded any more, for the next case."""
        operator = self._operator
        if operator is not None and operator.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(operator.pid, signal.SIGCONT)
            operator.kill()
        until = time.monotonic() + WHOLE_DEADLINE_S
        while True:
            state = self._stack.read()
            if state is not None and all(row.health is Health.HEALTHY for row in state.services):
                break
            if time.monotonic() > until:
                raise NoService(f"after {self._case.name}: not every service is healthy again")
            time.sleep(_POLL_S)
        self._session.wait_for_services(WHOLE_DEADLINE_S, (*NEEDED, "recorder"))
        with suppress(CrosspihError):
            self._session.bus.call(ABORT, AbortAssembly(), RECORDER_DEADLINE_S)
        with suppress(CrosspihError):
            self._session.bus.call(RECORD_STOP, StopRecording(), RECORDER_DEADLINE_S)
