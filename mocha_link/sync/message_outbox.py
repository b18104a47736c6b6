"""The queue of the serving side's sync messages, which it fragments into frames of any size."""

from __future__ import annotations

from mocha_link.sync.frames import MESSAGE_HEADER_BYTES, message_frame


class MessageOutbox:
    """Queued sync messages, sent in order and in parts that fit the frames."""

    def __init__(self) -> None:
        self._messages: list[tuple[int, bytes]] = []  # kind, content
        self._offset = 0  # of the next part in the first message

    def __bool__(self) -> bool:
        return bool(self._messages)

    def put(self, kind: int, content: bytes) -> None:
        """Queue a message."""
        self._messages.append((kind, content))

    def clear(self) -> None:
        """Drop all messages: another round begins."""
        self._messages.clear()
        self._offset = 0

    def fits(self, room: int) -> bool:
        """Whether a message is queued, and the whole of it fits in `room` bytes."""
        return bool(self) and MESSAGE_HEADER_BYTES + len(self._messages[0][1]) <= room

    def next_frame(self, round_: int, room: int) -> tuple[int, bytes]:
        """The next part of the first message in a frame of at most `room` bytes, with its kind."""
        kind, content = self._messages[0]
        frame = message_frame(kind, round_, content, self._offset, room)
        self._offset += len(frame) - MESSAGE_HEADER_BYTES
        if self._offset >= len(content):
            del self._messages[0]
            self._offset = 0
        return kind, frame
