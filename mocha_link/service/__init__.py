"""A node's messages and metrics for other programs on the same machine."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "endpoint": ("EndpointKeyError", "folder", "ipc_endpoint"),
        "listener": ("Listener",),
        "prometheus": ("PrometheusServer",),
        "requests": ("Request",),
        "server": ("MetricsServer", "as_fields"),
        "service": ("Service", "ServiceServer"),
        "service_client": (
            "EndpointClient",
            "MetricsError",
            "ServiceClient",
            "ServiceError",
            "ServiceUnreachableError",
            "Subscription",
            "TEXT",
            "split",
            "watch",
        ),
    },
    modules=("requests",),
)
