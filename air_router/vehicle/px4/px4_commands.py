"""Commands that move a PX4 or change its mode. Each is sent once, and confirmed by telemetry.

A command is sent only right after the vehicle has reported a mode that the command may end: an
older report may be outdated (`px4_mode_check`). `Px4Commands.recheck` makes this check, and nothing
that moves the vehicle is sent without it.

MAVSDK repeats an unacknowledged command. That would take the vehicle back from a pilot who chose
another mode meanwhile, perhaps even the previous mode: a vehicle that acknowledged a new mode and
is not in it was in it for a moment, and then the pilot changed it. Here a command is repeated only
after a later HEARTBEAT that still shows the state before the command. A command that leads to a
place is never repeated.
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
    """Nothing was received that shows the outcome of a command: the vehicle may follow it."""


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
    """What changes when a pilot or ground station takes the vehicle over."""

    mode: FlightMode
    armed: bool
    failsafe: bool
    item: int | None  # current plan item
    target: Point | None  # reported target

    @classmethod
    def of(cls, telemetry: Px4Telemetry | Telemetry) -> Self:
        """From the last reports; item and target only in modes in which someone chooses them."""
        mode = telemetry.mode
        return cls(
            mode,
            telemetry.armed,
            telemetry.failsafe,
            telemetry.item if mode is FlightMode.MISSION else None,
            telemetry.target if mode is FlightMode.HOLD and telemetry.in_air else None,
        )

    def reported_since(self, sent_s: float, telemetry: Px4Telemetry) -> bool:
        """Whether the item or target of this mode was reported again since then."""
        if self.mode is FlightMode.MISSION:
            return telemetry.arrived_s("MISSION_CURRENT") > sent_s
        if self.mode is FlightMode.HOLD and telemetry.in_air:
            return telemetry.arrived_s("POSITION_TARGET_GLOBAL_INT") > sent_s
        return True

    def same(self, other: Self) -> bool:
        """Whether no other command took effect between the two."""
        here, there = self.target, other.target
        if here is not None and there is not None:
            return math.dist(here, there) <= SAME_TARGET_M and self[:-1] == other[:-1]
        return self == other


@dataclass(slots=True)
class SentOrder:
    """A command that was sent, and its acknowledgements. Times are of the monotonic clock.

    Attributes:
        order: The command.
        before: The vehicle's state, set by any sender, when the command was sent.
        plan: The plan on board then.
        first_s: When it was first sent.
        last_s: When it was last sent.
        in_progress_s: When the vehicle last reported it as in progress.
        accepted: The vehicle acknowledged this very command, as far as can be determined.
        acked_s: When an acknowledgement was received that may also belong to an earlier command.
        acked_boot_s: The newest time since boot that the vehicle had reported by then.
        refusal: The result of a refusal; None: not refused.
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

    def note_sent(self, now_s: float) -> None:
        """Note that it is sent, perhaps again."""
        self.last_s = now_s
        if self.refusal is not None:  # that answer concerned the time before
            self.refusal, self.accepted = None, False
            self.acked_s = self.acked_boot_s = math.inf

    def acknowledged(self, result: int, now_s: float, boot_s: float, *, this: bool) -> None:
        """Note an acknowledgement; `this`: of this very command, not of an earlier one."""
        if result == Result.IN_PROGRESS:
            self.in_progress_s = now_s
        elif result == Result.ACCEPTED:
            self.accepted |= this
            self.acked_s = min(self.acked_s, now_s)
            self.acked_boot_s = min(self.acked_boot_s, boot_s)
        else:
            self.refusal = result


Shown = Callable[[SentOrder], bool]
"""Whether the vehicle follows a command, by its telemetry and acknowledgements."""

Decide = Callable[[], tuple[Px4Order, Shown]]
"""Returns the command, and how it shows, by the vehicle's state of this moment."""


class OrderOutcome(Enum):
    """The outcome of a sent command."""

    FOLLOWED = auto()
    REFUSED = auto()
    TAKEN = auto()  # another party chose a mode that is neither the previous one nor ours
    AGAIN = auto()  # not followed, and no other mode chosen: may be sent again


@dataclass(slots=True)
class _Attempts:
    """The unacknowledged commands of one kind, and the pending one."""

    unanswered: deque[tuple[float, SentOrder]] = field(default_factory=deque)  # when it was sent
    newest: SentOrder | None = None  # the pending one
    unsettled_s: float = -math.inf  # last one with a still ambiguous answer

    def begin(self, sent: SentOrder) -> None:
        """Make this command the pending one."""
        self.newest = sent
        self.unsettled_s = max([self.unsettled_s, *(sent_s for sent_s, _ in self.unanswered)])

    def sent_again(self, sent: SentOrder) -> None:
        """A finished command was sent twice, so another acknowledgement may be received."""
        self.unsettled_s = sent.last_s


