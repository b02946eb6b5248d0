"""The flight in space: vehicle, ground, the way it flew and should have, setpoint and wind.

Frame: Earth East-North-Up, metres. Everything hangs on one node, `/world`, which is moved against
the vehicle to follow it: so the camera stays where the user has put it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_tools.pictures.history import FlightHistory
from gcs_tools.pictures.quantities import ROTORS
from gcs_tools.pictures.view.multicopter import Colour, Multicopter
from gcs_tools.pictures.view.plan import DrawnPlan
from gcs_tools.recording.table import Rows

if TYPE_CHECKING:
    import viser

Lines = np.ndarray[tuple[Any, ...], np.dtype[np.float32]]  # (n, 2, 3): their ends, m

POINTS = 1000  # of each line that is drawn
FLOWN: Colour = (0, 114, 178)
REFERENCE: Colour = (230, 159, 0)
SETPOINT: Colour = (213, 94, 0)
AIR: Colour = (0, 110, 82)
TRUE_AIR: Colour = (98, 196, 165)
SHADE: Colour = (150, 156, 164)
HOUSE: Colour = (232, 228, 221)
TARGET_M = 0.9  # half width of the setpoint's mark
ARROW_M = 0.22  # of arrow for 1 m/s of wind
CALM = 0.2  # m/s below which no arrow is drawn
AROUND_M = 1e4  # beyond this, nothing is drawn: a flight that diverged has no picture


def drawable(points: Rows) -> Rows:
    """Those of the points (n, 3) that are finite and in the world, at most about POINTS."""
    points = points[:: max(1, len(points) // POINTS)]
    kept: Rows = points[(np.abs(points) < AROUND_M).all(axis=1)]
    return kept


def segments(points: Rows) -> Lines:
    """The line through points (n, 3), as (n - 1, 2, 3); of less than two, one without length."""
    if len(points) < 2:
        return np.zeros((1, 2, 3), np.float32)
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


class _Arrow:
    """A wind, drawn from where its parent is, and its speed."""

    def __init__(
        self, scene: viser.SceneApi, name: str, word: str, colour: Colour, wide: float
    ) -> None:
        self._word, self._text = word, ""
        anchor: Any = "bottom-center" if wide > 1.0 else "top-center"  # clear of each other
        self._arrow = scene.add_arrows(
            name, np.zeros((1, 2, 3)), colour, shaft_radius=0.028 * wide,
            head_radius=0.075 * wide, head_length=0.2 * wide, visible=False,
        )  # fmt: skip
        self._label = scene.add_label(f"{name}_label", word, anchor=anchor, visible=False)

    def show(self, v_air_E: Rows) -> None:
        """Blow with v_air_E (m/s); what is not known of it counts as none."""
        wind = np.nan_to_num(v_air_E)
        speed = float(np.linalg.norm(wind))
        blows = CALM < speed < AROUND_M
        self._arrow.visible = self._label.visible = blows
        if not blows:
            return
        tip = ARROW_M * wind
        self._arrow.points = segments(np.stack([np.zeros(3), tip]))
        self._label.position = tip
        text = f"{self._word} {speed:.1f} m/s"
        if text != self._text:
            self._label.text = self._text = text


class Scene:
    """What is drawn of a flight in three dimensions."""

    def __init__(self, scene: viser.SceneApi, flight: FlightHistory, *, whole: bool) -> None:
        """whole : the flight is over, and the reference is drawn to its end."""
        self._flight, self._whole = flight, whole
        scene.set_background_image(_sky())
        # dimmer than usual, so that colours are those of the key
        scene.configure_environment_map("city", environment_intensity=0.35)
        self._world = scene.add_frame("/world", show_axes=False)
        self._ground = scene.add_grid(
            "/world/ground", infinite_grid=True, cell_size=1.0, section_size=10.0,
            cell_color=(214, 218, 224), section_color=(170, 178, 188), cell_thickness=0.8,
            section_thickness=1.2, fade_distance=160.0, plane_color=(240, 242, 245),
            plane_opacity=0.6, shadow_opacity=0.25, visible=False,
        )  # fmt: skip
        self._scene = scene
        self._vehicle = Multicopter(scene, "/world/vehicle", flight.limits)
        nowhere = segments(np.zeros((0, 3)))
        self._reference = scene.add_line_segments(
            "/world/reference", nowhere, REFERENCE, thickness=1.6, thickness_units="screen"
        )
        self._flown = scene.add_line_segments(
            "/world/flown", nowhere, FLOWN, thickness=4.5, thickness_units="screen"
        )
        self._plan = DrawnPlan(scene, "/world/plan")
        # what goes with the vehicle hangs on one node: lines are redrawn later than nodes move
        self._here = scene.add_frame("/world/here", show_axes=False)
        self._plumb = scene.add_line_segments(
            "/world/here/plumb", nowhere, SHADE, thickness=1.2, thickness_units="screen"
        )
        self._foot = scene.add_cylinder(
            "/world/here/foot", 0.5, 0.01, SHADE, opacity=0.5, cast_shadow=False, visible=False
        )
        self._model = scene.add_icosphere("/world/model", 0.09, REFERENCE, visible=False)
        self._setpoint = scene.add_frame("/world/setpoint", show_axes=False, visible=False)
        scene.add_line_segments(
            "/world/setpoint/mark", _target(), SETPOINT, thickness=2.5, thickness_units="screen"
        )
        scene.add_label(
            "/world/setpoint/name", "setpoint", anchor="top-center", position=(0.0, 0.0, -TARGET_M)
        )
        scene.add_frame("/world/here/air", show_axes=False, position=(0.0, 0.0, 0.5))
        self._true_air = _Arrow(scene, "/world/here/air/true", "wind", TRUE_AIR, 1.6)
        self._air = _Arrow(scene, "/world/here/air/estimate", "estimate", AIR, 1.0)
        self._draw_buildings()
        if whole:
            self._reference.points = segments(drawable(_reference(flight)))

    def show(self, now: float, follow: bool) -> None:
        """Show the flight at `now` (s); with `follow` the vehicle stays in the middle."""
        flight = self._flight
        r_E = flight.vector("state.r_E", now)
        if not (np.abs(r_E) < AROUND_M).all():
            return
        limits = flight.limits
        if not self._vehicle.is_of(limits):  # told only now, or of another flight
            self._vehicle.remove()
            self._vehicle = Multicopter(self._scene, "/world/vehicle", limits)
        speeds = flight.vector("state.Omega", now, ROTORS[: len(limits.x)])
        shares = (speeds / np.array(limits.Omega_max)) ** 2
        self._vehicle.show(r_E, flight.vector("state.q_EB", now, "wxyz"), shares)
        if follow:
            self._world.position = -r_E
        self._ways(now, r_E)
        self._plan.show(flight.plans.at(now), flight.ground_z)
        self._goal(now)
        self._here.position = r_E
        self._true_air.show(flight.vector("v_air_E", now))
        self._air.show(flight.vector("wind.v_air_E", now))

    def _draw_buildings(self) -> None:
        """Draw the houses about the flight, from their feet up."""
        for number, (west, east, south, north, foot, roof) in enumerate(self._flight.buildings):
            self._scene.add_box(
                f"/world/buildings/{number}", HOUSE, dimensions=(east - west, north - south, roof - foot),
                position=(0.5 * (west + east), 0.5 * (south + north), 0.5 * (roof + foot)), opacity=0.85,
            )  # fmt: skip

    def _ways(self, now: float, r_E: Rows) -> None:
        """The way flown up to `now`, a line down to the ground, and of a live flight its reference."""
        flight = self._flight
        flown = drawable(flight.way("state.r_E", now))
        self._flown.points = segments(np.vstack([flown, r_E]))
        if not self._whole:
            self._reference.points = segments(drawable(_reference(flight)))
        if flight.ground_z is not None:
            below = np.array([0.0, 0.0, flight.ground_z - r_E[2]])
            self._ground.visible = True
            self._ground.position = (0.0, 0.0, flight.ground_z)
            self._plumb.points = segments(np.stack([np.zeros(3), below]))
            self._foot.position = below + np.array([0.0, 0.0, 0.01])
            self._foot.visible = True

    def _goal(self, now: float) -> None:
        """Where the vehicle is told to be, and where the reference model is on its way there."""
        flight = self._flight
        flies = flight.value("engaged", now) > 0.5
        r_m = flight.vector("outputs.reference.r_m", now)
        self._model.visible = flies and bool(np.isfinite(r_m).all())  # a law may have none
        self._setpoint.visible = flies and flight.value("setpoint.level", now) < 0.5
        if flies:
            self._model.position = np.nan_to_num(r_m)
            self._setpoint.position = np.nan_to_num(flight.vector("setpoint.r_c", now))


def _reference(flight: FlightHistory) -> Rows:
    """Where the reference model was, while the law flew: (n, 3)."""
    flies = flight.along(flight.series("outputs.reference.r_m.x")[0], "engaged") > 0.5
    flown: Rows = flight.way("outputs.reference.r_m")[flies]
    return flown


def _target() -> Lines:
    """Three bars that leave the middle free, and a ring around it: (n, 2, 3), m."""
    bars = np.stack([0.55 * np.eye(3), np.eye(3)], axis=1)
    turns = np.linspace(0.0, 2.0 * np.pi, 49)
    ring = np.stack([np.cos(turns), np.sin(turns), np.zeros_like(turns)], axis=1)
    return TARGET_M * np.vstack([bars, -bars, segments(ring)]).astype(np.float32)


def _sky() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Pale blue above, white below."""
    down = np.linspace(0.0, 1.0, 256)[:, None, None]
    top, bottom = np.array([206.0, 222.0, 238.0]), np.array([250.0, 251.0, 252.0])
    sky = top + np.minimum(1.0, 1.6 * down) * (bottom - top)
    return np.repeat(sky, 4, axis=1).astype(np.uint8)
