# SPDX-License-Identifier: BSD-2-Clause
"""Pictures of the page, taken by a browser without a window."""

import io
import os
import shutil
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..arrays import whole_number
from ..errors import BrowserError, MissingExtraError
from ..progress import counted

#: Programs that can take the pictures; the first one that is installed is used.
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")

#: Time for a page to load, [s]; large meshes are slow without a graphics card.
_PATIENCE = 240


def find_browser() -> str:
    """Path of a Chromium; BrowserError when there is none."""
    for path in filter(None, map(shutil.which, BROWSERS)):
        return path
    raise BrowserError(f"no browser found ({', '.join(BROWSERS)}); run: apt install chromium")


@contextmanager
def browser() -> Iterator[Any]:
    """A Chromium without a window, as Playwright's `Browser`; its failures are BrowserErrors."""
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError:
        raise MissingExtraError("playwright", "viz") from None
    path = find_browser()
    arguments = ["--enable-unsafe-swiftshader"]  # WebGL without a graphics card
    if hasattr(os, "geteuid") and os.geteuid() == 0:  # Windows has no `geteuid`
        arguments.append("--no-sandbox")  # as root, Chromium does not start with its sandbox
    with sync_playwright() as playwright:
        try:
            chromium = playwright.chromium.launch(executable_path=path, args=arguments)
        except Error as error:
            raise BrowserError(f"{path} does not start: {_first_line(error.message)}") from None
        try:
            with chromium:
                yield chromium
        except Error as error:
            raise BrowserError(f"{path} failed: {_first_line(error.message)}") from None


def _first_line(message: str) -> str:
    """The first line of a message, which may be empty."""
    return message.partition("\n")[0]


def png(html: str) -> bytes:
    """A PNG of the page, taken after a fifth of the motion."""
    (picture,) = _pictures(html, [0.2], (1280, 640), 2.0)
    return picture


def gif(
    html: str, frames: int = 36, seconds: float = 4.0, size: tuple[int, int] = (960, 480)
) -> bytes:
    """A GIF that repeats endlessly.

    Args:
        html: The page.
        frames: Number of pictures of the motion, at least one.
        seconds: Duration, [s].
        size: Width and height, [px].
    """
    frames = whole_number("frames", frames, 1)
    screenshots = _pictures(html, [i / frames for i in range(frames)], size, 1.0)
    from PIL import Image

    pictures = [Image.open(io.BytesIO(screenshot)).convert("RGB") for screenshot in screenshots]
    # All pictures have the palette of one of them, a third of the way through: with palettes of
    # their own, the colours would flicker.
    coverage = Image.Quantize.MAXCOVERAGE  # keeps white
    palette = pictures[len(pictures) // 3].quantize(128, coverage, dither=Image.Dither.NONE)
    images = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    file = io.BytesIO()
    duration = round(1000 * seconds / frames)
    images[0].save(file, "GIF", save_all=True, append_images=images[1:], duration=duration, loop=0)
    return file.getvalue()


def _pictures(html: str, shares: list[float], size: tuple[int, int], scale: float) -> list[bytes]:
    """Pictures of a page as PNG.

    Args:
        html: The page.
        shares: When pictures are taken, as shares of the motion from 0 to 1.
        size: Width and height of the page, [px].
        scale: Pixels of a picture for each pixel of the page.
    """
    # In a new thread: Playwright's synchronous interface fails in a thread with an event loop, such
    # as that of a notebook.
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(_take, html, shares, size, scale).result()


def _take(html: str, shares: list[float], size: tuple[int, int], scale: float) -> list[bytes]:
    """`_pictures`, in the thread that calls it."""
    viewport = {"width": size[0], "height": size[1]}
    pictures = []
    with tempfile.TemporaryDirectory() as folder, browser() as chromium:
        file = Path(folder, "page.html")
        file.write_text(html, encoding="utf-8")
        page = chromium.new_page(viewport=viewport, device_scale_factor=scale)
        page.set_default_timeout(1e3 * _PATIENCE)
        page.goto(file.as_uri())
        page.evaluate("panel.picture()")  # hides the controls of the page
        for share in counted(shares, "pictures", len(shares)):
            # `still` stops the motion at this share and waits until the page is drawn.
            page.evaluate("share => panel.still(share)", share)
            pictures.append(page.screenshot())
    return pictures
