"""`python -m services.operator.doctor.loading MODULE...`: imports each, and prints {module: error} for
those that fail.
"""

from __future__ import annotations

import contextlib
import json
import sys
from importlib import import_module


def main(modules: list[str]) -> int:
    """Load them all in one process, as a service does."""
    failed: dict[str, str] = {}
    with contextlib.redirect_stdout(sys.stderr):
        for module in modules:
            print(f"loading {module}", file=sys.stderr, flush=True)
            try:
                import_module(module)
            except Exception as error:
                failed[module] = f"{type(error).__name__}: {error}"
    print(json.dumps(failed))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
