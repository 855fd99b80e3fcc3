"""What a report says of its origin, and how many images of cameras it carries."""

import numpy as np

from tomo.pipeline.view import View
from tomo.report import pictures
from tomo.report.about import method_in_words
from tomo.report.pictures import view_pictures


def test_pictures_of_many_large_views_stay_small_and_the_worst_is_among_them(monkeypatch):
    monkeypatch.setattr(pictures, "_LIMIT", pictures._LIMIT // 4)
    rng = np.random.default_rng(0)
    images = [rng.random((300, 400), np.float32) for _ in range(15)]
    views = [View(f"{n}", one, one * (0.5 if n == 7 else 0.9)) for n, one in enumerate(images)]
    found = view_pictures(views)
    assert len(found["data"]) < 1_500_000 / 4
    assert found["left_out"] > 0
    assert found["shown"]["words"].startswith("7, explained least")


def test_dark_views_and_none_have_their_words():
    assert view_pictures([]) is None
    dark = view_pictures([View("dark", np.zeros((4, 4)), np.zeros((4, 4)))])
    assert dark["shown"]["words"] == "dark: dark"


def test_the_method_is_said_in_words():
    solver = {"method": "tv", "strength": 0.005, "iterations": 30, "chosen_by": "auto",
              "tried": [1, 2], "nonnegative": True}  # fmt: skip
    said = method_in_words({"method": "tv", "solver": solver, "basis": {"name": "linear"}})
    assert said.startswith(
        "Weighted least squares (tv), prior on total variation of strength 0.005"
    )
    assert said.endswith("Chosen from 2 settings: it predicts left-out pixels best.")
    assert method_in_words({"method": "wernet"}) == "wernet."
