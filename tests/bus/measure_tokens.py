"""Whether a busy machine takes a living service's token back: `python -m tests.bus.measure_tokens [BUSY] [SECONDS]`.

Seven processes publish 200 kB every 10 ms beside Python work of their own, BUSY others (20) do nothing but compute.
Prints the tokens that went in SECONDS (40), and how soon that of a stopped process went, three times.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack

from crosspih_common.bus import Bus, open_zenoh

ENDPOINT = "tcp/127.0.0.1:7791"
SERVICES = 7
DEADLINE_S = 60.0


def work(service: str) -> None:
    """Live, compute and publish until ended."""
    transport = open_zenoh(ENDPOINT)
    with Bus(transport, "busy", service) as bus:
        bus.declare_alive()
        sender, pictures = transport.sender(f"busy/{service}", recover=False, history=0), os.urandom(200_000)
        print("up", flush=True)
        while True:
            sum(range(20_000))
            sender.put(pictures, "")
            time.sleep(0.01)


def main(busy: int, seconds: float) -> None:
    """Watch the tokens."""
    with ExitStack() as stack:

        def start(*command: str) -> subprocess.Popen[str]:
            process = subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE, text=True)
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        router = start("-m", "services.router", "--endpoint", ENDPOINT)
        assert router.stdout is not None and router.stdout.readline()
        bus = stack.enter_context(Bus(open_zenoh(ENDPOINT), "busy", "operator"))
        heard: list[tuple[float, str, bool]] = []
        changed = threading.Condition()

        def on_alive(service: str, alive: bool) -> None:
            with changed:
                heard.append((time.monotonic(), service, alive))
                changed.notify_all()

        bus.watch_alive(on_alive)
        services = [start("-m", "tests.bus.measure_tokens", "work", f"s{index}") for index in range(SERVICES)]
        for service in services:
            assert service.stdout is not None and service.stdout.readline()
        for _ in range(busy):
            start("-c", "while True: pass")
        time.sleep(seconds)
        gone = [service for _, service, alive in heard if not alive]
        print(f"in {seconds:g} s beside {busy} busy processes, load {os.getloadavg()[0]:.0f}: tokens taken back {gone}")
        for _ in range(3):
            for number, back in ((signal.SIGSTOP, False), (signal.SIGCONT, True)):
                with changed:
                    known, at_s = len(heard), time.monotonic()
                    services[0].send_signal(number)

                    def told(since: int = known, alive: bool = back) -> bool:
                        return any(one[1:] == ("s0", alive) for one in heard[since:])

                    assert changed.wait_for(told, DEADLINE_S)
                    after_s = next(one[0] for one in heard[known:] if one[1:] == ("s0", back)) - at_s
                print(f"{number.name}: {'back' if back else 'gone'} after {after_s:.2f} s")


if __name__ == "__main__":
    if sys.argv[1:2] == ["work"]:
        work(sys.argv[2])
    else:
        main(int((sys.argv[1:2] or ["20"])[0]), float((sys.argv[2:3] or ["40"])[0]))
