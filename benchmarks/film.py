"""Renders a recorded flight on the map page: the README's 20 s animation, and stills.

make film RECORD=logs/sim-....mcap
"""

from __future__ import annotations

import argparse
import asyncio
import io
from pathlib import Path
from typing import Any

from PIL import Image

from air_router.live import Playback, RecordedFlight
from air_router.record import Log
from air_router.web import Web
from benchmarks.browser import chromium

LASTS_S = 20
FRAMES_PER_S = 6
SIZE = {"width": 1000, "height": 562}
GO = """([to]) => { const when = document.getElementById("when");
  when.value = String(to); when.dispatchEvent(new Event("change")); }"""
IS_THERE = "([to]) => parseInt(document.getElementById('clock').textContent) >= Math.floor(to)"


async def frames(record: Path, folder: Path, from_s: float, to_s: float) -> list[Image.Image]:
    """Screenshots at regular times; one of the timeline at the last time goes to the folder."""
    from playwright.async_api import async_playwright  # noqa: PLC0415 - not for the other ones

    film = RecordedFlight(Log(record))
    count = LASTS_S * FRAMES_PER_S
    async with Playback(film, Web()).serving(print) as address, async_playwright() as playwright:
        path, options = chromium(), ["--no-sandbox"]
        browser = await playwright.chromium.launch(executable_path=path, args=options)
        page: Any = await browser.new_page(viewport=SIZE)
        await page.goto(address)
        await page.locator("#pause").click()
        shown = []
        for number in range(count):
            moment = [film.begin_s + from_s + (to_s - from_s) * number / count]
            await page.evaluate(GO, moment)
            await page.wait_for_function(IS_THERE, arg=moment)
            await page.wait_for_timeout(120)
            shown.append(Image.open(io.BytesIO(await page.screenshot())).convert("RGB"))
        await page.locator("#plot").click()
        await page.set_viewport_size({"width": 1280, "height": 720})
        await page.mouse.move(100, 200)
        await page.wait_for_timeout(2000)
        await page.screenshot(path=folder / "live-timeline.png")
        await browser.close()
    return shown


def main() -> None:
    """Render animation and stills."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.film",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("record", type=Path, help="record of a flight (.mcap)")
    parser.add_argument("folder", type=Path, help="folder to write flight.webp and the stills into")
    parser.add_argument(
        "--from-s", type=float, default=0.0, help="start, in seconds of the record (0)"
    )
    parser.add_argument("--to-s", type=float, default=600.0, help="end (600)")
    given = parser.parse_args()
    first, *others = asyncio.run(frames(given.record, given.folder, given.from_s, given.to_s))
    picture = given.folder / "flight.webp"
    duration_ms = 1000 // FRAMES_PER_S
    options = {
        "duration": duration_ms,
        "loop": 0,
        "quality": 55,
        "method": 4,
        "minimize_size": True,
    }
    first.save(picture, save_all=True, append_images=others, **options)
    print(f"{picture}: {picture.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
