"""The templates of pages, which lie beside the modules that fill them."""

import functools
from typing import Any


@functools.cache
def template(package: str, name: str) -> Any:
    """A Jinja template; what it shows is escaped, and a name that it lacks is an error.

    Args:
        package: the package that holds it, such as "focusjax.report".
        name: the file.
    """
    import jinja2

    return jinja2.Environment(
        loader=jinja2.PackageLoader(package, "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template(name)
