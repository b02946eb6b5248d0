"""The figure of a comparison can be read, of few missions as of ten."""

from __future__ import annotations

import pytest
from matplotlib.text import Text

from gcs_tools.pictures.plot.laws import Mark, figure


@pytest.mark.parametrize("missions", [1, 10])
@pytest.mark.parametrize("laws", [2, 6])
def test_legend_and_title_do_not_meet_and_stay_inside(missions, laws):
    marks = [
        Mark("my_quad", f"mission_{m}", f"a_law_{law}", 0.1, 0.09, 0.11, 1, 4)
        for m in range(missions)
        for law in range(laws)
    ]
    drawn = figure(marks)
    drawn.draw_without_rendering()
    (axes,) = drawn.axes
    legend = axes.get_legend()
    assert legend is not None
    (title,) = [
        part
        for part in axes.findobj(Text)
        if isinstance(part, Text) and "distance" in part.get_text()
    ]
    assert not title.get_window_extent().overlaps(legend.get_window_extent())
    for part in (title, legend):
        box = part.get_window_extent()
        assert box.x0 >= 0.0
        assert box.x1 <= drawn.bbox.x1
        assert box.y1 <= drawn.bbox.y1
