"""`python -m services.hardware.drivers`: every driver that is there, as one JSON array, for `crosspih cell drivers`."""

from __future__ import annotations

import contextlib
import json
import sys

from services.hardware.drivers.listing import drivers


def main() -> int:
    """Print it."""
    with contextlib.redirect_stdout(sys.stderr):  # a package may talk while it is imported
        found = [one.as_json() for one in drivers()]
    print(json.dumps(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
