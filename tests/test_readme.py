import re
from pathlib import Path

import pytest

README = (Path(__file__).parents[1] / "README.md").read_text("utf-8")


def blocks(language):
    return re.findall(rf"^[ ]*```{language}\n(.*?)^[ ]*```", README, re.DOTALL | re.MULTILINE)


def test_python_example_runs_and_reconstructs_well(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (example,) = blocks("python")
    assert len([line for line in example.splitlines() if line and "import" not in line]) <= 15
    names = {}
    exec(compile(example, "README.md", "exec"), names)
    assert names["outcome"].report()["quality"]["cosine_distance"] < 0.02
    assert names["volume"].shape == (24, 40, 24)


def test_yaml_example_is_a_valid_rig(tmp_path):
    from rigs import load_rig

    (example,) = blocks("yaml")
    indent = re.match(r" *", example).group()
    file = tmp_path / "rig.yaml"
    file.write_text(re.sub(rf"^{indent}", "", example, flags=re.MULTILINE), "utf-8")
    camera = load_rig(file)["left"]
    assert camera.position == pytest.approx([-300, 0, 500])


@pytest.mark.parametrize("target", re.findall(r"\]\(([\w/.]+)\)", README))
def test_links_lead_to_files(target):
    assert (Path(__file__).parents[1] / target).is_file()
