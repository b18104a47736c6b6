# What `air_router.control` gives, for type checkers; `__init__.py` says where it is.

from air_router.control.command_request import COSTLY_AT_ONCE as COSTLY_AT_ONCE
from air_router.control.command_request import COSTLY_PER_S as COSTLY_PER_S
from air_router.control.command_request import MODELS as MODELS
from air_router.control.command_request import TOO_MANY as TOO_MANY
from air_router.control.command_request import Budget as Budget
from air_router.control.command_request import CommandRequest as CommandRequest
from air_router.control.command_request import RequestHandler as RequestHandler
from air_router.control.command_request import View as View
from air_router.control.command_request import command_request_of as command_request_of
from air_router.control.command_request import parse_command as parse_command
from air_router.control.control import CONTROL_NAME as CONTROL_NAME
from air_router.control.control import ControlClient as ControlClient
from air_router.control.control import ControlError as ControlError
from air_router.control.control import ControlReply as ControlReply
from air_router.control.control import ControlUnreachableError as ControlUnreachableError
from air_router.control.control import endpoint_of as endpoint_of
from air_router.control.control_server import ControlServer as ControlServer
