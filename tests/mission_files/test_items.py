"""Items of a mission: what may follow what, and what can never come to its end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gcs_tools.missions.mission import MissionError, load
from gcs_tools.missions.timeline import foreseen, legs

HEAD = """title = "Items."
[flight]
duration_s = 60.0
ground_z_m = 0.0
"""
UP = '{ kind = "take_off", height_m = 3.0 }'
THERE = '{ kind = "go_to", position_m = [5.0, 0.0, 3.0] }'
LAND = '{ kind = "land" }'
HOLD = '{ kind = "hold", for_s = 5.0 }'
TRACK = "t_s,x_m,y_m,z_m\n" + "".join(f"{t},{t * t / 20},0,3\n" for t in range(9))


def written(folder: Path, *items: str, more: str = "", grounded: bool = True) -> Path:
    path = folder / "x.toml"
    start = "start = { on_ground = true }\n" if grounded else ""
    listed = "".join(f"    {item},\n" for item in items)
    path.write_text(f"{HEAD}{start}items = [\n{listed}]\n{more}")
    return path


def wrong(folder: Path, *items: str, **keys: Any) -> list[str]:
    with pytest.raises(MissionError) as raised:
        load(written(folder, *items, **keys))
    return str(raised.value).splitlines()


@pytest.mark.parametrize(
    "items",
    [(UP, THERE, LAND), (UP, HOLD, '{ kind = "return" }', UP, THERE), (UP, LAND, UP, LAND)],
)
def test_items_that_a_vehicle_can_do_in_turn_are_taken(tmp_path: Path, items) -> None:
    assert len(load(written(tmp_path, *items)).flight.items) == len(items)


def test_in_the_air_none_has_to_take_off(tmp_path: Path) -> None:
    more = "[flight.start]\nposition_m = [0.0, 0.0, 5.0]\n"
    assert load(written(tmp_path, THERE, HOLD, more=more, grounded=False)).flight.items


@pytest.mark.parametrize(
    ("items", "line", "said"),
    [
        ((THERE,), 7, "items[0].kind: expected take_off, for a vehicle on the ground"),
        ((UP, UP), 8, "items[1].kind: expected an item for a vehicle in the air"),
        ((UP.replace("3.0", "200.0"),), 7, "items[0].height_m: expected at most arena_m, 100 m, got 200.0"),
        ((UP, LAND, THERE), 9, "items[2].kind: expected take_off"),
        ((UP, '{ kind = "fly" }'), 8, "items[1].kind: expected take_off, go_to, follow, hold, land, return or plan, got fly"),
        ((UP, "3"), 8, "items[1]: expected a table with a kind, got 3"),
        ((UP, HOLD[:-1] + ", fors = 3.0 }"), 8, "items[1].fors: no such key (did you mean for_s?)"),
        ((UP, '{ kind = "hold" }'), 8, "items[1].for_s: is missing"),
        ((UP, THERE.replace("3.0]", "-1.0]")), 8, "expected a height above ground_z_m, 0 m, got -1.0"),
        ((UP, THERE.replace("5.0,", "500.0,")), 8, "expected a place within arena_m, 100 m, of the start"),
        ((UP, HOLD.replace("5.0", "60.0")), 3, "duration_s: expected more than 60 s"),
        ((UP, '{ kind = "follow", corners = "spline", points_m = [[0, 0, 20], [5, 0, 1], [25, 0, 1], [30, 0, 20]] }'), 8, "items[1].points_m: the path leads to"),
        ((UP, '{ kind = "follow" }'), 8, "items[1]: expected either points_m or file"),
        ((UP, '{ kind = "follow", points_m = [[0, 0, 3]] }'), 8, "expected 2 elements or more"),
        ((UP, '{ kind = "follow", points_m = [[0, 0, 3], [0, 0, 3]] }'), 8, "points_m[1]: expected another"),
        ((UP, '{ kind = "follow", file = "no.csv" }'), 8, "no.csv: No such file"),
        ((UP, HOLD[:-1] + ", expect = { tok_s = 3.0 } }"), 8, "did you mean took_s?"),
        ((UP, HOLD[:-1] + ", expect = { touchdown_m = 3.0 } }"), 8, "no such key"),
        ((UP, LAND[:-1] + ", expect = { margin_min_n = { limit = 0.0 } } }"), 8, "expected at_least"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_named_with_its_line(tmp_path: Path, items, line, said) -> None:
    (text,) = wrong(tmp_path, *items)
    assert said in text
    assert f"x.toml:{line}: " in text


@pytest.mark.parametrize(
    ("items", "more", "ended"),
    [
        ((UP, THERE), "", "landed"),
        ((UP, LAND), "", "done"),
        ((UP, LAND), "", "arrived"),
    ],
)
def test_an_end_that_can_never_come_is_an_error(tmp_path: Path, items, more, ended) -> None:
    (text,) = wrong(tmp_path, *items, more=f'{more}[expect]\nended = "{ended}"\n')
    assert "[expect] ended: " in text
    assert "this end can never come" in text


@pytest.mark.parametrize("ended", ["landed", "done", "refused", "arrived"])
def test_of_setpoints_none_of_these_ends_can_come(tmp_path: Path, ended: str) -> None:
    path = tmp_path / "x.toml"
    path.write_text(
        f'{HEAD}start = {{ on_ground = true }}\nsetpoints = [[0, 0, 0, 5]]\n[expect]\nended = "{ended}"\n'
    )
    with pytest.raises(MissionError, match="this end can never come"):
        load(path)


@pytest.mark.parametrize("key", ["arrive = { within_m = 1.0, for_s = 1.0 }",
                                 "yaw = { amplitude_rad = 1.0, frequency_rad_s = 1.0 }",
                                 "setpoints = [[0, 0, 0, 5]]"])  # fmt: skip
def test_keys_of_other_missions_do_not_go_with_items(tmp_path: Path, key: str) -> None:
    with pytest.raises(MissionError, match=r"\[flight\]"):
        load(written(tmp_path, UP, LAND, more=f"{key}\n"))


def follows(folder: Path, track: str, more: str = "") -> Path:
    (folder / "track.csv").write_text(track)
    return written(folder, UP, f'{{ kind = "follow", file = "track.csv"{more} }}')


def test_a_track_lies_beside_its_mission(tmp_path: Path) -> None:
    follow = load(follows(tmp_path, TRACK)).flight.items[1]
    assert follow.path.duration_s == 8.0


@pytest.mark.parametrize(
    ("track", "said"),
    [
        ("", "track.csv:1: expected a line that names the columns t_s, x_m, y_m, z_m"),
        (TRACK.replace("z_m", "height"), "z_m is missing"),
        (TRACK.replace("\n4,", "\nfour,"), "track.csv:6: expected four finite numbers"),
        (TRACK.replace("\n4,", "\nnan,"), "track.csv:6: expected four finite numbers"),
        (TRACK.replace("\n4,", "\n3,"), "expected a time after 3 s, got 3"),
        (TRACK[:46], "expected four samples or more"),
        (TRACK.replace("3.2,", "8.0,"), "more than acceleration_m_s2, 2: raise that"),
        (TRACK.replace("3.2,", "1e300,"), "track.csv:10: expected four finite numbers"),
        ("t_s,x_m,y_m,z_m\n\x00\n", "track.csv"),
        (TRACK.replace("0,3\n", "0,-3\n"), "which is below ground_z_m, 0"),
    ],
)  # fmt: skip
def test_a_track_that_cannot_be_flown_is_an_error(tmp_path: Path, track: str, said: str) -> None:
    with pytest.raises(MissionError) as raised:
        load(follows(tmp_path, track))
    assert said in str(raised.value)
    assert "x.toml:8: [flight] items[1].file" in str(raised.value)


def test_a_track_that_is_no_regular_file_is_not_read(tmp_path: Path) -> None:
    with pytest.raises(MissionError, match="expected a regular file"):
        load(written(tmp_path, UP, '{ kind = "follow", file = "/dev/zero" }'))


def test_before_a_flight_it_rests_towards_where_its_first_item_looks(tmp_path: Path) -> None:
    turned = THERE.replace(" }", ", yaw_deg = 90.0 }")
    flight = load(written(tmp_path, UP, turned)).flight
    _, sent = foreseen(flight)
    assert sent[0].tick == 0
    assert sent[0].setpoint.psi_c == pytest.approx(legs(flight)[0].psi)
    assert legs(flight)[0].psi != legs(flight)[1].psi
