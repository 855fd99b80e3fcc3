"""The study of refinement on one small rig."""

from functools import partial

import pytest
from studies import refinement
from studies.common.study import Request


def test_a_small_rig_is_refined(monkeypatch, quick_choice):
    monkeypatch.setattr(refinement, "VIEWS", 8)
    few = partial(refinement.reconstructed, fit_absorption=False, uncertainty=0)
    monkeypatch.setattr(refinement, "reconstructed", few)
    tables = refinement.run(Request("tiny"))
    (row,) = tables["disturbed_rigs"]
    assert row["before_pixels"] > 0.4
    assert row["after_pixels"] < 0.4 * row["before_pixels"]  # so few pixels allow no more
    (true,) = tables["true_rigs"]
    assert true["before_pixels"] == pytest.approx(0, abs=1e-9)
    assert true["after_pixels"] < 0.1
    assert "plume" not in tables
    (gains,) = tables["gains"]
    assert gains["worst_error"] < 0.1 * gains["spread"]
