# SPDX-License-Identifier: BSD-2-Clause
"""Whether the texts of a figure can be read."""

import itertools

import pytest

plots = pytest.importorskip("sst_pin.plots", reason="extra `plot` is not installed")


def drawn_texts(figure, monkeypatch):
    """Every text that reaches the paper, with its box in pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    result, draw = [], Text.draw

    def record(self, renderer):
        draw(self, renderer)
        if self.get_visible() and self.get_text().strip():
            result.append((self.get_text(), self.get_window_extent(renderer)))

    with plots.style(), monkeypatch.context() as patch:
        patch.setattr(Text, "draw", record)
        FigureCanvasAgg(figure).draw()
    return result


def require_legible(figure, monkeypatch):
    """No two texts overlap, none is cut off."""
    texts = drawn_texts(figure, monkeypatch)
    assert len(texts) > 5
    for (a, box), (b, other) in itertools.combinations(texts, 2):
        across = min(box.x1, other.x1) - max(box.x0, other.x0)
        upwards = min(box.y1, other.y1) - max(box.y0, other.y0)
        # Boxes of mathematics are a pixel wider than their ink.
        assert min(across, upwards) < 1.5, (a, b)
    width, height = figure.bbox.size
    for text, box in texts:
        assert box.x0 > -1, text
        assert box.x1 < width + 1, text
        assert box.y0 > -1, text
        assert box.y1 < height + 1, text
