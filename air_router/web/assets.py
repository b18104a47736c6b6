"""The files that pages are made of, out of the package: nothing else can be asked for."""

import hashlib
import mimetypes
from importlib.resources import files
from importlib.resources.abc import Traversable

from aiohttp import web

_TYPES = {
    ".js": "text/javascript",
    ".css": "text/css",
    ".html": "text/html",
    ".svg": "image/svg+xml",
}


class Assets:
    """Files by the path under which they are served, all of them in memory."""

    def __init__(self) -> None:
        self._files: dict[str, tuple[bytes, str, str]] = {}  # content, type, ETag

    def add(self, package: str, folder: str, prefix: str) -> None:
        """Serve the files of a package's folder, and of those in it, under a prefix ("/page/")."""
        self._walk(files(package) / folder, prefix)

    def routes(self) -> list[web.RouteDef]:
        """What to add to an application."""
        return [web.get(path, self._serve) for path in self._files]

    async def page(self, path: str, request: web.Request) -> web.Response:
        """One of the files, whatever the request's own path."""
        content, kind, tag = self._files[path]
        if tag in request.headers.get("If-None-Match", ""):
            return web.Response(status=304, headers={"ETag": tag})
        return web.Response(
            body=content, content_type=kind, charset=_charset(kind), headers={"ETag": tag}
        )

    async def _serve(self, request: web.Request) -> web.Response:
        return await self.page(request.path, request)

    def _walk(self, folder: Traversable, prefix: str) -> None:
        for entry in folder.iterdir():
            if entry.is_dir():
                self._walk(entry, f"{prefix}{entry.name}/")
            elif not entry.name.startswith("."):
                content = entry.read_bytes()
                suffix = f".{entry.name.rpartition('.')[2]}"
                kind = _TYPES.get(suffix) or mimetypes.guess_type(entry.name)[0] or "text/plain"
                tag = f'"{hashlib.sha256(content).hexdigest()[:20]}"'
                self._files[prefix + entry.name] = (content, kind, tag)


def _charset(kind: str) -> str | None:
    return "utf-8" if kind.startswith("text/") else None
