"""`air-router ask`: sends a request to a flight on this machine, and prints the answer."""

import dataclasses
import json
import sys

import click

from air_router.cli.arguments import MORE_THAN_0, number, print_json
from air_router.control import MODELS, ControlClient, endpoint_of, parse_command
from air_router.errors import ExitCode, UsageError
from mocha_link.cli import Options, Parsed, command, option

_EPILOG = """\
examples:
  air-router ask hold
  air-router ask seek io
  air-router ask goto 39.9415,-75.1990,39.9420,-75.1995 --hold-s 30
  air-router ask altitude 45
  air-router ask 24700 status --json
  air-router ask ipc:///tmp/uav resume

exit codes: 0 accepted, 2 wrong usage, 4 no flight answers, 5 refused
"""


@command(
    "Send a request to a flight that runs with --control on this machine.",
    _EPILOG,
    usage="[OPTIONS] [ENDPOINT] VERB [WHAT ...]",
)
@click.argument(
    "words",
    nargs=-1,
    required=True,
    metavar="[ENDPOINT] VERB [WHAT] ...",
    help=f"ENDPOINT: the value of the flight's --control, if not the default; VERB: one of "
    f"{', '.join(MODELS)}; WHAT: NAME for seek, LAT,LON[,LAT,LON...] for goto, METERS for "
    "altitude, optionally upload for resume",
)
@option(
    "--hold-s",
    type=float,
    metavar="S",
    help="for goto: time to hover at the last point, in seconds",
)
@option("--by", metavar="WHO", help="name of the requester, for the flight's record")
@option(
    "--timeout",
    type=Parsed(number("a number of seconds", MORE_THAN_0, 3600.0)),
    metavar="S",
    default=5.0,
    help="time to wait for an answer, in seconds (default 5)",
)
@option("--json", is_flag=True, help="print one JSON object on stdout")
def run(arguments: Options) -> int:
    """Ask, and print the answer."""
    endpoint, words = None, arguments.words
    if len(words) > 1 and words[0] not in MODELS:
        try:
            endpoint, words = endpoint_of(words[0]), words[1:]
        except ValueError as error:
            raise UsageError(str(error)) from None
    command = parse_command(" ".join(words))
    values = command.model_dump(exclude_none=True)
    if arguments.hold_s is not None:
        values["hold_s"] = arguments.hold_s
    values["by"] = arguments.by
    with ControlClient(endpoint, by=arguments.by, timeout_s=arguments.timeout) as client:
        if command.request == "reload":  # it is read after the answer: what came of it?
            answer = {"ok": True, "id": command.id, **dataclasses.asdict(client.reload())}
        else:
            answer = client.request(values)
    if arguments.json:
        print_json(answer)
    elif "accepted" not in answer:
        for key, value in answer.items():
            if key not in {"ok", "id"}:
                sys.stdout.write(f"{key:14} {json.dumps(value)}\n")
    else:
        _print_reply(answer)
    return ExitCode.DONE if answer.get("accepted", True) is True else ExitCode.REFUSED


def _print_reply(answer: dict[str, object]) -> None:
    verdict = "accepted" if answer["accepted"] is True else f"refused [{answer.get('code')}]"
    sys.stdout.write(f"{verdict}: {answer.get('why')}\n")
    points = answer.get("points")
    for point in points if isinstance(points, list) else ():
        sys.stdout.write(f"  {','.join(map(str, point))}\n")