class Px4Commands:
    """Sends commands, one of each kind at a time.

    Args:
        telemetry: The vehicle's messages in both directions.

    Attributes:
        check: Requests the vehicle's current mode.
    """

    def __init__(self, telemetry: Px4Telemetry) -> None:
        self._telemetry = telemetry
        self.check = ModeCheck(telemetry)
        self._mode_received_s = -math.inf  # when the current mode was checked, loop's clock
        self._tried: dict[int, _Attempts] = defaultdict(_Attempts)  # by MAV_CMD
        self._unfollowed: deque[SentOrder] = deque()  # may still take effect

    def listen(self) -> None:
        """Handle PX4's acknowledgements from now on."""
        self._telemetry.take({"COMMAND_ACK": self._on_ack})
        self.check.listen()

    async def recheck(
        self, words: str, out_of: Modes = None, objection: Objection = no_objection
    ) -> None:
        """Make sure that a message may be sent now: in this turn of the loop.

        Args:
            words: What is to be sent, as text.
            out_of: The modes that it may end; None: the mode at the time of the call.
            objection: Returns why it must not be sent; None: it may.

        Raises:
            NotSentError: The current mode was not received, a failsafe acts, or there is an
            objection.
            TakenOverError: The vehicle is in another mode.
        """
        modes = {self._telemetry.mode} if out_of is None else out_of
        if loop_s() - self._mode_received_s > MODE_FRESH_S:
            if not await self.check.received():
                raise NotSentError(f"{words} was not sent: no current flight mode was received")
            self._mode_received_s = loop_s()
        if (taken := self.taken(modes)) is not None:
            text = f"{words} was not sent: the pilot chose {taken.value} mode"
            raise TakenOverError(text, taken, sent=False)
        if self._telemetry.failsafe and self._telemetry.in_air:  # a failsafe may hold too, as we do
            raise NotSentError(f"{words} was not sent: a failsafe of the autopilot acts")
        if (why := objection()) is not None:
            raise NotSentError(why)

    def taken(self, out_of: Collection[FlightMode]) -> FlightMode | None:
        """The vehicle's mode, if it is none of these and not due to a command of ours."""
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
            wire: Name and fields of the message.
            words: What it is, as text.
            out_of: See `recheck`, which raises as well.
            objection: See `recheck`.

        Raises:
            NotConfirmedError: The link is lost.
        """
        await self.recheck(words, out_of, objection)
        self._send(wire, words)

    def _send(self, wire: tuple[str, dict[str, Any]], words: str) -> None:
        fault = self._telemetry.send(*wire)
        if fault is not None:
            raise NotConfirmedError(f"{words} was not sent: {fault}")

    async def execute(
        self,
        words: str,
        decide: Decide,
        *,
        attempts: int = 1,
        out_of: Modes = None,
        objection: Objection = no_objection,
    ) -> None:
        """Send a command and wait until the vehicle follows it.

        Args:
            words: What is to be sent, as text.
            decide: Called once it may be sent, in the turn of the loop in which it is sent.
            attempts: How often it may be sent at most; repeated only if no other command took
                effect.
            out_of: See `recheck`, which raises as well.
            objection: See `recheck`.

        Raises:
            NotShownError: Nothing was received that shows whether the vehicle follows.
            NotConfirmedError: The vehicle does not follow, with the reason if there is one.
            TakenOverError: A pilot chose another mode before the vehicle followed.
        """
        await self.recheck(words, out_of, objection)
        telemetry = self._telemetry
        order, shown = decide()
        sent = SentOrder(order, ObservedState.of(telemetry), telemetry.plan.ids, loop_s())
        tried = self._tried[order.command]
        tried.begin(sent)
        verdict = await self._try(sent, shown, attempts, objection)
        if sent.last_s > sent.first_s + ORDER_SETTLED_S:
            tried.sent_again(sent)
        if verdict is OrderOutcome.TAKEN:
            raise TakenOverError(self._why_not(sent, verdict), telemetry.mode, sent=True)
        if verdict is not OrderOutcome.FOLLOWED:
            in_progress_s = self._telemetry.arrived_s("HEARTBEAT", "CURRENT_MODE")
            unseen = verdict is None and in_progress_s < sent.last_s + ORDER_SETTLED_S
            error = NotShownError if unseen else NotConfirmedError
            raise error(self._why_not(sent, verdict))
        if order.moves:  # earlier ones are void: the link keeps the order
            self._unfollowed.clear()
        tried.unanswered.clear()  # lost or received by now: the link keeps the order

    async def _try(
        self, sent: SentOrder, shown: Shown, attempts: int, objection: Objection
    ) -> OrderOutcome | None:
        """Send a command that may be sent now, perhaps again; None: its outcome is unknown."""
        order = sent.order
        for attempt in range(attempts):
            if attempt:
                try:
                    await self.recheck(order.words, {sent.before.mode, order.leads_to}, objection)
                except TakenOverError:  # while the first may still be under way
                    return OrderOutcome.TAKEN
                except NotSentError:
                    return None
                if not self._unchanged(sent):  # it may just be taking effect
                    return await self._outcome(sent, shown, more=False)
            self._send_order(sent, attempt)
            verdict = await self._outcome(sent, shown, more=attempt + 1 < attempts)
            if verdict is not OrderOutcome.AGAIN:
                return verdict
            _log.info("%s: nothing shows and no other mode was chosen: again", order.words)
        return None

    def _send_order(self, sent: SentOrder, attempt: int) -> None:
        if sent.order.moves and not attempt:
            self._unfollowed.append(sent)
        sent.note_sent(loop_s())
        self._tried[sent.order.command].unanswered.append((sent.last_s, sent))
        self._send(sent.order.wire(attempt), sent.order.words)

    async def _outcome(self, sent: SentOrder, shown: Shown, *, more: bool) -> OrderOutcome | None:
        """The outcome; None: nothing was received in time."""
        verdict: OrderOutcome | None = None

        def judged() -> bool:
            nonlocal verdict
            verdict = self._verdict(sent, shown, more=more)
            return verdict is not None

        while True:
            latest_s = max(sent.last_s, sent.in_progress_s)
            end_s = min(latest_s + ORDER_CONFIRM_S, sent.first_s + ORDER_LONGEST_S)
            left_s = end_s - loop_s()
            # The vehicle may have reported progress or followed at the end of the wait.
            if left_s <= 0.0:
                judged()
                return verdict
            if await self._telemetry.shows(judged, min(left_s, MODE_POLL_S)):
                return verdict
            if self._should_show(sent) and await self.check.received(left_s):
                # It is not in the mode now: it was for a moment, which no message has shown.
                return verdict if judged() else OrderOutcome.TAKEN
            # The next HEARTBEAT may already show a pilot's mode after ours: request one now, so
            # that our own mode is seen first.
            self.check.request()

    def _verdict(self, sent: SentOrder, shown: Shown, *, more: bool) -> OrderOutcome | None:
        if shown(sent):
            return OrderOutcome.FOLLOWED
        if self._telemetry.mode not in {sent.before.mode, sent.order.leads_to, *self.late_modes()}:
            return OrderOutcome.TAKEN
        if sent.refusal is not None and not (more and sent.refusal == Result.TEMPORARILY_REJECTED):
            return OrderOutcome.REFUSED
        return OrderOutcome.AGAIN if more and self._no_other_choice(sent) else None

    def _should_show(self, sent: SentOrder) -> bool:
        """Whether PX4 accepted the mode of this very command long enough ago to report it.

        PX4 1.16 and 1.17 acknowledge a mode twice. The first acknowledgement means nothing; the
        second follows at once, and is a refusal if the mode does not change. A late acknowledgement
        of an earlier command may be mistaken for this one's; then nothing is known.
        """
        if sent.first_s - self._tried[sent.order.command].unsettled_s <= ACK_LATE_S:
            return False
        changes = sent.order.leads_to is not sent.before.mode
        accepted = sent.accepted and sent.refusal is None
        reported_s = self._telemetry.clock.reported_s
        return changes and accepted and reported_s >= sent.acked_boot_s + ORDER_ACTS_S

    def late_modes(self) -> set[FlightMode]:
        """The modes of canceled or unconfirmed commands, which may still take effect."""
        since_s = loop_s() - ACK_LATE_S
        return {sent.order.leads_to for sent in self._unfollowed if sent.last_s >= since_s}

    def _no_other_choice(self, sent: SentOrder) -> bool:
        """Whether a fresh HEARTBEAT shows the state from before the command."""
        heartbeat_s = self._telemetry.arrived_s("HEARTBEAT")
        just_now = loop_s() - heartbeat_s <= HEARTBEAT_FRESH_S
        return heartbeat_s >= sent.last_s + ORDER_SETTLED_S and just_now and self._unchanged(sent)

    def _unchanged(self, sent: SentOrder) -> bool:
        """Whether the last reports show the state from before the command."""
        telemetry = self._telemetry
        return (
            sent.in_progress_s < sent.last_s
            and sent.before.reported_since(sent.last_s, telemetry)
            and sent.before.same(ObservedState.of(telemetry))
            # Mission mode would fly a plan that a ground station has uploaded meanwhile.
            and (sent.order.leads_to is not FlightMode.MISSION or sent.plan == telemetry.plan.ids)
        )

    def _why_not(self, sent: SentOrder, verdict: OrderOutcome | None) -> str:
        words, mode, texts = sent.order.words, self._telemetry.mode.value, self._telemetry.texts()
        if verdict is OrderOutcome.TAKEN:
            return f"{words} was commanded, but the pilot chose {mode} mode"
        if sent.refusal is not None:
            return f"{words}: {_name(sent.refusal)}{texts}"
        return f"{words} was commanded, but the vehicle stays in {mode} mode{texts}"

    def _on_ack(self, fields: dict[str, Any]) -> None:
        """Handle an acknowledgement; of the two for a mode (PX4 1.16, 1.17) the second counts."""
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
        # Acknowledgements have no numbers: on a link in order the first answers the first command.
        acknowledged = None
        if tried.unanswered and tried.unanswered[0][0] <= now_s:
            _, acknowledged = tried.unanswered.popleft()
        if newest.first_s <= now_s:
            newest.acknowledged(result, now_s, boot_s, this=acknowledged is newest)


def _name(result: int) -> str:
    return next((each.name for each in Result if each == result), f"result {result}")
