# What `mocha_link.ros` gives, for type checkers; `__init__.py` has the module of each.

from mocha_link.ros.ros import RosCodec as RosCodec
from mocha_link.ros.ros import RosError as RosError
from mocha_link.ros.ros_store import RosTypes as RosTypes
from mocha_link.ros.ros_store import element as element
from mocha_link.ros.typed import Typed as Typed
from mocha_link.ros.typed import TypedError as TypedError
from mocha_link.ros.typed import Types as Types
