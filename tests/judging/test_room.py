"""Room for a result on a disk that fills up."""

import os
from pathlib import Path

from gcs_tools.judging import result


def _held(folder):
    """Bytes on disk of files that this process has open in `folder`."""
    found = 0
    for fd in os.listdir("/proc/self/fd"):
        link = f"/proc/self/fd/{fd}"
        try:
            if os.readlink(link).startswith(f"{folder}/"):
                found += 512 * os.stat(link).st_blocks
        except OSError:
            pass
    return found


def test_room_is_held_while_a_flight_is_recorded_and_given_back(tmp_path):
    with result.reserved(tmp_path):
        assert _held(tmp_path) >= result.ROOM_BYTES
        assert list(tmp_path.iterdir()) == []  # also of a process that is killed nothing is left
    assert _held(tmp_path) == 0


def test_a_folder_without_room_has_none_to_hold(tmp_path):
    with result.reserved(tmp_path / "nowhere"):
        pass


def test_a_result_fits_into_its_room(tmp_path):
    whole = Path(tmp_path / "result.json")
    result.rejected("x", "y" * 10_000, {"m-mrac": "1"}).write(whole)
    assert 10 * whole.stat().st_size < result.ROOM_BYTES
