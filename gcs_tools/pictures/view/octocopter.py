"""An octocopter to look at: arms where the controller believes its rotors are, discs by thrust.

Frame: body Forward-Left-Up, the rotor plane at z = 0; metres.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fcu.interface.airframe import Airframe
from gcs_tools.recording.table import Rows

if TYPE_CHECKING:
    import viser

Colour = tuple[int, int, int]

PROPELLER_M = 0.19  # radius, of 15 inch propellers (DJI)
DARK: Colour = (52, 56, 62)
GREY: Colour = (120, 126, 134)
NOSE: Colour = (213, 94, 0)
# viridis: as even to colour-blind eyes as to others
SHARES = np.array([(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)])


def share_colour(share: float) -> Colour:
    """The colour of a rotor that gives this part (0 to 1) of its greatest thrust."""
    at = (len(SHARES) - 1) * (min(max(share, 0.0), 1.0) if math.isfinite(share) else 0.0)
    low = min(int(at), len(SHARES) - 2)
    red, green, blue = (SHARES[low] + (at - low) * (SHARES[low + 1] - SHARES[low])).round()
    return int(red), int(green), int(blue)


def about_z(angle: float) -> tuple[float, float, float, float]:
    """The quaternion, scalar first, of a turn about z (rad)."""
    return math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)


class Octocopter:
    """The vehicle in the scene, at the node `name`."""

    def __init__(self, scene: viser.SceneApi, name: str, airframe: Airframe) -> None:
        self._frame = scene.add_frame(name, show_axes=False, visible=False)
        rotors = list(zip(airframe.x, airframe.y, strict=True))
        scene.add_cylinder(f"{name}/hub", 0.17, 0.05, DARK, position=(0.0, 0.0, -0.03))
        scene.add_cylinder(f"{name}/dome", 0.11, 0.05, GREY, position=(0.0, 0.0, 0.02))
        scene.add_box(
            f"{name}/pack", DARK, dimensions=(0.22, 0.11, 0.08), position=(0.0, 0.0, -0.1)
        )
        self._discs = []
        for i, (x, y) in enumerate(rotors, 1):
            angle, radius = math.atan2(y, x), math.hypot(x, y)
            ahead = abs(angle) < math.radians(45.0)
            scene.add_box(
                f"{name}/arm_{i}", NOSE if ahead else DARK, dimensions=(radius, 0.028, 0.022),
                wxyz=about_z(angle), position=(x / 2, y / 2, -0.03),
            )  # fmt: skip
            scene.add_cylinder(
                f"{name}/motor_{i}", 0.03, 0.06, NOSE if ahead else GREY, position=(x, y, -0.01)
            )
            disc = scene.add_cylinder(
                f"{name}/disc_{i}", PROPELLER_M, 0.008, share_colour(0.0), position=(x, y, 0.025),
            )  # fmt: skip
            self._discs.append(disc)
        for side, y in (("left", 0.2), ("right", -0.2)):
            tilt = math.copysign(0.25, y)
            scene.add_box(
                f"{name}/leg_{side}", DARK, dimensions=(0.022, 0.022, 0.26),
                wxyz=(math.cos(tilt / 2), math.sin(tilt / 2), 0.0, 0.0), position=(0.0, y, -0.165),
            )  # fmt: skip
            scene.add_box(
                f"{name}/foot_{side}", DARK, dimensions=(0.36, 0.025, 0.025),
                position=(0.0, 1.17 * y, -0.29),
            )  # fmt: skip
        self._shares: list[Colour] = []

    def show(self, r_E: Rows, q_EB: Rows, shares: Rows) -> None:
        """Stand at r_E (m) with the attitude q_EB, its rotors giving these parts of their most."""
        self._frame.position = r_E
        self._frame.wxyz = q_EB
        self._frame.visible = True
        colours = [share_colour(float(share)) for share in shares]
        if colours != self._shares:
            for disc, colour in zip(self._discs, colours, strict=True):
                disc.color = colour
            self._shares = colours
