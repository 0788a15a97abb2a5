"""The documents as a site: `make docs`. Nothing is fetched while it is built or read."""

from importlib.metadata import version as installed

project = "accelbench"
author = "the accelbench authors"
version = release = installed("accelbench")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
root_doc = "README"
exclude_patterns = ["**/*.template.md"]

html_theme = "furo"
html_title = f"accelbench {release}"
html_theme_options = {"navigation_with_keys": True}

myst_heading_anchors = 3  # links to headings work as on a page of the repository
nitpicky = False

# numpydoc: parameters with their shapes and units, errors, the source of an equation
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_custom_sections = [("Returns", "params_style")]
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_default_options = {"members": True}
python_use_unqualified_type_names = True
