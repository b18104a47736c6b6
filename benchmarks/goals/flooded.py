"""What is flooded, as a process: a node, or a bare ROUTER socket that nothing is read from.

Run by its path: of this checkout it imports nothing, so the node may be that of another one.
"""

import sys
from pathlib import Path


def main() -> None:
    kind, argument = sys.argv[1:]
    if kind == "node":
        from mocha_link import Node, Team  # noqa: PLC0415 - of whichever checkout

        with Node(Team.load(Path(argument)), "titan"):
            _wait()
    else:
        import zmq  # noqa: PLC0415

        with zmq.Context() as context, context.socket(zmq.ROUTER) as router:
            router.bind(f"tcp://127.0.0.1:{argument}")
            _wait()


def _wait() -> None:
    print("ready", flush=True)
    sys.stdin.readline()


if __name__ == "__main__":
    main()
