"""Commands that move a PX4 or change its mode: each leaves once, and is believed when it shows.

Each leaves in the moment in which the vehicle has reported a mode that the command may
end: a mode that was received before may be another by now (`px4_mode_check`). There is one door,
`Px4Commands._look`, and nothing that moves the vehicle leaves beside it.

Sending a command again because no answer came, as MAVSDK does, takes the vehicle back from
a pilot who chose something else meanwhile. That may be the mode of before: a vehicle that has
acknowledged another one, and is not in it, was in it for a moment, and is another's. Here it leaves
again only on a HEARTBEAT from some time after it left that still shows what was before; what leads
to a place does not leave again at all.
"""

import logging
import math
from collections import defaultdict, deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from enum import Enum, IntEnum, auto
from typing import Any, NamedTuple, Self

from air_router.errors import NotConfirmedError, NotSentError
from air_router.vehicle import (
    FlightMode,
    Modes,
    Objection,
    TakenOverError,
    Telemetry,
    loop_s,
    no_objection,
)
from air_router.vehicle.px4.limits import (
    ACK_LATE_S,
    HEARTBEAT_FRESH_S,
    MODE_FRESH_S,
    MODE_POLL_S,
    ORDER_ACTS_S,
    ORDER_CONFIRM_S,
    ORDER_LONGEST_S,
    ORDER_SETTLED_S,
    SAME_TARGET_M,
)
from air_router.vehicle.px4.mavlink_values import COMPANION_COMPONENT
from air_router.vehicle.px4.plan_guard import PlanIds
from air_router.vehicle.px4.px4_mode_check import ModeCheck
from air_router.vehicle.px4.px4_order import Px4Order
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry
from geo.frame import Point

_log = logging.getLogger(__name__)


class NotShownError(NotConfirmedError):
    """Nothing was received that would show what became of an order: it may be followed."""


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6
    COMMAND_LONG_ONLY = 7
    COMMAND_INT_ONLY = 8
    UNSUPPORTED_MAV_FRAME = 9
    NOT_IN_CONTROL = 10


class ObservedState(NamedTuple):
    """What a pilot or ground station would change that takes the vehicle."""

    mode: FlightMode
    armed: bool
    failsafe: bool
    item: int | None  # of the plan, current
    target: Point | None  # that it reports

    @classmethod
    def of(cls, telemetry: Px4Telemetry | Telemetry) -> Self:
        """As the vehicle reported last; item and target where they are chosen, and not followed."""
        mode = telemetry.mode
        return cls(
            mode,
            telemetry.armed,
            telemetry.failsafe,
            telemetry.item if mode is FlightMode.MISSION else None,
            telemetry.target if mode is FlightMode.HOLD and telemetry.in_air else None,
        )

    def reported_since(self, sent_s: float, telemetry: Px4Telemetry) -> bool:
        """Whether item or target, where one is chosen, were reported again since then."""
        if self.mode is FlightMode.MISSION:
            return telemetry.arrived_s("MISSION_CURRENT") > sent_s
        if self.mode is FlightMode.HOLD and telemetry.in_air:
            return telemetry.arrived_s("POSITION_TARGET_GLOBAL_INT") > sent_s
        return True

    def same(self, other: Self) -> bool:
        """Whether no other order came between the two."""
        here, there = self.target, other.target
        if here is not None and there is not None:
            return math.dist(here, there) <= SAME_TARGET_M and self[:-1] == other[:-1]
        return self == other


@dataclass(slots=True)
class SentOrder:
    """An order that has left, and what was answered; times are of the monotonic clock.

    Attributes:
        order: What the vehicle was reported.
        before: What the vehicle had been reported, by any sender, when it left.
        plan: What was on board then.
        first_s: When it left.
        last_s: When it left last.
        in_progress_s: When the vehicle reported last that it is about it.
        accepted: The vehicle acknowledged this very order, as far as can be determined.
        acked_s: When an acknowledgement came that may also be that of an order from before.
        acked_boot_s: The vehicle's time since boot that it had reported last by then.
        refusal: The result with which it refused it, None if it did not.
    """

    order: Px4Order
    before: ObservedState
    plan: PlanIds | None
    first_s: float
    last_s: float = -math.inf
    in_progress_s: float = -math.inf
    accepted: bool = False
    acked_s: float = math.inf
    acked_boot_s: float = math.inf
    refusal: int | None = None

    def leaves(self, now_s: float) -> None:
        """It leaves, perhaps again."""
        self.last_s = now_s
        if self.refusal is not None:  # what was answered was about the time before
            self.refusal, self.accepted = None, False
            self.acked_s = self.acked_boot_s = math.inf

    def acknowledged(self, result: int, now_s: float, boot_s: float, *, this: bool) -> None:
        """The vehicle acknowledged; `this`: this very order, and none before it."""
        if result == Result.IN_PROGRESS:
            self.in_progress_s = now_s
        elif result == Result.ACCEPTED:
            self.accepted |= this
            self.acked_s = min(self.acked_s, now_s)
            self.acked_boot_s = min(self.acked_boot_s, boot_s)
        else:
            self.refusal = result


