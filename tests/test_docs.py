"""The pages: links lead somewhere, examples have their form, and what they name is there."""

import ast
import json
import re
import sys
import textwrap
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
import typer

from rigs import load_rig
from rigs.recordings import write_image
from tomo import load_scan
from tomo.pipeline.methods import method_names
from tomo.solvers import METHODS

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "tools"))

from studies import figures  # noqa: E402

PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
EXAMPLES = sorted((ROOT / "docs/examples").glob("*.py"))
MOST_JSON = 200_000  # bytes


def name_of(page):
    return str(page.relative_to(ROOT))


def text_of(page):
    return (ROOT / page).read_text("utf-8")


def prose(page):
    """Return a page without its code."""
    text = re.sub(r"^[ ]*```.*?^[ ]*```", "", text_of(page), flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"`[^`]*`", "", text)


def blocks(page, language):
    found = re.findall(
        rf"^[ ]*```{language}\n(.*?)^[ ]*```", text_of(page), re.DOTALL | re.MULTILINE
    )
    return [textwrap.dedent(block) for block in found]


def anchors(page):
    """Return the anchors of a page's headings, as GitHub and most renderers make them."""
    headings = re.findall(r"^#+ (.*)$", text_of(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in headings}


def commands(page):
    """Return the command lines of a page that begin with flametomo, continued lines joined."""
    text = re.sub(r"\\\n\s*", " ", text_of(page))
    lines = re.findall(r"^\s*(?:\$ )?flametomo ([^\n#]*)", text, re.MULTILINE)
    return lines + re.findall(r"`flametomo ([^`\n]*)`", text)


def options_of_verbs():
    """Return the options of every verb of the command."""
    from tomo.cli.app import VERBS, app

    group = typer.main.get_command(app)
    commands = {verb: group.get_command(None, verb) for verb in VERBS}
    return {
        verb: {option for each in command.params for option in [*each.opts, *each.secondary_opts]}
        for verb, command in commands.items()
    }


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_to_files_and_headings(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if re.match(r"\w+:", target):
            continue
        file, _, anchor = target.partition("#")
        other = (page.parent / file).resolve() if file else page
        assert other.is_file(), f"{name_of(page)}: {target}"
        assert not anchor or anchor in anchors(other), f"{name_of(page)}: {target}"


def test_every_page_is_reached_from_the_index():
    linked = set(re.findall(r"\]\(([\w/]+\.md)\)", text_of("docs/index.md")))
    pages = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}
    assert pages - linked == {"index.md"}


def test_every_picture_of_the_pages_is_shown():
    shown = {
        (page.parent / target).resolve()
        for page in PAGES
        for target in re.findall(r"!\[[^]]*\]\(([^)]+)\)", page.read_text("utf-8"))
    }
    assert {
        path for kind in ("png", "gif") for path in (ROOT / "docs").rglob(f"*.{kind}")
    } == shown


def test_the_readme_is_short():
    assert len(text_of("README.md").splitlines()) <= 120


def test_no_large_results_lie_among_the_pages():
    large = [p for p in (ROOT / "docs").rglob("*.json") if p.stat().st_size > MOST_JSON]
    assert not large


@pytest.mark.parametrize("page", figures.pages(), ids=name_of)
def test_tables_are_those_of_the_figures(page):
    known = json.loads(figures.FIGURES.read_text("utf-8"))
    text = page.read_text("utf-8")
    assert figures.with_tables(text, known, page.name) == text


def test_whoever_changed_the_default_is_told_which_figures_to_measure_again():
    for line in figures.stale(json.loads(figures.FIGURES.read_text("utf-8"))):
        warnings.warn(line, stacklevel=1)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_no_sentence_begins_with_of_or_what(page):
    text = re.sub(r"^(#|\|| {4}).*$", "", prose(page), flags=re.MULTILINE)
    assert not re.findall(r"(?:^\n?|[.!:] |\n\n|^[-*] )(Of|What) [^?]*?[.;]", text, re.MULTILINE)


def test_the_python_example_of_the_readme_runs_and_reconstructs_well(
    tmp_path, monkeypatch, quick_choice
):
    monkeypatch.chdir(tmp_path)
    (example,) = blocks("README.md", "python")
    assert len([line for line in example.splitlines() if line and "import" not in line]) <= 15
    names = {}
    exec(compile(example, "README.md", "exec"), names)
    assert names["result"].report()["quality"]["cosine_distance"] < 0.02
    assert names["result"].volume.shape == (24, 40, 24)
    described = set(re.findall(r"`(\w+)`", text_of("docs/reference/report_json.md")))
    assert set(names["result"].report()) <= described


def test_the_yaml_examples_of_the_guide_are_a_rig_and_a_scan_of_it(tmp_path):
    rig, _ = blocks("docs/guide/your_cameras.md", "yaml")
    (scan,) = blocks("docs/guide/your_images.md", "yaml")
    (tmp_path / "rig.yaml").write_text(rig, "utf-8")
    (tmp_path / "scan.yaml").write_text(scan, "utf-8")
    camera = load_rig(tmp_path / "rig.yaml")["left"]
    assert camera.position == pytest.approx([-300, 0, 500])

    (tmp_path / "raw").mkdir()
    width, height = camera.image_size
    raw = np.full((height, width), 2000, np.uint16)
    mask = np.full_like(raw, 255, dtype=np.uint8)
    mask[0, 0] = 0
    for name in ("left", "right"):
        write_image(tmp_path / f"raw/{name}_0001.tif", raw)
        for level in (90, 110):
            write_image(tmp_path / f"dark/{name}/{level}.tif", np.full_like(raw, level))
    write_image(tmp_path / "left_mask.png", mask)
    images, masks = load_scan(tmp_path).read("0001")
    assert images[0][1, 1] == pytest.approx(1.02 * 1900 / 4095)
    assert images[1][1, 1] == pytest.approx(1900 / 4095)
    assert not masks[0][0, 0]
    assert masks[1].all()


def test_the_yaml_examples_of_the_reference_are_valid(tmp_path):
    rig, scene = blocks("docs/reference/rig_yaml.md", "yaml")
    (tmp_path / "cam00.yaml").write_text(rig, "utf-8")
    assert load_rig(tmp_path / "cam00.yaml").names == ("cam00",)
    nozzle = trimesh.creation.box((0.02, 0.01, 0.02))
    nozzle.apply_translation([0, -0.06, 0])
    nozzle.export(tmp_path / "nozzle.stl")
    (tmp_path / "scene.yaml").write_text(rig + scene, "utf-8")
    solids = load_rig(tmp_path / "scene.yaml").scene.solids
    assert [solid.name for solid in solids] == ["north pane", "nozzle", "periscope"]
    two, _ = blocks("docs/guide/your_cameras.md", "yaml")
    (tmp_path / "rig.yaml").write_text(two, "utf-8")
    scan, light = blocks("docs/reference/scan_yaml.md", "yaml")
    (tmp_path / "scan.yaml").write_text(scan + light, "utf-8")
    assert load_scan(tmp_path).frame_names == ("frame_000",)
    assert load_scan(tmp_path).value_unit() == "W/m^3/sr"


@pytest.mark.parametrize("example", EXAMPLES, ids=name_of)
def test_examples_have_the_form_that_shows_the_picture_first(example):
    """Only blank lines and the docstring do not count; `sh tools/docs.sh` runs the examples."""
    tree = ast.parse(text := text_of(example))
    title, rule, *rest = ast.get_docstring(tree).splitlines()
    assert set(rule) == {"="}
    assert len(rule) == len(title)
    assert any(rest)
    code = text.splitlines()[tree.body[0].end_lineno :]
    assert len([line for line in code if line.strip()]) <= 40
    assert not [line for line in code if re.match(r"# ?%%|#{20}", line)]  # a second block
    assert "plt.show()" in text


@pytest.mark.parametrize("example", EXAMPLES, ids=name_of)
def test_examples_are_linked_from_a_page(example):
    links = {
        (page.parent / target).resolve()
        for page in PAGES
        for target in re.findall(r"\]\(([^)\s#]+\.py)\)", prose(page))
    }
    assert example in links


def test_the_tables_of_the_site_name_what_is_there():
    tree = ast.parse(text_of("docs/conf.py"))
    named = {node.targets[0].id: node.value for node in tree.body if isinstance(node, ast.Assign)
             and isinstance(node.targets[0], ast.Name)}  # fmt: skip
    order = ast.literal_eval(named["EXAMPLES"])
    assert sorted(order) == sorted(example.stem for example in EXAMPLES)
    (static,) = (ROOT / "docs/_site").glob("static")
    assert all((static / name).is_file() for name in ast.literal_eval(named["html_css_files"]))
    for name in ast.literal_eval(named["extensions"]):
        if name.startswith("_site."):
            assert (ROOT / "docs" / f"{name.replace('.', '/')}.py").is_file()
    headings = re.findall(r"^## (.*)$", text_of("docs/reference/glossary.md"), re.MULTILINE)
    terms = re.split(r", | and |[()\n]+", "\n".join(headings).lower())
    source = text_of("docs/_site/glossary.py")
    (everyday,) = re.findall(r"EVERYDAY = frozenset\(\{(.*?)\}\)", source, re.DOTALL)
    assert set(re.findall(r'"(.*?)"', everyday)) <= set(terms)


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=name_of)
def test_commands_have_the_options_that_pages_give_them(page):
    known = options_of_verbs()
    for line in commands(page):
        verb, *words = line.split()
        if verb in ("VERB", "--help"):
            continue
        assert verb in known, f"flametomo {line}"
        given = {word.split("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)}
        assert given <= known[verb] | {"--help"}, f"flametomo {line}"


@pytest.mark.parametrize("folder", ["guide", "theory", "reference", "results"])
def test_options_named_in_the_pages_are_some_verbs(folder):
    studies = {
        "--part",
        "--size",
        "--half",
        "--row",
        "--quick",
        "--resume",
        "--archive",
        "--score",
    }  # of programs in tools/
    known = {"--help"}.union(studies, *options_of_verbs().values())
    for page in (ROOT / "docs" / folder).glob("*.md"):
        for option in re.findall(r"`(--[a-z][\w-]*)", page.read_text("utf-8")):
            assert option in known, f"{name_of(page)}: {option}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_paths_and_modules_named_in_code_marks_exist(page):
    if page.name in (
        "CHANGELOG.md",
        "adding_a_prior.md",
        "adding_a_solver.md",
        "adding_a_rig_format.md",
    ):
        pytest.skip("names what is not there: what left, or what a reader is to write")
    code = re.findall(r"`([^`\n]+)`", page.read_text("utf-8"))
    for path in code:
        if re.fullmatch(r"(tomo|rigs|phantoms|tools|tests|docs)/[\w/.]*", path):
            assert (ROOT / path).exists(), f"{name_of(page)}: {path}"


def rows(page, heading):
    """Return the cells of the first table below a heading."""
    below = text_of(page).split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    lines = [line for line in below.splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_the_walk_names_one_or_two_files_for_each_question():
    walk = rows("docs/develop/architecture.md", "The walk")
    assert len(walk) >= 10
    for question, path, *_ in walk:
        files = re.findall(r"`([\w/.]+)`", path)
        assert 1 <= len(files) <= 2, question
        assert all((ROOT / file).exists() for file in files), question


def test_the_floors_are_those_that_are_tested():
    table = rows("docs/develop/architecture.md", "Floors of imports")
    named = re.findall(r"`(\w+)`", " ".join(packages for _, packages in table))
    order = re.search(
        r"^ORDER = \((.*?)^\)", text_of("tests/test_package.py"), re.DOTALL | re.MULTILINE
    )
    tested = re.findall(r'"tomo\.(\w+)"', order[1])
    assert named == [name for name in tested if list((ROOT / "tomo").glob(f"{name}*"))]


@pytest.mark.parametrize("page", ["adding_a_prior.md", "adding_a_solver.md"])
def test_the_examples_of_a_prior_and_of_a_solver_run(page):
    *parts, use = blocks(f"docs/develop/{page}", "python")
    residuals = []
    names = {"print": residuals.append}
    for part in parts:
        exec(compile(part, page, "exec"), names)
    exec(compile(use, page, "exec"), names)
    assert len(residuals) == (4 if page == "adding_a_prior.md" else 1)
    assert max(residuals) < 0.05


def test_the_guide_names_every_method_with_its_loss_and_its_prior():
    table = rows("docs/guide/choosing_a_method.md", "The methods")
    listed = {name: (loss, prior) for names, loss, prior, _ in table
            for name in re.findall(r"`([\w-]+)`", names)}  # fmt: skip
    assert set(listed) == set(method_names())
    for name, row in METHODS.items():
        loss, prior = listed[name]
        assert loss.startswith(row.loss), name
        assert prior.startswith(row.prior), name


def test_constants_of_the_tuning_page_are_where_it_says():
    text = text_of("docs/develop/tuning.md").split("\n## ")[0]
    table = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("| `")]
    assert len(table) > 15
    for constants, module, *_ in table:
        source = text_of(re.search(r"`([\w/.]+)`", module)[1])
        for constant in re.findall(r"`([A-Z_]+)`", constants):
            assert re.search(rf"^{constant}\b|, {constant}\b.* = ", source, re.MULTILINE), constant


def test_the_example_of_a_rig_format_reads_its_example_of_a_file(tmp_path):
    page = "docs/develop/adding_a_rig_format.md"
    (module,), (data, *_) = blocks(page, "python"), blocks(page, "")
    names = {}
    exec(compile(module, page, "exec"), names)
    path = tmp_path / "cameras.csv"
    path.write_text(data, "utf-8")
    assert names["looks_like"](path, data)
    rig = names["load"](path)
    assert rig["left"].position == pytest.approx([-300, 0, 500])
    path.write_text(data.replace("640", "wide"), "utf-8")
    with pytest.raises(ValueError, match=r"^camera left: "):
        names["load"](path)
