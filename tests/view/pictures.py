"""What a test reads from the page: the scene as it is drawn, and the words."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

NODE = """name => {
    const node = window.__viserMutable.nodeRefFromName[name], {x, y, z, w} = node.quaternion;
    return {visible: node.visible, position: node.position.toArray(), wxyz: [w, x, y, z]};
}"""


def node(page, name):
    """Where a node of the scene is, in its parent."""
    return page.evaluate(NODE, name)


def picture(page):
    """The canvas of the scene as it is seen, (height, width, 3)."""
    box = page.locator("canvas[data-engine^=three]").bounding_box()
    clip = {"x": 310, "y": 0, "width": box["width"] - 320, "height": box["height"]}
    return np.asarray(Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("RGB"))


def told(page, name):
    """The numbers in a line of the panel: `position`, `velocity`, ..."""
    cells = page.locator(f"[data-told={name}] ~ code").all_inner_texts()
    return [float(cell) for cell in cells]


def caption(page, chart):
    """The numbers over a chart: of each line, and of what stands behind it."""
    lines = page.locator(f'[data-chart="{chart}"] span')
    return {
        line.evaluate("e => e.firstChild.textContent.trim()"): [
            cell.strip() for cell in line.locator("code, em").all_inner_texts()
        ]
        for line in lines.all()
    }