Shown = Callable[[SentOrder], bool]
"""Whether the vehicle follows an order, by what it says and has acknowledged."""


class OrderOutcome(Enum):
    """What has become of an order that left."""

    FOLLOWED = auto()
    REFUSED = auto()
    TAKEN = auto()  # another party chose a mode that is neither from before nor ours
    AGAIN = auto()  # not followed, and no other mode was chosen: it may leave again


@dataclass(slots=True)
class _Attempts:
    """How often orders of one kind left and were not answered, and the one that is waited for."""

    unanswered: deque[tuple[float, SentOrder]] = field(default_factory=deque)  # when it left
    newest: SentOrder | None = None  # its answer is waited for
    unsettled_s: float = -math.inf  # when one left last whose answer may yet be taken for another's

    def begin(self, sent: SentOrder) -> None:
        """This order is the one that is waited for."""
        self.newest = sent
        self.unsettled_s = max([self.unsettled_s, *(left_s for left_s, _ in self.unanswered)])

    def left_again(self, sent: SentOrder) -> None:
        """An order that is over left again, and may be answered, and followed, once more."""
        self.unsettled_s = sent.last_s


class Px4Commands:
    """Sends orders, one of each kind at a time.

    Args:
        telemetry: The vehicle's messages, and what sends to it.

    Attributes:
        check: Requests the mode that the vehicle has now.
    """

    def __init__(self, telemetry: Px4Telemetry) -> None:
        self._telemetry = telemetry
        self.check = ModeCheck(telemetry)
        self._mode_received_s = -math.inf  # when the mode of now was received, loop's clock
        self._tried: dict[int, _Attempts] = defaultdict(_Attempts)  # by MAV_CMD
        self._unfollowed: deque[SentOrder] = deque()  # may show yet, since the last that was

    def listen(self) -> None:
        """Take the autopilot's acknowledgements, from now on."""
        self._telemetry.take({"COMMAND_ACK": self._on_ack})
        self.check.listen()

    async def recheck(
        self,
        words: str,
        out_of: Modes = None,
        objection: Objection = no_objection,
        *,
        anew: bool = False,
    ) -> None:
        """Make sure that something may leave in this very moment: in this turn of the loop.

        Args:
            words: What is to leave.
            out_of: The modes that it may end; None: the one of the call.
            objection: Why it must not leave, after all.
            anew: Also where the mode was checked a moment ago.

        Raises:
            NotSentError: no mode of now was received, a failsafe acts, or there is an objection.
            TakenOverError: the vehicle is in another mode.
        """
        modes = {self._telemetry.mode} if out_of is None else out_of
        if anew or loop_s() - self._mode_received_s > MODE_FRESH_S:
            if not await self.check.received():
                raise NotSentError(f"{words} was not sent: no flight mode of now was received")
            self._mode_received_s = loop_s()
        if (taken := self.taken(modes)) is not None:
            text = f"{words} was not sent: the pilot chose {taken.value} mode"
            raise TakenOverError(text, taken, sent=False)
        if self._telemetry.failsafe and self._telemetry.in_air:  # it may hold, as we have it do
            raise NotSentError(f"{words} was not sent: a failsafe of the autopilot acts")
        if (why := objection()) is not None:
            raise NotSentError(why)

    def taken(self, out_of: Collection[FlightMode]) -> FlightMode | None:
        """The mode that the vehicle is in, if it is none of these, nor of an order of ours."""
        mode = self._telemetry.mode
        return None if mode in {*out_of, *self.late_modes()} else mode

    async def send(
        self,
        wire: tuple[str, dict[str, Any]],
        words: str,
        *,
        out_of: Modes = None,
        objection: Objection = no_objection,
    ) -> None:
        """Send a message to the autopilot, once.

        Args:
            wire: Its name and fields.
            words: What it is.
            out_of: See `recheck`, which raises as well.
            objection: See `recheck`.

        Raises:
            NotConfirmedError: the link is lost.
        """
        await self.recheck(words, out_of, objection)
        self._send(wire, words)

    def _send(self, wire: tuple[str, dict[str, Any]], words: str) -> None:
        fault = self._telemetry.send(*wire)
        if fault is not None:
            raise NotConfirmedError(f"{words} was not sent: {fault}")

    async def execute(
        self,
        order: Px4Order,
        shown: Shown,
        *,
        attempts: int = 1,
        out_of: Modes = None,
        objection: Objection = no_objection,
    ) -> None:
        """Send an order and wait until the vehicle follows it.

        Args:
            order: What it is to do.
            shown: Whether it follows.
            attempts: How often it may leave at most, each time if no other order came.
            out_of: See `recheck`, which raises as well.
            objection: See `recheck`.

        Raises:
            NotShownError: nothing was received that shows whether it follows.
            NotConfirmedError: it does not follow, with the reason where there is one.
            TakenOverError: a pilot chose another mode before it was followed.
        """
        await self.recheck(order.words, out_of, objection)
        telemetry = self._telemetry
        sent = SentOrder(order, ObservedState.of(telemetry), telemetry.plan.ids, loop_s())
        tried = self._tried[order.command]
        tried.begin(sent)
        verdict = None
        for attempt in range(attempts):
            if attempt:
                try:
                    await self.recheck(order.words, {sent.before.mode, order.leads_to})
                except NotSentError:
                    verdict = None  # it has left before, and what became of that is not known
                    break
                if not self._unchanged(sent):  # it follows just now, perhaps, or is about it
                    verdict = await self._outcome(sent, shown, more=False)
                    break
            self._leave(sent, attempt)
            verdict = await self._outcome(sent, shown, more=attempt + 1 < attempts)
            if verdict is not OrderOutcome.AGAIN:
                break
            _log.info("%s: nothing shows and no other mode was chosen: again", order.words)
        if sent.last_s > sent.first_s + ORDER_SETTLED_S:
            tried.left_again(sent)
        if verdict is OrderOutcome.TAKEN:
            raise TakenOverError(self._why_not(sent, verdict), telemetry.mode, sent=True)
        if verdict is not OrderOutcome.FOLLOWED:
            in_progress_s = self._telemetry.arrived_s("HEARTBEAT", "CURRENT_MODE")
            unseen = verdict is None and in_progress_s < sent.last_s + ORDER_SETTLED_S
            error = NotShownError if unseen else NotConfirmedError
            raise error(self._why_not(sent, verdict))
        if order.moves:  # what left before it is void, on a link in order
            self._unfollowed.clear()
        tried.unanswered.clear()  # on a link in order: lost, or here by now

    def _leave(self, sent: SentOrder, attempt: int) -> None:
        if sent.order.moves and not attempt:
            self._unfollowed.append(sent)
        sent.leaves(loop_s())
        self._tried[sent.order.command].unanswered.append((sent.last_s, sent))
        self._send(sent.order.wire(attempt), sent.order.words)

    async def _outcome(self, sent: SentOrder, shown: Shown, *, more: bool) -> OrderOutcome | None:
        """What became of it, None if nothing can be said in time."""
        verdict: OrderOutcome | None = None

        def judged() -> bool:
            nonlocal verdict
            verdict = self._verdict(sent, shown, more=more)
            return verdict is not None

        while True:
            latest_s = max(sent.last_s, sent.in_progress_s)
            end_s = min(latest_s + ORDER_CONFIRM_S, sent.first_s + ORDER_LONGEST_S)
            left_s = end_s - loop_s()
            # Whatever ends the wait: it may have said meanwhile that it is about it, or done it.
            if left_s <= 0.0:
                judged()
                return verdict
            if await self._telemetry.shows(judged, min(left_s, MODE_POLL_S)):
                return verdict
            if self._should_show(sent) and await self.check.received(left_s):
                # In the mode of now it is not: it was, for a moment that no message has shown.
                return verdict if judged() else OrderOutcome.TAKEN
            # A mode that it has now and no HEARTBEAT has told yet is a pilot's as soon as another
            # follows: the sooner ours is known, the sooner that shows.
            self.check.request()

    def _verdict(self, sent: SentOrder, shown: Shown, *, more: bool) -> OrderOutcome | None:
        if shown(sent):
            return OrderOutcome.FOLLOWED
        if self._telemetry.mode not in {sent.before.mode, sent.order.leads_to, *self.late_modes()}:
            return OrderOutcome.TAKEN
        if sent.refusal is not None and not (more and sent.refusal == Result.TEMPORARILY_REJECTED):
            return OrderOutcome.REFUSED
        return OrderOutcome.AGAIN if more and self._no_other_chose(sent) else None

    def _should_show(self, sent: SentOrder) -> bool:
        """Whether PX4 has changed the mode as this very order said, long enough ago to show it.

        The first acknowledgement of a mode says nothing on PX4 1.16 and 1.17; the second, which
        follows at once, is a refusal where it does not change. What answers one that left before,
        and is late, may be taken for an answer to this one: then nothing is known.
        """
        if sent.first_s - self._tried[sent.order.command].unsettled_s <= ACK_LATE_S:
            return False
        changes = sent.order.leads_to is not sent.before.mode
        accepted = sent.accepted and sent.refusal is None
        reported_s = self._telemetry.clock.reported_s
        return changes and accepted and reported_s >= sent.acked_boot_s + ORDER_ACTS_S

    def late_modes(self) -> set[FlightMode]:
        """The modes of orders that were called off, or did not show: they may show yet."""
        since_s = loop_s() - ACK_LATE_S
        return {sent.order.leads_to for sent in self._unfollowed if sent.last_s >= since_s}

    def _no_other_chose(self, sent: SentOrder) -> bool:
        """Whether the vehicle reports just now that everything is as it was before the order."""
        heartbeat_s = self._telemetry.arrived_s("HEARTBEAT")
        just_now = loop_s() - heartbeat_s <= HEARTBEAT_FRESH_S
        return heartbeat_s >= sent.last_s + ORDER_SETTLED_S and just_now and self._unchanged(sent)

    def _unchanged(self, sent: SentOrder) -> bool:
        """Whether all is as it was before the order, by what the vehicle reported last."""
        telemetry = self._telemetry
        return (
            sent.in_progress_s < sent.last_s
            and sent.before.reported_since(sent.last_s, telemetry)
            and sent.before.same(ObservedState.of(telemetry))
            # Mission mode would fly what a ground station has put on board meanwhile.
            and (sent.order.leads_to is not FlightMode.MISSION or sent.plan == telemetry.plan.ids)
        )

    def _why_not(self, sent: SentOrder, verdict: OrderOutcome | None) -> str:
        words, mode, texts = sent.order.words, self._telemetry.mode.value, self._telemetry.texts()
        if verdict is OrderOutcome.TAKEN:
            return f"{words} was asked for, and the pilot chose {mode} mode"
        if sent.refusal is not None:
            return f"{words}: {_name(sent.refusal)}{texts}"
        return f"{words} was asked for and does not show; the vehicle is in {mode} mode{texts}"

    def _on_ack(self, fields: dict[str, Any]) -> None:
        """An acknowledgement; PX4 1.16 and 1.17 send two for a mode, the second says how it is."""
        to = (fields.get("target_system"), fields.get("target_component"))
        tried = self._tried.get(fields["command"])
        if (
            to != (self._telemetry.system_id, COMPANION_COMPONENT)
            or tried is None
            or tried.newest is None
        ):
            return
        now_s, newest = self._telemetry.arrived_s("COMMAND_ACK"), tried.newest
        result, boot_s = fields["result"], self._telemetry.clock.reported_s
        if result == Result.IN_PROGRESS:
            newest.acknowledged(result, now_s, boot_s, this=True)
            return
        while tried.unanswered and tried.unanswered[0][0] < now_s - ACK_LATE_S:
            tried.unanswered.popleft()
        # They have no numbers: on a link in order the first answers what left first.
        acknowledged = None
        if tried.unanswered and tried.unanswered[0][0] <= now_s:
            _, acknowledged = tried.unanswered.popleft()
        if newest.first_s <= now_s:
            newest.acknowledged(result, now_s, boot_s, this=acknowledged is newest)


def _name(result: int) -> str:
    return next((each.name for each in Result if each == result), f"result {result}")
