"""How a flight stands, in the one line that is live while the vehicle flies."""

from __future__ import annotations

from collections.abc import Mapping

from air_router.controller import Controller
from air_router.controller.model import State
from air_router.vehicle import Telemetry
from air_router.words import wind_words
from mocha_link.links import LinkMetrics


def flight_line(controller: Controller, links: Mapping[str, LinkMetrics]) -> str:
    """State, target, time left in the state, next node, battery and links in one line."""
    parts = [controller.state.name.ljust(6)]
    if controller.states.reachability.no_way_home:
        parts.append("NO WAY HOME")
    blocked = controller.gate.waits_for()
    if blocked is not None:
        context = controller.context
        parts.append(f"waiting: {blocked.why(context)} ({blocked.for_s(context):.0f} s)")
    signals = {
        peer: link.signal.words for peer, link in sorted(links.items()) if link.signal is not None
    }
    sought = controller.context.robot
    if sought is not None:
        parts.append(f"{sought} {signals.pop(sought)}" if sought in signals else sought)
    left_s = controller.context.left_s
    if left_s is not None:
        parts.append(f"{left_s:4.0f} s left")
    elif controller.state is State.SEARCH:
        parts.append("on the way")
    leg = controller.context.way.leg
    if leg is not None:
        node = {None: "point", 0: "home"}.get(leg.node, f"waypoint {leg.node}")
        parts.append(f"-> {node}")
    if controller.context.telemetry is not None:
        parts += _vehicle(controller, controller.context.telemetry)
    if signals:
        parts.append(", ".join(f"{peer} {signal}" for peer, signal in signals.items()))
    return " | ".join(parts)


def _vehicle(controller: Controller, telemetry: Telemetry) -> list[str]:
    parts = [f"{telemetry.altitude_m:z.0f} m"]
    if telemetry.battery is not None:
        need = controller.returns.need_home
        home = "" if need is None else f" (home takes {need:.0%})"
        parts.append(f"battery {telemetry.battery:.0%}{home}")
    if telemetry.wind_m_s is not None:
        parts.append(f"wind {wind_words(telemetry.wind_m_s)}")
    if telemetry.home_moved is not None:
        parts.append("HOME MOVED")
    return parts
