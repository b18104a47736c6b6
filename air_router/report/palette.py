"""The colours of the map pages, which pictures and reports share: they stand in one style sheet."""

import re
from functools import cache
from importlib import resources

_COLOUR = re.compile(r"--([\w-]+):\s*(#\w+);")
_LIGHT, _DARK = ":root {", ':root[data-theme="dark"] {'


@cache
def colours(*, dark: bool = False) -> dict[str, str]:
    """Each colour by its name, such as "fence"."""
    sheet = resources.files("air_router.web").joinpath("page", "theme.css").read_text("utf-8")
    block = sheet.partition(_DARK if dark else _LIGHT)[2].partition("}")[0]
    return dict(_COLOUR.findall(block))


def style_sheet() -> str:
    """All of them as CSS, light or dark as the system says."""
    light, dark = (
        " ".join(f"--{name}: {colour};" for name, colour in colours(dark=is_dark).items())
        for is_dark in (False, True)
    )
    return (
        f":root {{ color-scheme: light dark; {light} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
    )
