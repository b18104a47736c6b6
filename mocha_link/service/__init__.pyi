# What `mocha_link.service` gives, for type checkers; `__init__.py` has the module of each.

from mocha_link.service import requests as requests
from mocha_link.service.endpoint import EndpointKeyError as EndpointKeyError
from mocha_link.service.endpoint import folder as folder
from mocha_link.service.endpoint import ipc_endpoint as ipc_endpoint
from mocha_link.service.listener import Listener as Listener
from mocha_link.service.prometheus import PrometheusServer as PrometheusServer
from mocha_link.service.requests import Request as Request
from mocha_link.service.server import MetricsServer as MetricsServer
from mocha_link.service.server import as_fields as as_fields
from mocha_link.service.service import Service as Service
from mocha_link.service.service import ServiceServer as ServiceServer
from mocha_link.service.service_client import TEXT as TEXT
from mocha_link.service.service_client import EndpointClient as EndpointClient
from mocha_link.service.service_client import MetricsError as MetricsError
from mocha_link.service.service_client import ServiceClient as ServiceClient
from mocha_link.service.service_client import ServiceError as ServiceError
from mocha_link.service.service_client import ServiceUnreachableError as ServiceUnreachableError
from mocha_link.service.service_client import Subscription as Subscription
from mocha_link.service.service_client import split as split
from mocha_link.service.service_client import watch as watch
