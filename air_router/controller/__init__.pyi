# What `air_router.controller` gives, for type checkers; `__init__.py` says where it is.

from air_router.controller.airspace_change import widened_router as widened_router
from air_router.controller.command_handler import NOT_HEARD_S as NOT_HEARD_S
from air_router.controller.controller import Controller as Controller
