"""Map pages in the browser: the server, protection from other sites, shared parts."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "guard": ("cookie_of",),
        "outlines": (
            "Degrees",
            "Rings",
            "area_beside",
            "beside",
            "buffer",
            "degrees",
            "line",
            "place_in",
        ),
        "serving": (
            "HERE",
            "PageAddress",
            "SHOWN_AT",
            "Say",
            "ServeError",
            "Served",
            "Web",
            "page_options",
            "web_options",
            "page_port",
            "show",
            "shown_beside",
            "web_of",
        ),
        "site": ("Browsers", "PageOutbox", "Site", "as_json"),
    },
)
