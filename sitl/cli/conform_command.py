"""`sitl conform`: hold the recorded conversations with a vehicle, and report where it departs."""

import contextlib
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from typing import NamedTuple

import click

from air_router.cli import px4_version_option, speed_factor
from air_router.errors import ExitCode, UsageError
from air_router.vehicle.px4 import FLOWN, NEWEST, OLDEST, Version, name_of
from mocha_link.cli import Options, Parsed, command, option, optional
from sitl.cli.arguments import instance
from sitl.cli.vehicle_command import PX4_HOME
from sitl.conformance import (
    Conversation,
    Line,
    LinkKind,
    LocalLine,
    Outcome,
    SilentVehicleError,
    UdpLine,
    conversations,
    converse,
    reported_version,
    table_of_facts,
    table_of_steps,
)
from sitl.mavlink import Frame, VehicleSettings
from sitl.process import Px4Install, Px4Process, Px4Settings, find_px4

_EPOCH_S = 1.7e9
_EPILOG = """\
Without --px4 the vehicle is that of `sitl vehicle`, in this process and as fast as possible. With
--px4 every conversation starts a real PX4. To compare the two, run both with --json.

examples:
  sitl conform goto fence
  sitl conform --px4 ~/PX4-Autopilot --speed 5 --json > px4.json

exit codes: 0 all answers equal, 1 answers differ, 2 wrong usage, 4 no vehicle, or one of its ports
is in use
"""


@command(
    "Run scripted MAVLink conversations with a vehicle and report answers that differ from PX4's.",
    _EPILOG,
)
@click.argument(
    "names",
    nargs=-1,
    required=False,
    metavar="[NAME ...]",
    help="only conversations with one of these texts in their name (default: all)",
)
@option(
    "--px4",
    **optional(""),
    metavar="[PATH]",
    help="test a real PX4, at PATH or where `sitl px4` finds it",
)
@option(
    "--speed",
    type=Parsed(speed_factor),
    metavar="X",
    default=5.0,
    help="speed of a real PX4, times real time, 0.1 to 100 (default 5)",
)
@option(
    "--instance",
    type=Parsed(instance),
    metavar="N",
    help="PX4 instance number, 0 to 250 (default: the first free one)",
)
@px4_version_option("the simulated vehicle behaves like")
@option("--json", is_flag=True, help="print the outcomes as JSON")
@option("--list", is_flag=True, help="only list the conversations")
@option(
    "--differences",
    is_flag=True,
    help="list the differences between PX4 versions, as Markdown tables",
)
def run(arguments: Options) -> int:
    """Run the conversations; return 0 if all answers are as recorded."""
    if arguments.differences:
        print(f"{table_of_facts()}\n\n{table_of_steps()}")
        return ExitCode.DONE
    chosen = _chosen(arguments.names)
    if arguments.list:
        for conversation in chosen:
            print(f"{conversation.name}: {conversation.fact} [{conversation.recorded}]")
        return ExitCode.DONE
    px4 = None
    version = arguments.px4_version or NEWEST
    if arguments.px4 is not None:
        px4 = _Px4(find_px4(arguments.px4 or None), arguments.speed, arguments.instance)
        version = _version_of(px4)
    print(f"PX4 {name_of(version)}", file=sys.stderr, flush=True)
    outcomes: list[Outcome] = []
    for conversation in chosen:
        if not conversation.is_held_with(version):
            continue
        with contextlib.closing(_line_for(conversation, version, px4)) as line:
            outcome = converse(conversation, line, version)
        verdict = "held    " if outcome.held else "DEPARTED"
        print(f"{verdict} {outcome.name} {outcome.departure}".rstrip(), file=sys.stderr, flush=True)
        outcomes.append(outcome)
    if arguments.json:
        print(json.dumps([asdict(outcome) for outcome in outcomes], indent=1))
    held = sum(outcome.held for outcome in outcomes)
    print(f"{held} held, {len(outcomes) - held} departed", file=sys.stderr)
    return ExitCode.DONE if held == len(outcomes) else ExitCode.ENDED_OTHERWISE


def _chosen(names: list[str]) -> list[Conversation]:
    chosen = [
        one for one in conversations() if not names or any(name in one.name for name in names)
    ]
    if not chosen:
        raise UsageError(f"no conversation is called {' or '.join(names)}; see sitl conform --list")
    return chosen


class _Px4(NamedTuple):
    """A real PX4, and how it is started for every conversation.

    Attributes:
        install: Which.
        speed: Times real time.
        instance: PX4's; None: the first that is free.
    """

    install: Px4Install
    speed: float
    instance: int | None


def _line_for(conversation: Conversation, version: Version, px4: _Px4 | None) -> Line:
    """To a vehicle that is started for it."""
    if px4 is not None:
        return _Px4Line(px4, conversation.started_with)
    ground_link = LinkKind.GROUND in conversation.links
    return LocalLine(
        VehicleSettings(
            PX4_HOME,
            seed=1,
            start_unix_s=_EPOCH_S,
            parameters=conversation.started_with,
            ground_link=ground_link,
            version=version,
        )
    )


def _version_of(px4: _Px4) -> Version:
    """The version that a PX4 reports; it is started for that."""
    with contextlib.closing(_Px4Line(px4, {})) as line:
        found = reported_version(line)
    if found not in FLOWN:
        known = f"{name_of(OLDEST)} to {name_of(NEWEST)}"
        raise UsageError(
            f"{px4.install.description} is PX4 {name_of(found)}; what is known is {known}"
        )
    return found


class _Px4Line(UdpLine):
    """A PX4 of its own for one conversation."""

    def __init__(self, px4: _Px4, parameters: Mapping[str, float]) -> None:
        settings = Px4Settings(PX4_HOME, px4.speed, parameters, px4.instance)
        self._process = Px4Process(px4.install, settings)
        number = self._process.instance
        ports = {LinkKind.API: 14540 + number, LinkKind.GROUND: 14550}
        super().__init__(ports, system_id=number + 1, time_scale=px4.speed)

    def listen(self) -> list[tuple[LinkKind, Frame]]:
        """See `Line`: a PX4 that has ended has its last output in the error."""
        try:
            return super().listen()
        except SilentVehicleError as error:
            raise SilentVehicleError(f"{error}; {self._process.last_output()}") from None

    def close(self) -> None:
        """See `Line`: also ends the PX4; so does a port that is taken."""
        super().close()
        self._process.close()
