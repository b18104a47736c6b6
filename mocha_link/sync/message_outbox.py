"""The sync messages of the serving side that wait for a frame, which may be of any size."""

from __future__ import annotations

from mocha_link.sync.frames import MESSAGE_HEADER_BYTES, message_frame


class MessageOutbox:
    """Sync messages in the order in which they go out, in parts as frames have room."""

    def __init__(self) -> None:
        self._messages: list[tuple[int, bytes]] = []  # kind, content
        self._offset = 0  # of the first message, where the next part begins

    def __bool__(self) -> bool:
        return bool(self._messages)

    def put(self, kind: int, content: bytes) -> None:
        """Queue a message."""
        self._messages.append((kind, content))

    def clear(self) -> None:
        """Let go of all: another round begins."""
        self._messages.clear()
        self._offset = 0

    def fits(self, room: int) -> bool:
        """Whether the next message is there, and takes no more than so many bytes."""
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
