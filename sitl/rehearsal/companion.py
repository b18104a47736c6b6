"""One life of a companion computer in a rehearsal: the real flight shell on a simulated clock."""

from __future__ import annotations

import asyncio
import math
import selectors
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, cast

from air_router.errors import AirRouterError
from air_router.flight import Flight, StatusLine
from air_router.gossip import Gossip, Mapper
from air_router.mission import load_mission, sought, team_of
from air_router.preflight import PreflightSurvey
from air_router.record import Recorder
from air_router.vehicle import VehicleClock
from air_router.vehicle.px4 import Px4Vehicle
from mocha_link import Node
from sitl.rehearsal.fakes import Fields, NodeStandIn, Send, StandIn

EPOCH_S: Final = 1_790_000_000.0
"""Unix time of simulated time zero."""

START: Final = datetime.fromtimestamp(EPOCH_S, UTC)
"""The same moment."""

_URL: Final = "udpin://127.0.0.1:14540"
_CRASHED: Final = 70
"""Exit code of a program that ended by an error of its own."""
_SOON_S: Final = 1e-9


class World:
    """Whatever goes on while the loop waits; here: time, and nothing in it.

    Attributes:
        now_s: Simulated seconds.
    """

    def __init__(self, now_s: float = 0.0) -> None:
        self.now_s = now_s

    def advance(self, until_s: float) -> list[Callable[[], object]]:
        """Let time pass until then, or until there is something for the loop: what it is to call.

        Raises:
            BaseException: the loop is to end, in whatever state it is.
        """
        self.now_s = until_s
        return []


