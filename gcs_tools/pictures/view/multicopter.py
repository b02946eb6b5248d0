"""A multicopter to look at: arms where the controller believes its rotors are, discs by thrust.

Frame: body Forward-Left-Up, the rotor plane at z = 0, of two rotors in one place the second below it;
metres. All but the arms is that of an S1000, as much smaller as they are shorter.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs_tools.pictures.quantities import ShownLimits
from gcs_tools.recording.table import Rows

if TYPE_CHECKING:
    import viser

Colour = tuple[int, int, int]
Place = tuple[float, float, float]
Turn = tuple[float, float, float, float]  # a quaternion, scalar first

ARM_M = 0.5225  # of an S1000; the sizes below are its
PROPELLER_M = 0.19  # radius, of 15 inch propellers (DJI)
BELOW_M = 0.1  # the second of two rotors in one place
DARK: Colour = (52, 56, 62)
GREY: Colour = (120, 126, 134)
NOSE: Colour = (213, 94, 0)
UPRIGHT: Turn = (1.0, 0.0, 0.0, 0.0)
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


class Multicopter:
    """The vehicle in the scene, at the node `name`."""

    def __init__(self, scene: viser.SceneApi, name: str, limits: ShownLimits) -> None:
        """`limits`: of the flight, with where its rotors are."""
        self._of = limits.x, limits.y
        self._frame = scene.add_frame(name, show_axes=False, visible=False)
        rotors = list(zip(limits.x, limits.y, strict=True))
        arms = [math.hypot(x, y) for x, y in rotors]
        s = max(arms, default=0.0) / ARM_M

        def box(part: str, colour: Colour, size: Place, at: Place, wxyz: Turn = UPRIGHT) -> None:
            size, at = (s * size[0], s * size[1], s * size[2]), (s * at[0], s * at[1], s * at[2])
            scene.add_box(f"{name}/{part}", colour, dimensions=size, wxyz=wxyz, position=at)

        for part, radius, colour, z in (("hub", 0.17, DARK, -0.03), ("dome", 0.11, GREY, 0.02)):
            at = (0.0, 0.0, s * z)
            scene.add_cylinder(f"{name}/{part}", s * radius, s * 0.05, colour, position=at)
        box("pack", DARK, (0.22, 0.11, 0.08), (0.0, 0.0, -0.1))
        self._discs = []
        for i, ((x, y), radius) in enumerate(zip(rotors, arms, strict=True), 1):
            angle = math.atan2(y, x)
            ahead = abs(angle) < math.radians(46.0)
            z = -s * BELOW_M if (x, y) in rotors[: i - 1] else 0.0
            scene.add_box(
                f"{name}/arm_{i}", NOSE if ahead else DARK,
                dimensions=(radius, s * 0.028, s * 0.022), wxyz=about_z(angle),
                position=(x / 2, y / 2, z - s * 0.03),
            )  # fmt: skip
            scene.add_cylinder(
                f"{name}/motor_{i}", s * 0.03, s * 0.06, NOSE if ahead else GREY,
                position=(x, y, z - s * 0.01),
            )  # fmt: skip
            disc = scene.add_cylinder(
                f"{name}/disc_{i}", s * PROPELLER_M, s * 0.008, share_colour(0.0),
                position=(x, y, z + s * 0.025),
            )  # fmt: skip
            self._discs.append(disc)
        for side, y in (("left", 0.2), ("right", -0.2)):
            half = math.copysign(0.125, y)
            turned = (math.cos(half), math.sin(half), 0.0, 0.0)
            box(f"leg_{side}", DARK, (0.022, 0.022, 0.26), (0.0, y, -0.165), turned)
            box(f"foot_{side}", DARK, (0.36, 0.025, 0.025), (0.0, 1.17 * y, -0.29))
        self._shares: list[Colour] = []

    def is_of(self, limits: ShownLimits) -> bool:
        """Whether its rotors are where these are."""
        return self._of == (limits.x, limits.y)

    def remove(self) -> None:
        """Take it out of the scene."""
        self._frame.remove()

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
