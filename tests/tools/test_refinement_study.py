"""The study of refinement on one small rig."""

import json

import pytest


def test_a_small_rig_is_refined_and_told(run_tool, tmp_path):
    done = run_tool("refinement_study", "--quick", "-o", tmp_path, "--json")
    assert done.exit_code == 0, (done.stderr, done.exception)
    written = sorted(path.name for path in tmp_path.iterdir())
    assert written == ["refinement.json", "refinement.md"]
    result = json.loads(done.stdout)
    (row,) = result["disturbed_rigs"]
    assert row["before_pixels"] > 0.4
    assert row["after_pixels"] < 0.4 * row["before_pixels"]  # so few pixels allow no more
    (true,) = result["true_rigs"]
    assert true["before_pixels"] == pytest.approx(0, abs=1e-9)
    assert true["after_pixels"] < 0.1
    assert result["plume"] == []
    assert f"| 1 | {row['before_pixels']:.2g} |" in (tmp_path / "refinement.md").read_text()


def test_what_is_missed_is_said(run_tool):
    from _refinement.page import claims

    bad, good = [{"seed": 3, "after_pixels": 0.2}], [{"seed": 1, "after_pixels": 0.05}]
    plume = [{"held_out": "a", "f given": 30.0, "f refined": 29.0}]
    missed = claims({"disturbed_rigs": bad, "true_rigs": bad, "plume": plume})
    assert len(missed) == 3
    assert missed[0].startswith("disturbed rigs, seed 3")
    assert missed[1].startswith("true rigs, seed 3")
    assert "29.00" in missed[2]
    better = [{"held_out": "a", "f given": 29.0, "f refined": 30.0}]
    assert claims({"disturbed_rigs": good, "true_rigs": good, "plume": better}) == []
    unjudged = claims({"disturbed_rigs": good, "true_rigs": good, "plume": []})
    assert unjudged == ["plume: not judged"]


def test_a_folder_that_is_a_file_is_refused(run_tool, tmp_path):
    (tmp_path / "file").write_text("")
    done = run_tool("refinement_study", "--quick", "-o", tmp_path / "file")
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1