class SimulatedLoop(asyncio.SelectorEventLoop):
    """Where another loop would wait for sockets, this one lets the world go on.

    Signals and keyboards are left alone; what would run in another thread runs at once.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        super().__init__(_Waiting(self))
        self._clock_resolution = _SOON_S  # asyncio's own: a timer is due so much early

    def time(self) -> float:
        """Simulated seconds."""
        return self.world.now_s

    def call_soon_threadsafe(  # type: ignore[override]
        self, callback: Callable[..., object], *args: Any, context: Any = None
    ) -> asyncio.Handle:
        """There is one thread."""
        return self.call_soon(callback, *args, context=context)

    def run_in_executor(self, *args: Any, **_: Any) -> Any:  # type: ignore[override]
        """Run it now; only the result comes later."""
        _executor, function, *arguments = args
        future = self.create_future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:  # noqa: BLE001 - as an executor hands it on
            future.set_exception(error)
        return future

    def add_signal_handler(self, *_: Any, **__: Any) -> None:  # type: ignore[override]
        """Simulated programs get no signals."""

    def remove_signal_handler(self, *_: Any, **__: Any) -> bool:
        """There is none."""
        return False

    def add_reader(self, *_: Any, **__: Any) -> None:  # type: ignore[override]
        """Nor a keyboard."""

    def remove_reader(self, *_: Any, **__: Any) -> bool:
        """There is none."""
        return False


class _Waiting(selectors.SelectSelector):
    """Selects nothing ever; waiting is what the world goes on in."""

    def __init__(self, loop: SimulatedLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[Any]:
        """Let so much time pass, or less if something comes."""
        if timeout is None or timeout > 0.0:
            world = self._loop.world
            until_s = math.inf if timeout is None else world.now_s + timeout + _SOON_S
            for callback in world.advance(until_s):
                self._loop.call_soon(callback)
        return []


class Companion:
    """Flies a mission with `air_router.flight.flight.Flight` until it ends, or its power is cut.

    Args:
        path: The mission file.
        world: Goes on while the companion waits.
        send: Sends a message to the vehicle.
        output: Takes the lines that the operator sees.
        arm: Arm it, and take off.
        resume: Go on with a flight that is under way.
        records: The folder of its records; None: it keeps none.
        uav: Which of several UAVs it flies; None: the first.
        start: When it is to take off, for zones with hours; None: now, by the clock on the wall.

    Attributes:
        flight: The shell that flies.
        node: Its node in the team.
        exit_code: How `air-router fly` would have ended; None: it has not.
        outcome: As text.
        report: What `--json` prints.
    """

    def __init__(  # noqa: PLR0913 - all that a life is made of
        self,
        path: Path,
        world: World,
        send: Send,
        output: Callable[[str], None],
        *,
        arm: bool = True,
        resume: bool = False,
        records: Path | None = None,
        uav: str | None = None,
        start: datetime | None = None,
        result_first: bool = False,
    ) -> None:
        self._result_first = result_first
        self._loop = SimulatedLoop(world)
        self._send = send
        self._status = _Status(output, self._loop.time)
        self.exit_code: int | None = None
        self.outcome = ""
        self.report: Mapping[str, Any] = {}
        self._recorder = Recorder(records, str(path))
        mission = load_mission(path, uav=uav, start=start, in_flight=resume)
        team, uav = team_of(mission, None)
        clock = VehicleClock(self._loop.time, self._unix_s)
        mapper = Mapper(mission)
        self.node = NodeStandIn(team, uav, clock.now_s)
        self._link: StandIn | None = None  # of the present life of MAVSDK; None: not opened yet
        self.flight = Flight(
            mission,
            Px4Vehicle(mission, _URL, clock, connection=self._connect),
            clock=clock,
            gossip=Gossip(
                mission.frame,
                team,
                uav,
                clock,
                mapper,
                goals_from=mission.goals_from,
                node=cast("Node", self.node),
            ),
            mapper=mapper,
            seek=sought(team, uav, mission.seek, mission.goals_from),
            recorder=self._recorder,
            status=self._status,
            arm=arm,
            resume=resume,
            survey=lambda router: PreflightSurvey(mission, router, uav=uav, unix=self._unix_s),
        )

    def run(self) -> None:
        """Fly to the end of the flight.

        Raises:
            BaseException: what the world raised while the companion waited: it is off now.
        """
        try:
            result = self._loop.run_until_complete(self.flight.run())
        except AirRouterError as error:
            self.exit_code, self.outcome = error.exit_code, str(error)
        except Exception as error:  # noqa: BLE001 - the program would have ended with it
            self.exit_code, self.outcome = _CRASHED, f"{type(error).__name__}: {error}"
        else:
            self.exit_code, self.outcome = result.exit_code, result.outcome
            self.report = result.report
        finally:
            self._bury()

    @property
    def in_charge(self) -> bool:
        """Whether it holds the vehicle for its own."""
        return self.flight.controller.in_charge

    def receive(self, name: str, fields: Fields, sender: tuple[int, int] | None = None) -> None:
        """A message of the vehicle has come, or of another system and component."""
        if self._link is not None:
            self._link.receive(name, fields, sender)

    def _connect(self, url: str, system_id: int) -> StandIn:
        self._link = StandIn(self._send, url, system_id, result_first=self._result_first)
        return self._link

    def _unix_s(self) -> float:
        return EPOCH_S + self._loop.time()

    def _bury(self) -> None:
        """Let its coroutines end where they cannot move anything any more."""
        self._status.output = lambda _text: None
        self._recorder.close()
        self._loop.world = World(self._loop.time())
        if self._link is not None:
            self._link.send = lambda _name, _fields: None
        loop = self._loop
        tasks = asyncio.all_tasks(loop)
        for task in tasks:
            task.cancel()
        if tasks:
            loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        loop.close()


class _Status(StatusLine):
    """The operator's screen; `output` takes its lines."""

    def __init__(self, output: Callable[[str], object], clock: Callable[[], float]) -> None:
        super().__init__(monotonic=clock)
        self.output = output

    def _write(self, text: str) -> None:
        self.output(text.rstrip("\n"))
