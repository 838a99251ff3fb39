"""The name of a template and its numbers in, text with everything escaped out; the one place that knows where templates lie."""

from __future__ import annotations

import base64
import json
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from deform.errors import Fault, InputError


@cache
def template_folder() -> Path:
    """Return the folder of the templates: inside the installed wheel, else ``reports/templates`` of the checkout.

    Raises
    ------
    InputError
        When neither is there.
    """
    room = Path(str(files("deform.report")))
    for place in (room / "templates", room.parents[1] / "reports" / "templates"):
        if (place / "index.html").is_file():
            return place
    raise InputError(Fault("deform.report", "templates", "are missing from the installation", "install deform-ili again"))


def render(name: str, **numbers: Any) -> str:
    """Return a filled template; every value is escaped, an unknown name is an error."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder()),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {"asset": _asset, "data_uri": _data_uri}
    return environment.get_template(name).render(**numbers)


def script_json(content: Any) -> Markup:
    """Return JSON that may stand inside a ``<script>`` of a page, whatever the labels hold; numbers not finite become null."""
    text = json.dumps(_plain(content), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    escaped = (
        text.replace("&", "\\u0026")
        .replace("<", "\\u003c")
        .replace(">", "\\u003e")
        .replace("\u2028", "\\u2028")
        .replace("\u2029", "\\u2029")
    )
    return Markup(escaped)  # the five characters that could end a script are escaped above


def _asset(name: str) -> Markup:
    return Markup((template_folder() / name).read_text(encoding="utf-8"))  # our own file


@cache
def _data_uri(name: str, kind: str) -> Markup:
    """Return a binary file of the templates as an address that a page can hold."""
    return Markup(f"data:{kind};base64,{base64.b64encode((template_folder() / name).read_bytes()).decode('ascii')}")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
