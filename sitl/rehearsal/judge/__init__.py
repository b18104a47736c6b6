"""The judge of rehearsed flights, which shares no code with them."""

from sitl.rehearsal.judge import space, verdict
from sitl.rehearsal.judge.acceptance import End
from sitl.rehearsal.judge.case import Case, Responsible, Rule, Violation
from sitl.rehearsal.judge.evidence import (
    AUTOPILOT,
    COMPANION,
    AnnouncedLine,
    Evidence,
    EvidenceError,
    FlightRecord,
    Frame,
    Sample,
    SceneEvent,
    SceneEventKind,
    WireMessage,
    is_motion,
)
from sitl.rehearsal.judge.mission_reader import Area, Pair, RawMission, read_mission
from sitl.rehearsal.judge.space import leads_home, open_space, rooms_of
from sitl.rehearsal.judge.verdict import Verdict, end_of, judge

__all__ = [
    "AUTOPILOT",
    "COMPANION",
    "AnnouncedLine",
    "Area",
    "Case",
    "End",
    "Evidence",
    "EvidenceError",
    "FlightRecord",
    "Frame",
    "Pair",
    "RawMission",
    "Responsible",
    "Rule",
    "Sample",
    "SceneEvent",
    "SceneEventKind",
    "Verdict",
    "Violation",
    "WireMessage",
    "end_of",
    "is_motion",
    "judge",
    "leads_home",
    "open_space",
    "read_mission",
    "rooms_of",
    "space",
    "verdict",
]
