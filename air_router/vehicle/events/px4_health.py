"""Why a PX4 does not arm, in its own words: they come as events, not as texts, to a companion."""

import asyncio
from collections.abc import Callable
from typing import Final

from mavsdk.plugins.events.events import Events, EventsError, LogLevel

REPORT_S: Final = 3.0
"""Wall-clock limit for the report: its words are fetched from the autopilot first."""

_LOOK_S: Final = 0.2


async def arming_problems(open_events: Callable[[], Events]) -> str:
    """What stands in the way of arming, to add to an error; empty if the autopilot does not say."""
    problems = await reported_problems(open_events, REPORT_S)
    return f" ({'; '.join(problems)})" if problems else ""


async def reported_problems(open_events: Callable[[], Events], limit_s: float) -> tuple[str, ...]:
    """The same as a list, empty if the autopilot does not say within a wall-clock limit."""
    events = open_events()
    try:
        async with asyncio.timeout(limit_s):
            while not (problems := _reported(events)):  # noqa: ASYNC110 - once, and then it ends
                await asyncio.sleep(_LOOK_S)
    except TimeoutError:
        return ()
    finally:
        events.destroy()
    return tuple(problems)


def _reported(events: Events) -> list[str]:
    try:
        report = events.get_health_and_arming_checks_report()
    except EventsError:
        return []  # not available yet, or not at all
    problems = report.current_mode_intention.problems
    return [problem.message for problem in problems if problem.log_level <= LogLevel.ERROR]
