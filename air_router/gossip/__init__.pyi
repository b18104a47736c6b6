# What `air_router.gossip` gives, for type checkers; `__init__.py` says where it is.

from air_router.gossip.gossip import MAP_INTERVAL_S as MAP_INTERVAL_S
from air_router.gossip.gossip import Gossip as Gossip
from air_router.gossip.interactions import ContactSpan as ContactSpan
from air_router.gossip.interactions import Interactions as Interactions
from air_router.gossip.interactions import Sync as Sync
from air_router.gossip.limits import MARGIN_M as MARGIN_M
from air_router.gossip.limits import RESOLUTION_M as RESOLUTION_M
from air_router.gossip.mapper import Mapper as Mapper
from air_router.gossip.mapper import receive_patches as receive_patches
from air_router.gossip.ros_messages import MAP_FRAME as MAP_FRAME
from air_router.gossip.ros_messages import Datum as Datum
from air_router.gossip.ros_messages import occupancy_of as occupancy_of
from air_router.gossip.ros_messages import readers_of as readers_of
from air_router.gossip.ros_messages import stamp as stamp
from air_router.gossip.team_messages import TeamMessageDecoder as TeamMessageDecoder
