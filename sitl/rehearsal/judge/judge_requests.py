"""The judge of what an operator asked for: what was accepted is done."""

from __future__ import annotations

import re
from typing import Final

from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind
from sitl.rehearsal.judge.judge_seat import CompanionsSeat
from sitl.rehearsal.judge.judge_track import is_motion

_ANSWER: Final = re.compile(r": (accepted|refused): (.*)$")
_ANSWERED_S: Final = 1.0
_NO_MORE: Final = re.compile("already|as soon as|once the changed|before it begins|on the ground")
"""An answer that says so promises nothing more, or not yet."""

_TURNS_S: Final = 1.0
"""Within that time a hold is sent."""

_HOLDS_S: Final = 12.0
"""For so long a hold is looked at: later the mission's own time may be over."""

_SETS_OUT_S: Final = 5.0
"""Within that time the first motion of a way home is sent: one may be waited for that was lost."""

_ENDS: Final = re.compile("coming home|hands off|leaving ")
_FLIES: Final = frozenset({"INIT", "SEARCH", "COMM", "EXPL", "GOTO", "HOLD"})


class RequestJudge(CompanionsSeat):
    """Judges what followed an accepted "hold" or "home" of the operator."""

    def judge(self) -> None:
        """Look at every request until the next one."""
        requests = list(self.track.evidence.told(SceneEventKind.REQUEST))
        until_s = [request.time_s for request in requests[1:]] + [float(self.track.time_s[-1])]
        for request, end_s in zip(requests, until_s, strict=False):
            if self._is_accepted(request):
                match str(request.value).split()[0]:
                    case "hold":
                        self._judge_hold(request.time_s, end_s)
                    case "home":
                        self._judge_home(request.time_s, end_s)

    def _is_accepted(self, request: SceneEvent) -> bool:
        """Whether the companion promised to do it now."""
        until_s = request.time_s + _ANSWERED_S
        for at_s, text in self._said:
            if request.time_s <= at_s <= until_s and (answer := _ANSWER.search(text)):
                return answer[1] == "accepted" and not _NO_MORE.search(answer[2])
        return False

    def _judge_hold(self, asked_s: float, until_s: float) -> None:
        ends = (at_s for at_s, text in self._said if at_s > asked_s and _ENDS.search(text))
        until_s = min(until_s, next(ends, until_s), asked_s + _HOLDS_S)
        from_s = asked_s + _TURNS_S + self.notice_s
        self._judge_standing(asked_s, (from_s, until_s - 0.1), "a hold was accepted", "request")

    def _judge_home(self, asked_s: float, until_s: float) -> None:
        due_s = asked_s + _SETS_OUT_S + self.notice_s
        if until_s < due_s or self._state(asked_s - 0.01) not in _FLIES:
            return
        if not self._answers(asked_s, due_s):
            return
        sent = (m.time_s for m in self.track.commands() if is_motion(m))
        if not any(asked_s <= at_s <= due_s for at_s in sent):
            text = f"nothing was sent, though a way home was accepted at {asked_s:.1f} s"
            self.add(due_s, "request", text)
