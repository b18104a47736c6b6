import asyncio
from types import SimpleNamespace

import pytest
from mavsdk.plugins.events.events import EventsError, EventsResult, LogLevel

from air_router.vehicle.events import px4_health


class Reports:
    """The events of an autopilot that has its report ready after some questions."""

    def __init__(self, problems, *, after):
        self.problems = problems
        self.after = after
        self.destroyed = False

    def get_health_and_arming_checks_report(self):
        self.after -= 1
        if self.after >= 0:
            raise EventsError(EventsResult.NOT_AVAILABLE, "report")
        problems = [SimpleNamespace(message=m, log_level=level) for m, level in self.problems]
        return SimpleNamespace(current_mode_intention=SimpleNamespace(problems=problems))

    def destroy(self):
        self.destroyed = True


@pytest.mark.parametrize(
    ("after", "said"), [(2, " (No compass; No connection to the ground station)"), (10**9, "")]
)
def test_what_stands_in_the_way_of_arming(monkeypatch, after, said):
    problems = [
        ("No compass", LogLevel.ERROR),
        ("No manual control input", LogLevel.WARNING),  # does not keep it from arming
        ("No connection to the ground station", LogLevel.CRITICAL),
    ]
    reports = Reports(problems, after=after)
    monkeypatch.setattr(px4_health, "REPORT_S", 0.1)
    monkeypatch.setattr(px4_health, "_LOOK_S", 0.001)
    assert asyncio.run(px4_health.arming_problems(lambda: reports)) == said
    assert reports.destroyed
