"""`air-router replay`: does the program decide today as it did in a recorded flight?"""

import argparse

from air_router.cli.arguments import print_json, say, speed_factor
from air_router.errors import ExitCode
from air_router.record import Log, add_record, record_of, replay_record
from air_router.web import add_web, show, web_of
from mocha_link.errors import needs_extra


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.description = (
        "Give the events of a recorded flight to a new controller and compare what it "
        "decides. Exit code 0: the same; 1: otherwise, the first difference is told; 3: the "
        "record is damaged or holds no decision, so the comparison is not complete."
    )
    parser.epilog = (
        "examples:\n"
        "  air-router replay flight-20261120T234403Z-titan.mcap\n"
        "  air-router replay LOG --web --speed 10    (on a map page)"
    )
    add_record(parser)
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    add_web(parser)
    parser.add_argument(
        "--speed", type=speed_factor, default=1.0, metavar="X", help="of --web: times real time"
    )


def run(arguments: argparse.Namespace) -> int:
    """Replay, and print what came of it."""
    web, path = web_of(arguments), record_of(arguments)
    if web is not None:
        with needs_extra("the page", "web", "air-router"):
            from air_router.live import Playback, RecordedFlight  # noqa: PLC0415
        page = Playback(RecordedFlight(Log(path)), web, speed=arguments.speed)
        show(page, lambda where: say(f"{where}; Ctrl-C ends"))
        return ExitCode.DONE
    log = Log(path)
    result = replay_record(log)
    found = result.difference
    if arguments.json:
        print_json({**result.as_json(), "ending": log.ending})
    else:
        if log.ending is not None:
            result.notes.append(f"the record is not whole: {log.ending}")
        for note in result.notes:
            print(f"note: {note}")
        if found is not None:
            print("\n".join(found.lines()))
        else:
            print(
                f"{log.path.name}: the same {result.actions} decisions on {result.events} events, "
                f"up to {result.until_s:.1f} s"
            )
    if found is not None:
        return ExitCode.ENDED_OTHERWISE
    return ExitCode.INVALID_FILE if log.damaged else ExitCode.DONE
