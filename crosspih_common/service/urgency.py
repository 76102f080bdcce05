"""Raises the scheduling priority of a process that does little but must be on time."""

from __future__ import annotations

import os

PRIORITY = 1  # the lowest of the real-time ones: ahead of every ordinary process
NICE = -10


def be_urgent() -> str:
    """Ask for real-time scheduling, or else for a better nice value; what was granted, empty when nothing was.

    Linux grants it to root, CAP_SYS_NICE, or by `ulimit -r` / `ulimit -e` (systemd: LimitRTPRIO=, LimitNICE=). Only for
    a process that sleeps nearly always; its later threads inherit it (and so would processes that it starts).
    """
    if hasattr(os, "SCHED_RR"):
        try:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
        except OSError:
            pass  # not permitted; try the next best
        else:
            return "real time"
    try:
        return f"nice {os.nice(NICE)}"
    except OSError:
        return ""
