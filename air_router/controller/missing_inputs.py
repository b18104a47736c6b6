"""What follows where inputs of a flight are missing: a fix, a position, the battery."""

from __future__ import annotations

from dataclasses import dataclass

from air_router.controller.envelope import ReturnMonitor
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.states import Signal, State
from air_router.controller.motion.command_gate import CommandGate
from air_router.vehicle.input_limits import InputStatus, Stop
from air_router.vehicle.vehicle import Telemetry


@dataclass(slots=True, eq=False)
class MissingInputs:
    """Has a vehicle that flies by our commands hold, or come home, for what is not heard of it.

    Args:
        context: Which inputs are missing; where it says so.
        gate: Has it hold.
        returns: Looks at time and charge, which go on meanwhile.
    """

    _context: MissionContext
    _gate: CommandGate
    _returns: ReturnMonitor

    def follow(self, status: InputStatus, telemetry: Telemetry) -> bool:
        """Tell which inputs are missing; whether too few of them come to fly on by."""
        context = self._context
        landing = context.state is State.LAND  # PX4 does so without a position too
        for what, then in status.news:
            context.say(f"{what}: {'landing on' if landing else then}" if then else what)
        if status.home_why is not None:
            context.come_home(status.home_why)
        if context.state is State.READY:
            return False
        if status.stop is Stop.NONE:
            if status.back:
                context.retry_in(0.0)
            return False
        may_retry = context.take_retry() or context.retry_at_s is None
        if status.stop is Stop.HOLD and not landing and may_retry:
            self._gate.hold(status.why)  # unless that is what it does
        self._returns.check(telemetry)  # time and charge go on
        if context.left_s == 0.0 and context.zones is None:
            context.signal(Signal.TIMER)
        return True
