"""Replays the event log of a run into fresh controllers, as a flight's record is replayed."""

from __future__ import annotations

import dataclasses
import json
from collections import deque
from collections.abc import Iterable

from air_router.controller.model.actions import Motion
from air_router.record import serialization
from air_router.record.log import RecordEntry
from air_router.record.replay import Replay
from air_router.record.replay import replay as replay_flight
from air_router.record.serialization import ORDER_KEY, RECENT
from sitl.experiment.robots.node import fleet_of
from sitl.experiment.robots.scenery import scenery_of
from sitl.experiment.robots.uav import controllers_of
from sitl.experiment.settings import RunSettings


def replay(settings: RunSettings, lines: Iterable[str]) -> dict[str, Replay]:
    """What came of replaying each UAV's part of a log.

    Args:
        settings: Those of the run.
        lines: Its event log (`RunSettings.keep_log`).

    Raises:
        CodecError: a line holds no event or action.
        ReplayError: a UAV has no event in it.
    """
    original = settings.protocol == "original"
    fleet = fleet_of(settings.uavs, settings.ugvs, base=settings.base_station, original=original)
    controllers = controllers_of(fleet, scenery_of(settings), settings)
    entries = entries_of(lines)
    return {
        uav: replay_flight(entries.get(uav, []), controller)
        for uav, controller in controllers.items()
    }


def entries_of(lines: Iterable[str]) -> dict[str, list[RecordEntry]]:
    """A log's events and actions of each UAV, as a flight's record has them."""
    entries: dict[str, list[RecordEntry]] = {}
    motions: dict[str, deque[tuple[int, Motion]]] = {}
    for line in lines:
        data = json.loads(line)
        uav = data.get("uav")
        if uav is None:
            continue
        recent = motions.setdefault(uav, deque(maxlen=RECENT))
        kind = "event" if "event" in data else "action"
        value = serialization.decode(data[kind])
        order = data.get(ORDER_KEY)
        if isinstance(value, Motion):
            recent.append((order, value))
        elif order is not None:
            # Of motions that are alike the controller knows its own: the object counts.
            value = dataclasses.replace(value, action=dict(recent)[order])
        entries.setdefault(uav, []).append(RecordEntry(data["t"], kind, value))
    return entries
