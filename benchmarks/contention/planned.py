"""A run of an experiment as nodes notice it: who meets whom when, and who publishes what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from mocha_link.team import Team
from sitl.experiment import RunSettings, Task, load_experiment
from sitl.experiment.campaign import settings_of
from sitl.experiment.engine import Run, airtime_measures
from sitl.experiment.robots import REFRESH_S

Measures = Mapping[str, float | int | None]


@dataclass(frozen=True, slots=True)
class Publication:
    """A robot publishes a message.

    Attributes:
        at_s: Since the beginning of the run.
        robot: Its name.
    """

    at_s: float
    robot: str
    topic: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Meeting:
    """Two robots come into contact, or lose it; times as with publications."""

    at_s: float
    a: str
    b: str
    up: bool


@dataclass(frozen=True, slots=True)
class Planned:
    """A run that is to be repeated by real nodes.

    Attributes:
        team: With the addresses of the experiment.
        events: What happens, in order.
        measures: What the experiment measured of its channel.
    """

    label: str
    settings: RunSettings
    seed: int
    team: Team
    events: tuple[Publication | Meeting, ...]
    measures: Measures


def planned(task: Task, duration_s: float) -> Planned:
    """Make a run in which every robot publishes what is new once a second.

    In other runs a robot publishes when a peer is about to request, so what it publishes would
    depend on when the channel is free.
    """
    run = Run(settings_of(task).model_copy(update={"duration_s": duration_s}), task.seed)
    published: list[Publication] = []

    def publish(name: str, original: Any, topic: str, data: bytes) -> None:
        published.append(Publication(run.queue.now_s, name, topic, data))
        original(topic, data)

    for node in run.nodes:
        node.publish = partial(publish, node.name, node.publish)  # type: ignore[method-assign]
        run.queue.every(REFRESH_S, node.refresh)
    run.finish()
    names = run.fleet.names
    met = [
        Meeting(at_s, names[contact.a], names[contact.b], up)
        for contact in run.contacts
        for at_s, up in ((contact.began_s, True), (contact.ended_s, False))
    ]
    return Planned(
        *(task.row.label, run.settings, task.seed, run.fleet.team),
        tuple(sorted((*published, *met), key=lambda event: event.at_s)),
        airtime_measures(run.airtime, run.channel_sim.open, run.settings.duration_s),
    )


def tasks_of(name: str, rows: Sequence[str], numbers: range) -> list[Task]:
    """Runs of a shipped experiment.

    Args:
        rows: Which rows, as `sitl experiment --rows` has them.
        numbers: Of the seeds.
    """
    experiment, _ = load_experiment(name)
    return [experiment.task(row, number) for row in experiment.chosen(rows) for number in numbers]
