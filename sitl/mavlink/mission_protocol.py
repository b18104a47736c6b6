"""PX4's side of the MAVLink mission microservice: upload, download, clear, set current.

A pure state machine, one per link; the plan is shared. Time comes in as an argument. The
behaviour is that of PX4 1.17's mission manager, its replies, silences and time-outs included; the
old messages with coordinates in floating point are not taken.
"""

from collections.abc import Callable
from enum import Enum
from typing import Any, Final

from sitl.mavlink.codec import Outgoing
from sitl.px4sim import (
    CAPACITY,
    MissionItem,
    MissionType,
    Notice,
    PlanStore,
    Px4Behaviour,
    Refusal,
    UploadResult,
    checksum,
    stored_item,
    unused_param_of_item,
)

_RETRY_S: Final = 0.25
_TIMEOUT_S: Final = 5.0
_COMPONENTS: Final = (1, 190, 0)  # as target_component for us: autopilot, mission planner, all

Reply = Outgoing | Notice


class _State(Enum):
    IDLE = "idle"
    SENDING = "sending"
    RECEIVING = "receiving"


class MissionProtocol:
    """One link's mission manager.

    Args:
        plan: The plan on board.
        system_id: The vehicle's.
        behaviour: Of which version of PX4. Where its `requests_int` is false, items are requested
            by MISSION_REQUEST until a message with coordinates in integers came.
    """

    def __init__(self, plan: PlanStore, system_id: int, behaviour: Px4Behaviour) -> None:
        self._behaviour = behaviour
        self._requests_int = behaviour.requests_int
        self._plan = plan
        self._system_id = system_id
        self._state = _State.IDLE  # while receiving, `plan.transferring` keeps other links out
        self._type = 0  # MAV_MISSION_TYPE of the transfer, or of the last one
        self._partner = (0, 0)  # system and component, of the transfer or of the last one
        self._sequence = 0  # of the item to be sent or requested next
        self._count = 0  # of the transfer
        self._items: list[MissionItem] = []  # received so far; stored when all are there
        self._checksum = 0  # of these; the plan's opaque_id
        self._marked: int | None = None  # the one that is marked as current
        self._sent_s = 0.0  # time of the last request or count, on the wall's clock
        self._received_s = 0.0  # time of the partner's last message, on the wall's clock
        # By message name; called with the message, its sender and the time.
        self._handlers: dict[str, Callable[[Any, tuple[int, int], float], list[Reply]]] = {
            "MISSION_ACK": self._on_ack,
            "MISSION_SET_CURRENT": self._on_set_current,
            "MISSION_REQUEST_LIST": self._on_request_list,
            "MISSION_REQUEST_INT": self._on_request,
            "MISSION_COUNT": self._on_count,
            "MISSION_ITEM_INT": self._on_item,
            "MISSION_CLEAR_ALL": self._on_clear_all,
        }

    @property
    def messages(self) -> tuple[str, ...]:
        """The names of the messages that belong to this microservice."""
        return tuple(self._handlers)

    def handle(self, message: Any, now_s: float) -> list[Reply]:
        """Take a message in; messages for others are ignored.

        Args:
            message: As pymavlink decodes it.
            now_s: Seconds, ever rising.
        """
        mine = message.target_system == self._system_id
        if not mine or message.target_component not in _COMPONENTS:
            return []
        sender = (message.get_srcSystem(), message.get_srcComponent())
        return self._handlers[message.get_type()](message, sender, now_s)

    def tick(self, now_s: float) -> list[Reply]:
        """Repeat a request that was not answered, or give up; call it every step."""
        if self._state is _State.IDLE:
            return []
        if self._state is _State.RECEIVING and now_s - self._sent_s > _RETRY_S:
            return [self._request(now_s)]
        if now_s - self._received_s > _TIMEOUT_S:
            self._finish()
            return [Notice.of("mavlink_mission_op_timeout")]
        counting = self._state is _State.SENDING and self._sequence == 0
        if self._behaviour.repeats_count and counting and now_s - self._sent_s > _RETRY_S:
            return [self._counted(now_s)]
        return []

    # Downloads

    def _on_request_list(self, message: Any, sender: tuple[int, int], now_s: float) -> list[Reply]:
        if self._state is _State.SENDING and self._sequence == len(self._plan.items(self._type)):
            self._state = _State.IDLE  # everything was sent, only the last MISSION_ACK is missing
        again = self._state is _State.SENDING and (self._type, self._partner) == (
            message.mission_type,
            sender,
        )
        if self._state is not _State.IDLE and not again:
            return [Notice.of("mavlink_mission_req_ignored")]
        self._state, self._type, self._partner = _State.SENDING, message.mission_type, sender
        self._sequence, self._count = 0, len(self._plan.items(self._type))
        self._received_s = now_s
        return [self._counted(now_s)]

    def _counted(self, now_s: float) -> Outgoing:
        self._sent_s, identifier = now_s, self._plan.identifier(self._type)
        return self._outgoing(
            "MISSION_COUNT", self._partner, count=self._count, opaque_id=identifier
        )

    def _on_request(self, message: Any, sender: tuple[int, int], now_s: float) -> list[Reply]:
        self._requests_int = True
        if sender != self._partner:
            return [Notice.of("mavlink_mission_partner_id_mismatch2")]
        if self._state is _State.RECEIVING:
            return [Notice.of("mavlink_mission_mis_req_ignored_busy")]
        if self._state is _State.IDLE or message.mission_type != self._type:
            return []
        self._received_s = now_s
        items = self._plan.items(self._type)
        if message.seq == self._sequence < self._count:
            self._sequence += 1
        elif message.seq != self._sequence - 1:
            return self._unexpected_request("mavlink_mission_wp_unexpected")
        if message.seq >= len(items):
            return self._unexpected_request("mavlink_mission_wp_unexpected2")
        current = self._type == MissionType.MISSION and message.seq == self._plan.active
        fields = items[message.seq].fields() | {"seq": message.seq, "current": int(current)}
        return [self._outgoing("MISSION_ITEM_INT", sender, **fields)]

    def _unexpected_request(self, event: str) -> list[Reply]:
        self._state = _State.IDLE
        return [
            self._ack(UploadResult.ERROR),
            Notice.of(event),
        ]

    def _on_ack(self, message: Any, sender: tuple[int, int], now_s: float) -> list[Reply]:
        if sender != self._partner:
            return [Notice.of("mavlink_mission_partner_id_mismatch")]
        if self._state is _State.SENDING and message.mission_type == self._type:
            self._state = _State.IDLE
        elif (self._state, message.type) == (_State.RECEIVING, UploadResult.OPERATION_CANCELLED):
            self._finish()
        elif (self._state, message.type) == (_State.RECEIVING, UploadResult.UNSUPPORTED):
            self._requests_int = not self._requests_int  # the partner knows only the other one
            return [self._request(now_s)]
        return []

    # Uploads

    def _on_count(self, message: Any, sender: tuple[int, int], now_s: float) -> list[Reply]:
        if self._state is _State.SENDING:
            return [
                Notice.of("mavlink_mission_ignore_mis_count"),
                self._ack(UploadResult.ERROR, sender),
            ]
        self._received_s = now_s
        if self._state is _State.IDLE:
            reply = self._begin_upload(message, sender)
            if reply:
                return reply
        elif sender != self._partner:
            return [self._ack(UploadResult.ERROR, sender)]
        elif self._sequence > 0:
            return [
                Notice.of("mavlink_mission_getlist_busy"),
                self._ack(UploadResult.ERROR),
            ]
        return [self._request(now_s)]

    def _begin_upload(self, message: Any, sender: tuple[int, int]) -> list[Reply]:
        if self._plan.transferring:  # by another link
            return [self._ack(UploadResult.ERROR, sender)]
        self._partner, self._type = sender, message.mission_type
        self._checksum = 0
        if message.count > CAPACITY.get(self._type, 0):
            return [self._ack(UploadResult.NO_SPACE)]
        if message.count == 0:
            self._plan.store(self._type, (), 0, 0)
            return [self._ack(UploadResult.ACCEPTED)]
        self._plan.transferring = True
        self._state = _State.RECEIVING
        self._sequence, self._count = 0, message.count
        self._items, self._marked = [], None
        return []

    def _on_item(self, message: Any, sender: tuple[int, int], now_s: float) -> list[Reply]:
        self._requests_int = True
        if sender != self._partner:
            return [Notice.of("mavlink_mission_item_partner_id_mismatch")]
        if message.mission_type != self._type:
            return [self._ack(UploadResult.ERROR)]
        if self._state is not _State.RECEIVING:
            return self._on_stray_item(message.seq)
        self._received_s = now_s
        return self._take(message, now_s) if message.seq == self._sequence else []

    def _on_stray_item(self, sequence: int) -> list[Reply]:
        if self._state is _State.SENDING:
            notice = Notice.of("mavlink_mission_mis_item_busy")
        elif sequence + 1 == self._sequence:  # our last MISSION_ACK was lost, presumably
            return [self._ack(UploadResult.ACCEPTED, identifier=self._checksum)]
        else:
            notice = Notice.of("mavlink_mission_no_transfer")
        return [notice, self._ack(UploadResult.ERROR)]

    def _take(self, message: Any, now_s: float) -> list[Reply]:
        item = self._accepted(message)
        if isinstance(item, Refusal):
            self._finish()
            notice = Notice.of("mavlink_mission_mis_item_invalid")
            return [notice] * item.with_text + [self._ack(item.result)]
        self._checksum = checksum(message, self._checksum)
        self._items.append(item)
        if message.current:
            self._marked = message.seq
        self._sequence += 1
        if self._sequence < self._count:
            return [self._request(now_s)]
        self._plan.store(self._type, tuple(self._items), self._checksum, self._marked)
        self._finish()
        return [self._ack(UploadResult.ACCEPTED, identifier=self._checksum)]

    def _accepted(self, message: Any) -> MissionItem | Refusal:
        item = stored_item(message, self._type)
        frame_known = item != Refusal(UploadResult.UNSUPPORTED_FRAME)
        if self._behaviour.refuses_unused_params and frame_known:
            unused = unused_param_of_item(message)
            if unused is not None:
                return Refusal(UploadResult(UploadResult.INVALID_PARAM1 + unused - 1))
        return item

    # The rest

    def _on_clear_all(self, message: Any, sender: tuple[int, int], now_s: float) -> list[Reply]:
        if self._state is not _State.IDLE:
            return [Notice.of("mavlink_mission_ignore_clear")]
        self._received_s = now_s
        self._type = message.mission_type
        for kind in CAPACITY:
            if message.mission_type in (kind, MissionType.ALL):
                self._plan.store(kind, (), 0, 0)
        return [self._ack(UploadResult.ACCEPTED, sender)]

    def _on_set_current(self, message: Any, _: tuple[int, int], now_s: float) -> list[Reply]:
        if self._state is not _State.IDLE:
            return [Notice.of("mavlink_mission_state_busy")]
        self._received_s = now_s
        if message.seq >= len(self._plan.items(MissionType.MISSION)):
            return [Notice.of("mavlink_mission_seq_out_of_bounds")]
        self._plan.set_current(message.seq)
        return []

    def _finish(self) -> None:
        if self._state is _State.RECEIVING:
            self._plan.transferring = False
        self._state = _State.IDLE

    def _request(self, now_s: float) -> Outgoing:
        self._sent_s = now_s
        name = "MISSION_REQUEST_INT" if self._requests_int else "MISSION_REQUEST"
        return self._outgoing(name, self._partner, seq=self._sequence)

    def _ack(
        self,
        result: UploadResult,
        receiver: tuple[int, int] | None = None,
        identifier: int = 0,
    ) -> Outgoing:
        receiver = self._partner if receiver is None else receiver
        return self._outgoing("MISSION_ACK", receiver, type=result.value, opaque_id=identifier)

    def _outgoing(self, name: str, receiver: tuple[int, int], **fields: Any) -> Outgoing:
        target = {
            "target_system": receiver[0],
            "target_component": receiver[1],
            "mission_type": self._type,
        }
        return Outgoing(name, target | fields)
