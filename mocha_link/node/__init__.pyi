# What `mocha_link.node` gives, for type checkers; `__init__.py` has the module of each.

from mocha_link.node import kernel as kernel
from mocha_link.node.curve import CurveServer as CurveServer
from mocha_link.node.gossip import TIMEOUT_S as TIMEOUT_S
from mocha_link.node.gossip import Gossip as Gossip
from mocha_link.node.kernel import Poller as Poller
from mocha_link.node.node import Node as Node
from mocha_link.node.node import NodeClosedError as NodeClosedError
from mocha_link.node.router import IDLE_MS as IDLE_MS
from mocha_link.node.router import ClientConnections as ClientConnections
from mocha_link.node.router import Router as Router
from mocha_link.node.transport import Transport as Transport
from mocha_link.node.zmtp import Mechanism as Mechanism
from mocha_link.node.zmtp import Null as Null
from mocha_link.node.zmtp import Part as Part
from mocha_link.node.zmtp import ZmtpSession as ZmtpSession
