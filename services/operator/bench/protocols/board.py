"""`python -m services.operator.bench.protocols.board hand|flange|away`: moves the board in the cell that `crosspih cell
practise` has started: held as a person would hold it in each picture, clamped to the flange, or away.
"""

from __future__ import annotations

import argparse
import socket
import sys

from services.operator.bench.protocols.plants import SEEN_PORT

ANSWER_S = 5.0


def put_board(where: str) -> bool:
    """Put the board there; False where nobody answers."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.settimeout(ANSWER_S)
        one.sendto(where.encode("ascii"), ("127.0.0.1", SEEN_PORT))
        try:
            return one.recv(64).decode("ascii") == where
        except OSError:
            return False


def main() -> int:
    """Status 1 where no such cell runs in this network."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("where", choices=("hand", "flange", "away"))
    where = parser.parse_args().where
    if put_board(where):
        print(f"the board: {where}")
        return 0
    print("nobody answers: do it in the shell of `crosspih cell practise`", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
