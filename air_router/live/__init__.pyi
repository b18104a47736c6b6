# What `air_router.live` gives, for type checkers; `__init__.py` says where it is.

from air_router.live.joint import JointPage as JointPage
from air_router.live.playback import Playback as Playback
from air_router.live.playback import RecordedFlight as RecordedFlight
from air_router.live.scene import scenery as scenery
from air_router.live.server import LivePage as LivePage
