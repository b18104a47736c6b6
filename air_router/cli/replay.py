"""`air-router replay`: does the program decide today as it did in a recorded flight?"""

from air_router.cli.arguments import print_json, say, speed_factor
from air_router.errors import ExitCode
from air_router.record import Log, record_argument, record_of, replay_record
from air_router.web import show, web_of, web_options
from mocha_link.cli import Options, Parsed, command, option
from mocha_link.errors import needs_extra


@command(
    "Feed the events of a recorded flight to a new controller and compare its decisions. Exit "
    "code 0: same decisions; 1: different decisions, the first is printed; 3: the record is "
    "damaged or has no decisions, so the comparison is incomplete.",
    "examples:\n"
    "  air-router replay flight-20261120T234403Z-titan.mcap\n"
    "  air-router replay LOG --web --speed 10    (on a map page)",
)
@record_argument
@option("--json", is_flag=True, help="print one JSON object on stdout")
@web_options()
@option(
    "--speed",
    type=Parsed(speed_factor),
    metavar="X",
    default=1.0,
    help="playback speed with --web, times real time, 0.1 to 100 (default 1)",
)
def run(arguments: Options) -> int:
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
