"""How Sphinx makes the site of these pages: `sh tools/docs.sh` builds it into out/site, offline.

`_site/stage.py` first copies the pages to out/docs/source and writes the pages of the API there,
so that nothing is ever generated among the pages themselves.
"""

import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]

from _site.examples import forget_files  # noqa: E402
from _site.stage import BUILD  # noqa: E402
from sphinx_gallery.sorting import ExplicitOrder  # noqa: E402

project = "flametomo"
author = "the flametomo authors"
project_copyright = "the flametomo authors"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "_site.mathml",
    "_site.glossary",
    "_site.names",
]
templates_path = []
html_static_path = [str(DOCS / "_site/static")]
html_css_files = ["site.css"]

# ---- pages
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 4
default_role = "py:obj"  # `name` in a docstring is a link where the name is one
highlight_language = "none"
smartquotes_action = "qe"  # no dashes: --frame is an option
nitpicky = True
# names of other projects are out of reach without a network
nitpick_ignore_regex = [("py:.*", r"(?!tomo\.|rigs\.|phantoms\.).*")]
suppress_warnings = ["config.cache"]  # the gallery's own objects among the options

# ---- docstrings
autosummary_generate = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say types, with shapes and units
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

# ---- gallery: one place for the order; an example that is not named comes last
EXAMPLES = (
    # start
    "first_volume", "own_tiffs", "rig_from_a_table",
    # cameras
    "calibrate_from_charuco", "import_from_colmap", "is_my_rig_good_enough", "how_many_cameras",
    # methods
    "noise_and_prior", "wernet_learns_optics", "wernet_paper", "wernet_film",
    "gains_and_backgrounds",
    # trust
    "red_verdict", "uncertainty_map", "flame_front", "real_plume",
    # films
    "film_to_zarr", "film_mean_and_rms",
    # optics
    "quartz_window", "occluder_from_cad", "mirror_view", "depth_of_field",
    "two_colour_temperature",
    # extending
    "custom_solver", "custom_prior", "own_training_loop", "refine_a_camera", "neural_field",
    # comparisons
    "abel_inversion", "same_rays_as_rtk",
)  # fmt: skip

sphinx_gallery_conf = {
    "examples_dirs": str(BUILD / "examples"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "within_subsection_order": ExplicitOrder([*(f"{name}.py" for name in EXAMPLES), "*"]),
    "capture_repr": (),
    "reset_modules": ("matplotlib", forget_files),
    "reset_modules_order": "both",
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,  # its table takes scripts from the network
    "thumbnail_size": (480, 320),
}

# ---- the look
html_theme = "pydata_sphinx_theme"
html_title = "flametomo"
html_favicon = str(DOCS / "_site/static/logo.svg")
html_show_search_summary = False  # summaries are fetched, which pages from a disk may not do
html_show_sourcelink = False
html_copy_source = False
html_show_sphinx = False
html_math_renderer = "mathml"
html_theme_options = {
    "logo": {
        "text": "flametomo",
        "image_light": "_static/logo.svg",
        "image_dark": "_static/logo.svg",
        "alt_text": "flametomo, to the front page",
    },
    "navigation_with_keys": False,
    "show_prev_next": True,
    "show_toc_level": 2,
    "header_links_before_dropdown": 7,
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_context = {"default_mode": "auto"}
html_sidebars = {"index": []}
toc_object_entries = False  # headings are enough beside the text
