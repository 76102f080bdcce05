"""`python -m services.operator`, and what the `crosspih` command starts."""

from services.operator.cli.commands import app, main

__all__ = ["app", "main"]

if __name__ == "__main__":
    main()
