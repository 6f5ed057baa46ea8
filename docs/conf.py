"""How the site is built: `python -m sphinx -W --keep-going -b html docs out/site`, without the network."""

import os
import sys
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))
sys.path.insert(0, str(HERE.parent))
# Notebooks import the package of this checkout, on the CPU, as do the reference pages.
os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")
# Most programs of notebooks take longer to compile than to run, so that they are compiled in haste.
_HASTE = ["--xla_backend_optimization_level=0", "--xla_cpu_parallel_codegen_split_count=1"]
if tuple(map(int, version("jaxlib").split(".")[:2])) < (0, 11):
    # XLA ends the process at a flag that it has no longer.
    _HASTE.append("--xla_cpu_use_fusion_emitters=false")
os.environ.setdefault("XLA_FLAGS", " ".join(_HASTE))

import focusjax

project = "focusjax"
author = "focusjax contributors"
copyright = "focusjax contributors, Apache-2.0"
version = release = focusjax.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "mathml",
    "public_names",
    "config_keys",
    "commands",
    "rooms",
]
exclude_patterns = ["_ext", "_build", "jupyter_execute"]
nitpicky = True
# Annotations name types of jax, numpy and jaxtyping, whose pages are elsewhere.
nitpick_ignore_regex = [("py:.*", ".*")]

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist", "substitution"]
myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_merge_streams = True

# Single backticks are code, as in the rest of the docstrings.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True, "show-inheritance": False}
python_maximum_signature_line_length = 90
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_attr_annotations = False
add_module_names = False

html_theme = "pydata_sphinx_theme"
html_title = "focusjax"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["focusjax.css"]
html_show_sourcelink = False
html_theme_options = {
    "show_prev_next": True,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
    "navbar_align": "left",
    "show_toc_level": 2,
}

OWN_PLACES = {"index", "gallery", "glossary", "contributing", "measurements"}


def _other_pages(app, name: str, source: list[str]) -> None:
    """Pages that lie directly in docs/ and have no place elsewhere are listed among the how-to pages."""
    del app
    if name == "howto/index":
        pages = sorted(path.stem for path in HERE.glob("*.md") if path.stem not in OWN_PLACES)
        source[0] = source[0].replace("OTHER_PAGES", "\n".join(f"../{page}" for page in pages))


def setup(app) -> None:
    """Have Sphinx call what is above."""
    app.connect("source-read", _other_pages)
