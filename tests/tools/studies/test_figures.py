"""Tables of pages from the figures, and the fingerprint that tells which of them are old."""

import pytest
from studies import figures
from studies.common import fingerprint

RUN = {
    "study": "benchmark",
    "commit": "1234567",
    "default": {"hash": "old", "modules": ["tomo/metrics.py"]},
    "machine": {"cpu": "Z80", "cores": 1},
    "size": "full",
    "seed": 0,
    "version": 3,
    "parts": {
        "accuracy": {
            "cpu_seconds": 120.0,
            "tables": {
                "rows": [
                    {"flame": "jet", "views": 33, "nrmse": 0.0131},
                    {"flame": "jet", "views": 11, "nrmse": 0.02},
                ]
            },
        }
    },
}
PLACE = (
    "before\n<!-- figures: benchmark accuracy rows; {} -->\nold\n<!-- end of figures -->\nafter"
)


def test_a_table_has_the_columns_and_rows_that_its_page_asks_for():
    text = PLACE.format("flame nrmse; flame=jet,turbulent views=33")
    found = figures.with_tables(text, figures.with_run({}, RUN), "page.md")
    assert "| jet | 0.0131 |\n\nCommit 1234567; Z80, 1 cores; the part took 2.0 minutes" in found
    assert "0.0200" not in found
    assert "old" not in found
    assert found.startswith("before\n")
    assert found.endswith("\nafter")
    assert figures.with_tables(found, figures.with_run({}, RUN), "page.md") == found


def test_columns_are_named_multiplied_and_spread_over_what_rows_differ_by():
    text = PLACE.format("flame, nrmse by views * 100 = NRMSE (%); flame=jet")
    found = figures.with_tables(text, figures.with_run({}, {**RUN, "size": "quick"}), "page.md")
    assert "| flame | 33, NRMSE (%) | 11, NRMSE (%) |\n" in found
    assert "| jet | 1.31 | 2.00 |\n\nCommit 1234567, size quick;" in found


@pytest.mark.parametrize(
    ("asked", "words"),
    [("flame speed", "no column speed"), ("flame; views=12", "no rows of")],
)
def test_what_is_not_there_is_refused(asked, words):
    with pytest.raises(ValueError, match=rf"page\.md: .*{words}"):
        figures.with_tables(PLACE.format(asked), figures.with_run({}, RUN), "page.md")


def test_a_part_that_is_not_measured_says_how_it_is():
    found = figures.with_tables(PLACE.format("flame"), {}, "page.md")
    assert "-->\nNot measured yet: python tools/benchmark.py --part accuracy -o out" in found


def test_a_later_run_takes_the_place_of_its_parts_alone():
    other = {**RUN, "commit": "7654321", "parts": {"threads": {"tables": {}}}}
    both = figures.with_run(figures.with_run({}, RUN), other)
    commits = {name: part["commit"] for name, part in both["benchmark"].items()}
    assert both["defaults"] == {"old": ["tomo/metrics.py"]}
    assert commits == {"accuracy": "1234567", "threads": "7654321"}


def test_figures_of_another_default_are_stale_with_the_command_to_repeat():
    modules = RUN["default"]["modules"]
    now = {**RUN, "default": {"hash": fingerprint.hash_of(modules), "modules": modules}}
    assert not figures.stale(figures.with_run({}, now))
    (line,) = figures.stale(figures.with_run({}, RUN))
    assert "python tools/benchmark.py --part accuracy" in line


def test_a_hash_is_of_what_is_computed_not_of_words(tmp_path):
    def hashed(text):
        (tmp_path / "module.py").write_text(text)
        return fingerprint.hash_of(["module.py"], tmp_path)

    first = hashed('"""A module."""\nWIDTH = 2\n"""Voxels."""\n')
    assert first == hashed("# Another word.\nWIDTH = 2\n")
    assert first != hashed("WIDTH = 3\n")
    assert fingerprint.hash_of(["gone.py"], tmp_path) == ""


def test_the_default_enters_inference_and_kernels_and_no_drawing():
    modules = set(fingerprint.origin()["default"]["modules"])
    assert {"tomo/inference/infer.py", "tomo/operators/spmv.py"} <= modules
    assert not [path for path in modules if path.startswith(("tomo/draw", "tomo/cli"))]
