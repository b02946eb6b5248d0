"""A campaign's map: success over two drawn quantities, or up to which value of a third all flights succeed.

A quantity of few values has a row or column of cells for each. Of one of many, cells have parts of its range.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gcs_tools.campaigns.analysis import Flights
from gcs_tools.campaigns.campaign_file import Campaign, Map
from gcs_tools.campaigns.store import DRAWN
from gcs_tools.pictures.plot import campaign_map
from gcs_tools.pictures.plot.campaign_map import Axis, Drawn, Panel, Roofs

Numbers = np.ndarray[Any, np.dtype[np.float64]]
Ints = np.ndarray[Any, np.dtype[np.int64]]
Flags = np.ndarray[Any, np.dtype[np.bool_]]

PLACES = ("wind.field.origin_m[0]", "wind.field.origin_m[1]")
MOST_VALUES = 60  # that have cells of their own
PARTS = 24  # of the range of a quantity of more


def save(campaign: Campaign, table: Any, folder: Path) -> list[Path]:
    """Draw the map of each law into a campaign's folder. Return its files. Raises OSError."""
    of = campaign.document.map
    if of is None:
        return []
    roofs, several = _roofs(campaign, of), len(campaign.labels) > 1
    paths = []
    for label in campaign.labels:
        path = folder / (f"map-{label}.png" if several else "map.png")
        title = campaign.document.title + (f" ({label})" if several else "")
        campaign_map.save(title, drawn(of, Flights(table, label)), roofs, path)
        paths.append(path)
    return paths


def _roofs(campaign: Campaign, of: Map) -> Roofs | None:
    """The buildings of the mission's field, below a map of places in it."""
    if of.over != PLACES:
        return None
    found = campaign.variants[0].mission.wind.roofs()
    return None if found is None else Roofs(*found)


def drawn(of: Map, flights: Flights) -> Drawn:
    """The map of a law's flights."""
    (across, x), (up, y) = (_axis(of, name, flights) for name in of.over)
    reach = None if of.up_to is None else flights.numbers(f"{DRAWN}{of.up_to}")
    every = np.ones(len(flights), dtype=bool)
    which: list[tuple[str, Flags]] = [("", every)]
    if of.panels is not None:
        told = _values(of.panels, flights)
        label = of.labels.get(of.panels, of.panels)
        named = [(f"{label} {_short(value)}", np.array([v == value for v in told])) for value in dict.fromkeys(told)]  # fmt: skip
        which = [(f"{label}: any", every), *named]
    panels = tuple(_panel(title, some, (len(up.edges) - 1, len(across.edges) - 1), x, y, flights.success, reach) for title, some in which)  # fmt: skip
    if reach is None:
        return Drawn(across, up, "share of flights that succeed", (), (0.0, 1.0), panels)
    values = np.unique(reach[np.isfinite(reach)])
    levels = tuple(values.tolist()) if len(values) <= MOST_VALUES else ()
    said = f"all flights succeed up to: {of.labels.get(of.up_to or '', of.up_to)}"
    return Drawn(across, up, said, levels, (float(values.min()), float(values.max())), panels)


def _panel(
    title: str, some: Flags, shape: tuple[int, int], x: Ints, y: Ints, success: Flags,
    reach: Numbers | None,
) -> Panel:  # fmt: skip
    cells, none = np.full(shape, np.nan), np.zeros(shape, dtype=bool)
    cell = y * shape[1] + x
    for at in np.unique(cell[some]).tolist():
        here = some & (cell == at)
        row, column = divmod(at, shape[1])
        if reach is None:
            cells[row, column] = float(success[here].mean())
            none[row, column] = not success[here].any()
            continue
        fails = reach[here & ~success]
        below = here & success & (reach < fails.min(initial=np.inf))
        none[row, column] = not below.any()
        cells[row, column] = reach[below].max(initial=-np.inf) if below.any() else np.nan
    return Panel(title, cells, none)


def _axis(of: Map, name: str, flights: Flights) -> tuple[Axis, Ints]:
    """An axis, and the cell along it of each flight."""
    label, words = of.labels.get(name, name), flights.words(f"{DRAWN}{name}")
    if words is not None:
        kinds = list(dict.fromkeys(words))
        at = np.array([kinds.index(word) for word in words])
        return Axis(label, np.arange(len(kinds) + 1.0), tuple(map(_short, kinds))), at
    values = flights.numbers(f"{DRAWN}{name}")
    unique = np.unique(values)
    if len(unique) <= MOST_VALUES:
        middle = 0.5 * (unique[1:] + unique[:-1])
        first = middle[0] - unique[0] if len(middle) else 0.5
        last = unique[-1] - middle[-1] if len(middle) else 0.5
        edges = np.concatenate(([unique[0] - first], middle, [unique[-1] + last]))
        return Axis(label, edges, ()), np.searchsorted(unique, values)
    edges = np.linspace(unique[0], unique[-1], PARTS + 1)
    return Axis(label, edges, ()), np.clip(np.searchsorted(edges, values, side="right") - 1, 0, PARTS - 1)  # fmt: skip


def _values(name: str, flights: Flights) -> Sequence[Any]:
    words = flights.words(f"{DRAWN}{name}")
    return flights.numbers(f"{DRAWN}{name}").tolist() if words is None else words


def _short(value: Any) -> str:
    """A value as a panel names it: a file without folder and ending."""
    if isinstance(value, str):
        return value.rpartition("/")[2].partition(".")[0].replace("_", " ")
    return f"{value:g}"
