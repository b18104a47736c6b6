"""`sitl conform`: hold the recorded conversations with a vehicle, and say where it departs."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from air_router.cli.arguments import speed_factor
from air_router.errors import ExitCode, UsageError
from sitl.cli.vehicle_command import PX4_HOME
from sitl.conformance.conversation import (
    Conversation,
    Outcome,
    Start,
    beside,
    conversations,
    converse_all,
)
from sitl.conformance.line import Line, Link, LocalLine, SilentVehicleError, UdpLine
from sitl.mavlink.mavlink_codec import Frame
from sitl.mavlink.mavlink_vehicle import VehicleSettings
from sitl.process.px4_install import Px4Install, find_px4
from sitl.process.px4_process import Px4Process, Px4Settings
from sitl.px4sim.state.px4_modes import VERSIONS

_EPOCH_S = 1.7e9
_EPILOG = """\
Without --connect or --px4 the vehicle is our own, in this process and as fast as it computes.
With --px4 a real PX4 is started anew for every conversation. --connect takes a vehicle that runs:
IT IS ARMED AND FLOWN: never one with propellers. It is not started anew between conversations, so
only those on the ground are held unless they are named.

examples:
  sitl conform
  sitl conform --px4 ~/PX4-Autopilot --speed 5 --json > px4.json
  sitl conform --beside px4.json > beside.md

exit codes: 0 the vehicle held to all of them, 1 it departed, 2 wrong usage, 4 no vehicle, or a port
of its is taken
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.description = "Hold recorded conversations with a vehicle and report where it departs."
    parser.epilog = _EPILOG
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="only those whose name contains this"
    )
    whom = parser.add_mutually_exclusive_group()
    whom.add_argument(
        "--connect", metavar="URL", help="a simulated vehicle that runs, udpin://127.0.0.1:14540"
    )
    whom.add_argument(
        "--px4",
        nargs="?",
        const="",
        metavar="PATH",
        help="a real PX4, found as `sitl px4` finds it, or there",
    )
    parser.add_argument(
        "--gcs", metavar="URL", help="with --connect: where its ground station link is sent to"
    )
    parser.add_argument(
        "--speed",
        type=speed_factor,
        default=5.0,
        metavar="X",
        help="of PX4, times real time (default 5)",
    )
    parser.add_argument(
        "--px4-version", choices=VERSIONS, default=VERSIONS[0], help="that ours behaves as"
    )
    parser.add_argument("--json", action="store_true", help="the outcomes as JSON")
    parser.add_argument("--list", action="store_true", help="only list the conversations")
    parser.add_argument(
        "--beside", type=Path, metavar="FILE", help="as a Markdown table beside another run's JSON"
    )


def run(arguments: argparse.Namespace) -> int:
    """Hold the conversations; returns 0 if the vehicle held to all of them."""
    chosen = _chosen(arguments)
    if arguments.list:
        for conversation in chosen:
            print(f"{conversation.name}: {conversation.fact} [{conversation.recorded}]")
        return ExitCode.DONE
    other = _other(arguments.beside)
    outcomes = converse_all(chosen, _dialler(arguments), _tell)
    if arguments.json:
        print(json.dumps([asdict(outcome) for outcome in outcomes], indent=1))
    elif other is not None:
        print(beside(chosen, outcomes, other))
    departed = sum(not outcome.held and not outcome.left_out for outcome in outcomes)
    held = sum(outcome.held for outcome in outcomes)
    left_out = len(outcomes) - departed - held
    print(f"{held} held, {departed} departed, {left_out} left out", file=sys.stderr)
    return ExitCode.ENDED_OTHERWISE if departed else ExitCode.DONE


def _chosen(arguments: argparse.Namespace) -> tuple[Conversation, ...]:
    names = arguments.names
    chosen = tuple(
        conversation
        for conversation in conversations()
        if not names or any(name in conversation.name for name in names)
    )
    if arguments.connect is not None and not names:
        chosen = tuple(
            conversation for conversation in chosen if conversation.start is Start.GROUND
        )
    if not chosen:
        raise UsageError(f"no conversation is called {' or '.join(names)}; see sitl conform --list")
    return chosen


def _other(path: Path | None) -> list[Outcome] | None:
    if path is None:
        return None
    try:
        rows: list[dict[str, Any]] = json.loads(path.read_text())
        return [Outcome(**(row | {"notes": tuple(row["notes"])})) for row in rows]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise UsageError(f"{path}: not the JSON of `sitl conform --json`: {error}") from None


def _dialler(arguments: argparse.Namespace) -> Callable[[Conversation], Line]:
    if arguments.connect is not None:
        ports = {Link.API: _port(arguments.connect)}
        if arguments.gcs is not None:
            ports[Link.GROUND] = _port(arguments.gcs)
        return lambda _: UdpLine(ports, fresh=False)
    if arguments.px4 is not None:
        install = find_px4(arguments.px4 or None)
        return lambda _: _Px4Line(install, arguments.speed)
    return lambda conversation: LocalLine(
        VehicleSettings(
            PX4_HOME,
            seed=1,
            start_unix_s=_EPOCH_S,
            ground_link=Link.GROUND in conversation.links,
            px4_version=arguments.px4_version,
        )
    )


class _Px4Line(UdpLine):
    """A PX4 of its own for one conversation."""

    def __init__(self, install: Px4Install, speed_factor: float) -> None:
        with contextlib.ExitStack() as stack:
            process = Px4Process(install, Px4Settings(PX4_HOME, speed=speed_factor))
            stack.enter_context(process)
            ports = {Link.API: 14540 + process.instance, Link.GROUND: 14550}
            super().__init__(ports, fresh=True)
            self._process = process
            self._stack = stack.pop_all()

    def listen(self) -> list[tuple[Link, Frame]]:
        """See `Line`: a PX4 that has ended says why."""
        try:
            return super().listen()
        except SilentVehicleError as error:
            raise SilentVehicleError(f"{error}; {self._process.last_words()}") from None

    def close(self) -> None:
        """See `Line`: also ends the PX4."""
        super().close()
        stack: contextlib.ExitStack | None = getattr(self, "_stack", None)
        if stack is not None:
            stack.close()


def _port(url: str) -> int:
    parts = urlsplit(url)
    try:
        port = parts.port
    except ValueError:
        port = None
    if parts.scheme not in ("udpin", "udp") or port is None:
        raise UsageError(f"'{url}': conversations go over UDP; write udpin://127.0.0.1:14540")
    return port


def _tell(outcome: Outcome) -> None:
    word = "held    " if outcome.held else "left out" if outcome.left_out else "DEPARTED"
    print(f"{word} {outcome.name} {outcome.departure}".rstrip(), file=sys.stderr, flush=True)
