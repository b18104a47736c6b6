"""Runs a bridge in a Python that has ROS and `pyzmq`, but nothing else of ours.

`mocha-link bridge` becomes ``/usr/bin/python3 .../mocha_link/bridges OPTIONS-AS-JSON``. The package
`mocha_link` itself needs more than such a Python has, so its place is taken by an empty one.
"""

import importlib
import sys
import types
from pathlib import Path


def main() -> int:
    """Run `run.main` with nothing of `mocha_link` but what it imports."""
    package = types.ModuleType("mocha_link")
    package.__path__ = [str(Path(__file__).resolve().parents[1])]
    sys.modules["mocha_link"] = package
    try:
        run = importlib.import_module("mocha_link.bridges.run")
    except ModuleNotFoundError as error:
        sys.stderr.write(f"mocha-link: {sys.executable} has no {error.name}; install it there\n")
        return 1
    code: int = run.main(sys.argv[1:])
    return code


if __name__ == "__main__":
    sys.exit(main())
