# What `air_router.vehicle.px4` gives, for type checkers; `__init__.py` says where it is.

from air_router.vehicle.px4.key_provisioning import provide as provide
from air_router.vehicle.px4.key_provisioning import remove as remove
from air_router.vehicle.px4.limits import FIND_S as FIND_S
from air_router.vehicle.px4.mavlink_values import COMPANION_COMPONENT as COMPANION_COMPONENT
from air_router.vehicle.px4.px4 import Px4Vehicle as Px4Vehicle
from air_router.vehicle.px4.px4_connection import Plugins as Plugins
from air_router.vehicle.px4.px4_connection import Px4Connection as Px4Connection
from air_router.vehicle.px4.signing_key import SigningKey as SigningKey
from air_router.vehicle.px4.versions import FACTS as FACTS
from air_router.vehicle.px4.versions import FLOWN as FLOWN
from air_router.vehicle.px4.versions import NEWEST as NEWEST
from air_router.vehicle.px4.versions import OLDEST as OLDEST
from air_router.vehicle.px4.versions import Version as Version
from air_router.vehicle.px4.versions import VersionFact as VersionFact
from air_router.vehicle.px4.versions import name_of as name_of
from air_router.vehicle.px4.versions import version_of as version_of
