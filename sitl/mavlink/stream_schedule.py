"""When which message is due on a link."""

from __future__ import annotations

from collections.abc import Mapping


class StreamSchedule:
    """Message intervals of one link, in simulated seconds.

    Args:
        rates_hz: The link's default rates by message name.
    """

    def __init__(self, rates_hz: Mapping[str, float]) -> None:
        self._defaults_s = {name: 1.0 / rate for name, rate in rates_hz.items()}
        self._intervals_s = dict(self._defaults_s)
        self._due_s = dict.fromkeys(self._intervals_s, 0.0)

    def set_interval(self, name: str, interval_us: float) -> None:
        """SET_MESSAGE_INTERVAL: microseconds; 0 is the default, below 0 is never."""
        if interval_us > 0:
            self._intervals_s[name] = interval_us / 1e6
        elif interval_us == 0 and name in self._defaults_s:
            self._intervals_s[name] = self._defaults_s[name]
        else:
            self._intervals_s.pop(name, None)
            self._due_s.pop(name, None)
            return
        self._due_s[name] = 0.0

    def interval_us(self, name: str) -> int:
        """The present interval; -1 if it is not sent."""
        interval_s = self._intervals_s.get(name)
        return -1 if interval_s is None else round(min(interval_s * 1e6, 2e9))

    def due(self, now_s: float) -> list[str]:
        """The messages to be sent now, each once however late."""
        names = [name for name, due_s in self._due_s.items() if due_s <= now_s + 1e-9]
        for name in names:
            following_s = self._due_s[name] + self._intervals_s[name]
            if following_s <= now_s:
                following_s = now_s + self._intervals_s[name]
            self._due_s[name] = following_s
        return names
