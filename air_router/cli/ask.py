"""`air-router ask`: has a flight on this machine do something, and says what became of it."""

import argparse
import dataclasses
import json
import sys

from air_router.cli.arguments import MORE_THAN_0, number, print_json
from air_router.control import MODELS, ControlClient, endpoint_of, parse_command
from air_router.errors import ExitCode, UsageError

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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.description = "Have a flight that runs with --control on this machine do something."
    parser.usage = "%(prog)s [-h] [ENDPOINT] VERB [WHAT ...] [options]"
    parser.epilog = _EPILOG
    parser.add_argument(
        "words",
        nargs="+",
        metavar="[ENDPOINT] VERB [WHAT]",
        help="ENDPOINT: the flight's --control, if that has one; VERB: one of "
        f"{', '.join(MODELS)}; WHAT: of seek NAME, of goto LAT,LON[,LAT,LON...], "
        "of altitude METRES, of resume upload",
    )
    parser.add_argument(
        "--hold-s", type=float, metavar="S", help="goto: hover at the last point for so long"
    )
    parser.add_argument("--by", metavar="WHO", help="who asks, for the flight's record")
    parser.add_argument(
        "--timeout",
        type=number("a number of seconds", MORE_THAN_0, 3600.0),
        default=5.0,
        metavar="S",
        help="for an answer (default 5 s)",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")


def run(arguments: argparse.Namespace) -> int:
    """Ask, and print the answer."""
    endpoint, words = None, arguments.words
    if len(words) > 1 and words[0] not in MODELS:
        try:
            endpoint, words = endpoint_of(words[0]), words[1:]
        except argparse.ArgumentTypeError as error:
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
        _tell(answer)
    return ExitCode.DONE if answer.get("accepted", True) is True else ExitCode.REFUSED


def _tell(answer: dict[str, object]) -> None:
    word = "accepted" if answer["accepted"] is True else f"refused [{answer.get('code')}]"
    sys.stdout.write(f"{word}: {answer.get('why')}\n")
    points = answer.get("points")
    for point in points if isinstance(points, list) else ():
        sys.stdout.write(f"  {','.join(map(str, point))}\n")
