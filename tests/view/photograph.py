"""Take a picture of a page that `gcs view` serves: python -m tests.view.photograph URL FILE [T].

With T the slider of a recording is set to that time (s). The pictures in docs are made with it.
"""

from __future__ import annotations

import shutil
import sys

from playwright.sync_api import sync_playwright

from tests.view.conftest import CHROMIUM, OPTIONS

SETTLED = """t => {
    const said = document.querySelector('[data-told=time] ~ code')?.innerText;
    return said !== undefined && (t === null || Number(said) === t);
}"""
FRAMES = (
    "n => new Promise(done => { const f = () => n-- ? requestAnimationFrame(f) : done(); f(); })"
)


def photograph(url: str, path: str, t: float | None) -> None:
    with sync_playwright() as playwright:
        chromium = next(filter(None, map(shutil.which, CHROMIUM)))
        browser = playwright.chromium.launch(executable_path=chromium, args=OPTIONS)
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(url)
        page.locator("button.mantine-Notification-closeButton").click()  # rendered in software
        if t is not None:
            field = page.locator("input[inputmode]").first
            field.fill(f"{t:g}")
            field.press("Enter")
        page.wait_for_function(SETTLED, arg=t)
        page.evaluate(FRAMES, 30)
        page.screenshot(path=path)
        browser.close()


if __name__ == "__main__":
    photograph(sys.argv[1], sys.argv[2], float(sys.argv[3]) if len(sys.argv) > 3 else None)
