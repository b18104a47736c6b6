"""How severe an announcement is, and what the pilot or the operator does about it.

Every instruction is here. `Instruction` is a type of its own, and is made here only: without one
`mypy` lets no warning and no alarm pass. Each begins with who acts. They are short, because a
ground station reads them aloud.
"""

from enum import Enum
from typing import Final, NewType


class Severity(Enum):
    """How severe an announcement is to the pilot and the operator."""

    INFO = "info"  # for the log: nothing to do
    WARNING = "warning"  # something is off; the flight copes, or soon will not
    ALARM = "alarm"  # the pilot has to act


Instruction = NewType("Instruction", str)
"""What the pilot or the operator does: "Pilot: ..." or "Operator: ..."."""

TAKE_OVER: Final = Instruction("Pilot: take over in Position mode and fly it by hand")
TAKE_OVER_NOW: Final = Instruction("Pilot: take over by hand now")
TAKE_OVER_BLIND: Final = Instruction(
    "Pilot: take over in Position mode, or in Altitude mode if PX4 refuses that"
)
BE_READY: Final = Instruction("Pilot: watch it, and be ready to take over")
CLEARANCE_UNCERTAIN: Final = Instruction(
    "Pilot: it may be nearer to zones than it reports; be ready to take over"
)
BE_READY_AT_HOME: Final = Instruction("Pilot: keep the landing place clear, be ready to take over")
WATCH_HEIGHT: Final = Instruction("Pilot: judge its height by eye, and be ready to take over")
WATCH_FAILSAFE: Final = Instruction(
    "Pilot: watch what PX4 does, and take over if it nears a zone or people"
)
HOME_OR_TAKE_OVER: Final = Instruction(
    "Operator: 'home'. Pilot: or take over in Position mode and fly it by hand"
)
TAKE_FROM_HERE: Final = Instruction("Pilot: take over, or let PX4 return it")
CHOOSE_AGAIN: Final = Instruction("Pilot: choose your flight mode again if you want it")
IN_YOUR_HANDS: Final = Instruction(
    "Pilot: fly it by hand. Operator: 'resume' continues the mission, 'home' brings it home"
)
TAKE_WHERE_IT_HOLDS: Final = Instruction(
    "Pilot: take over where it hovers. Operator: 'resume' regains control once that is possible"
)
LAND_BY_HAND: Final = Instruction("Pilot: fly the vehicle by hand, and land it")
SEPARATE_TWINS: Final = Instruction(
    "Pilot: fly both by hand. Operator: give each vehicle a MAV_SYS_ID and a link of its own"
)
CONNECT_ANOTHER: Final = Instruction(
    "Operator: connect a multicopter, or choose its airframe (MAV_TYPE) in PX4"
)
FLY_OUT: Final = Instruction("Pilot: fly it out by hand, by the shortest clear way")
FLY_OUT_OR_RELOAD: Final = Instruction(
    "Operator: remove a zone and 'reload'. Pilot: or fly it out by hand"
)
OUT_OF_ITS_WAY: Final = Instruction("Pilot: take over if it has not left within 10 s")
LAND_AND_START_AGAIN: Final = Instruction("Pilot: land by hand, and start from home")
DESCEND: Final = Instruction("Pilot: descend to the mission's layer. Operator: then 'resume'")
CLIMB_BY_HAND: Final = Instruction("Pilot: climb to the mission's altitude by hand, choose Hold")
KEEP_CLEAR: Final = Instruction(
    "Pilot: keep people away from the area below. Operator: note its last position"
)
CHECK_LINK: Final = Instruction(
    "Pilot: keep it in sight, take over by remote control. Operator: check the link"
)
FREE_PROCESSOR: Final = Instruction(
    "Operator: free the companion's processor and disk. Pilot: be ready to take over"
)
CHECK_SENDERS: Final = Instruction(
    "Operator: find the other sender on this link. Pilot: be ready to take over by remote control"
)
CHECK_STREAMS: Final = Instruction("Operator: check the link and the stream rates of PX4")
WATCH_BATTERY: Final = Instruction("Pilot: watch the battery on the ground station or the remote")
READ_PX4: Final = Instruction("Operator: read in the ground station why PX4 rejects the plan")
NO_UPLOADS: Final = Instruction("Operator: upload nothing from a ground station in flight")
UPLOAD_OURS: Final = Instruction("Operator: 'resume upload' restores this mission's plan")
NO_OTHER_HOME: Final = Instruction(
    "Operator: do not set home in flight. Pilot: PX4's own Return flies to the new one"
)
RETURN_ELSEWHERE: Final = Instruction(
    "Pilot: PX4's own Return flies to the new home; take over rather than choose it"
)
NO_OTHER_SPEED: Final = Instruction(
    "Operator: do not set the speed in flight. Pilot: take over if it does not slow down"
)
TOO_MUCH_WIND: Final = Instruction("Operator: 'home', if the wind is too strong")
RELOAD_AGAIN: Final = Instruction("Operator: 'reload' again in a moment")
REQUEST_AGAIN: Final = Instruction("Operator: request it again once the vehicle hovers")
RESUME_AGAIN: Final = Instruction("Operator: 'resume' again once that is done")
BRING_HOME_BY_HEIGHT: Final = Instruction(
    "Operator: a second 'home' uses PX4's altitude alone. Pilot: or fly it out by hand"
)
CHECK_LOCALISATION: Final = Instruction(
    "Operator: check the localization of that robot, or 'seek' another"
)
CHECK_PEER: Final = Instruction(
    "Operator: check that robot's program, or its entry in the team file (docs/robot.md)"
)
