"""The live status line of a flight."""

from __future__ import annotations

from air_router.controller import FlightStatus
from air_router.controller.model import State
from air_router.vehicle import Telemetry
from air_router.words import wind_words


def flight_line(status: FlightStatus) -> str:
    """State, target, time left in the state, next node, battery and links in one line."""
    parts = [status.state.name.ljust(6)]
    if status.no_way_home:
        parts.append("NO WAY HOME")
    if status.waiting is not None:
        parts.append(f"waiting: {status.waiting.why} ({status.waiting_s:.0f} s)")
    signals = {
        peer: link.signal.text
        for peer, link in sorted(status.links.items())
        if link.signal is not None
    }
    sought = status.robot
    if sought is not None:
        parts.append(f"{sought} {signals.pop(sought)}" if sought in signals else sought)
    if status.left_s is not None:
        parts.append(f"{status.left_s:4.0f} s left")
    elif status.state is State.SEARCH:
        parts.append("on the way")
    if status.legs:
        number = status.legs[0].node
        node = {None: "point", 0: "home"}.get(number, f"waypoint {number}")
        parts.append(f"-> {node}")
    if status.telemetry is not None:
        parts += _vehicle(status.telemetry, status.need_home)
    if signals:
        parts.append(", ".join(f"{peer} {signal}" for peer, signal in signals.items()))
    return " | ".join(parts)


def _vehicle(telemetry: Telemetry, need: float | None) -> list[str]:
    parts = [f"{telemetry.altitude_m:z.0f} m"]
    if telemetry.battery is not None:
        home = "" if need is None else f" (home takes {need:.0%})"
        parts.append(f"battery {telemetry.battery:.0%}{home}")
    if telemetry.wind_m_s is not None:
        parts.append(f"wind {wind_words(telemetry.wind_m_s)}")
    if telemetry.home_moved is not None:
        parts.append("HOME MOVED")
    return parts
