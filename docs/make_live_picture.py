"""Make docs/pictures/live-page.webp: the live page of `ohmward run --demo` after two minutes, in headless Chromium.

Needs Chromium, and playwright and Pillow from PyPI: python docs/make_live_picture.py
"""

import io
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

PICTURE = Path(__file__).parent / "pictures" / "live-page.webp"

#: Time after which charge, slip, path and range all show [s].
WAIT_S = 120.0

SIZE = {"width": 1280, "height": 1000}


def main(wait_s: float = WAIT_S) -> None:
    """Run the demonstration, look at its page, write the picture."""
    command = [sys.executable, "-m", "ohmward", "run", "--demo"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            picture = photograph(address(process), wait_s)
        finally:
            process.terminate()
    Image.open(io.BytesIO(picture)).convert("RGB").save(PICTURE, quality=80, method=6)
    print(f"{PICTURE}: {PICTURE.stat().st_size / 1000:.0f} kB")


def address(process: subprocess.Popen[str]) -> str:
    """Address of the page, from the log of the process."""
    assert process.stderr
    for line in process.stderr:
        if found := re.search(r"the page of .*: (http\S+)", line):
            return found[1]
    raise SystemExit("the process ended without a page")


def photograph(url: str, wait_s: float) -> bytes:
    """PNG of the page after a while."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(viewport=SIZE, color_scheme="light")
        page.goto(url)
        time.sleep(wait_s)
        png = page.screenshot(full_page=True)
        browser.close()
    return png


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
