"""A link that can be cut without a word: `python -m tests.holding.stoppable_link HOST PORT`.

Forwards TCP to HOST:PORT, and prints the port on which it listens. Stopped (SIGSTOP) it carries nothing any more, and
both ends still find it open, as with a pulled cable.
"""

from __future__ import annotations

import contextlib
import socket
import sys
import threading


def carry(source: socket.socket, sink: socket.socket) -> None:
    """Until either end closes."""
    with contextlib.suppress(OSError):
        while part := source.recv(65536):
            sink.sendall(part)
    for end in (source, sink):
        with contextlib.suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


def main(host: str, port: int) -> None:
    """Forward until ended."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(server.getsockname()[1], flush=True)
        while True:
            near, _ = server.accept()
            far = socket.create_connection((host, port))
            for source, sink in ((near, far), (far, near)):
                source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=carry, args=(source, sink), daemon=True).start()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
