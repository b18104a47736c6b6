"""`air-router`, and `python -m air_router`: an interrupt is one line from the first import on."""

import sys

from mocha_link.lifetime import leave_when_interrupted


def main() -> int:
    """Run the program; returns its exit code."""
    leave_when_interrupted()
    from air_router.cli import cli  # noqa: PLC0415 - what takes its time

    code = cli.main()
    leave_when_interrupted()
    return code


if __name__ == "__main__":
    sys.exit(main())
