"""Serves the tiles of a file to the map: read in a thread, for the loop may be that of a flight."""

import asyncio
import base64
import logging
from concurrent.futures import ThreadPoolExecutor

from aiohttp import web

from air_router.web.tile_file import TileError, TileFile

_LOG = logging.getLogger(__name__)
_NUMBER = "[0-9]{1,9}"
_KEPT = {"Cache-Control": "private, max-age=3600"}
_NOT_KEPT = {"Cache-Control": "no-store"}
# One pixel that is not seen: for a browser, a tile that is not found is an error to be told.
_NOTHING = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAQAAAC1HAwCAAAAC0lEQVR42mNgYAAAAAMAASsJTYQAAAAASUVORK5CYII="
)


class TileService:
    """What is not there, or cannot be read, is an empty picture; the first fault is logged."""

    def __init__(self, tiles: TileFile) -> None:
        self._tiles = tiles
        self._worker = ThreadPoolExecutor(1, "map tiles")  # SQLite files stay on one thread
        self._told = False  # the first fault was logged

    def add_to(self, app: web.Application) -> None:
        """Serve the tiles, until the application ends."""
        path = f"/backdrop/{{tag}}/{{zoom:{_NUMBER}}}/{{column:{_NUMBER}}}/{{row:{_NUMBER}}}"
        app.add_routes([web.get(path, self._answer)])
        app.on_cleanup.append(self._end)

    async def _answer(self, request: web.Request) -> web.Response:
        asked = request.match_info
        if asked["tag"] != self._tiles.tag:  # a page from before, of another file
            return _nothing(_NOT_KEPT)
        place = int(asked["zoom"]), int(asked["column"]), int(asked["row"])
        loop = asyncio.get_running_loop()
        try:
            tile = await loop.run_in_executor(self._worker, self._tiles.tile, *place)
        except TileError as error:
            self._tell(error)
            return _nothing(_NOT_KEPT)
        if tile is None:
            return _nothing(_KEPT)
        return web.Response(body=tile.data, content_type=tile.kind, headers=_KEPT)

    def _tell(self, error: TileError) -> None:
        if not self._told:
            _LOG.warning("the map stays empty in places: %s", error)
        self._told = True

    async def _end(self, app: web.Application) -> None:
        del app
        self._worker.shutdown(wait=False, cancel_futures=True)


def _nothing(headers: dict[str, str]) -> web.Response:
    return web.Response(body=_NOTHING, content_type="image/png", headers=headers)
