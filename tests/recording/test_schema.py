"""The schemas say what the NamedTuples say, and docs/schemas is what they say now."""

from pathlib import Path

import pytest

from fcu.kernel.buffers import columns
from fcu.process.settings import Settings
from fcu.process.tick import Tick
from gcs_tools.recording import events, schema
from gcs_tools.recording.layout import LayoutError, layout
from gcs_tools.recording.schema import TICK_TOPICS, TOPICS
from sitl_plant.physics.types import PlantRecord

FOLDER = Path(__file__).parents[2] / "docs" / "schemas"


def test_schema_files_are_current() -> None:
    written = {str(path.relative_to(FOLDER)): path.read_text() for path in FOLDER.rglob("*.proto")}
    assert written == schema.texts(), "run `make schemas`"


def test_every_column_is_recorded_once() -> None:
    assert TOPICS[schema.TRUTH].columns == columns(PlantRecord)
    assert TOPICS[schema.PARAMS].columns == ["t", *columns(Settings)]
    of_tick = [name for topic in TICK_TOPICS for name in topic.columns if name != "t"]
    assert sorted([*of_tick, "t"]) == sorted(columns(Tick))


def test_every_message_starts_with_the_time() -> None:
    assert all(topic.columns[0] == "t" for topic in TOPICS.values())


def test_units_and_frames_stand_beside_the_fields() -> None:
    text = schema.texts()
    assert (
        "Estimates estimates = 5;\n" in text["m_mrac/fcu_law.proto"]
        and "    double m_hat = 2;  // mass, kg" in text["m_mrac/fcu_law.proto"]
    )
    assert "double engaged = 2;  // 0 idle, 1 take-over" in text["m_mrac/fcu_law.proto"]
    assert "    Vec3 r_E = 1;  // position, m, Earth\n" in text["m_mrac/plant_truth.proto"]


def test_a_message_with_text_has_no_fixed_layout() -> None:
    with pytest.raises(LayoutError, match=r"foxglove.Log.timestamp|seconds"):
        layout(events.schema(), events.MESSAGE)
