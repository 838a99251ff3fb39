"""An output folder in, every document asked for out: the entrance of this room."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path

from deform.errors import Fault, InputError, OptionError
from deform.options import ReportOptions
from deform.report.content import Content, read_content

_log = logging.getLogger(__name__)
_WRITERS = {
    "html": "deform.report.html",
    "pdf": "deform.report.pdf",
    "xlsx": "deform.report.workbook",
    "gpkg": "deform.report.gis",
}


def write_report(
    folder: Path | str,
    formats: Iterable[str] = ("html",),
    options: ReportOptions | None = None,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Path]:
    """Write the documents of a survey from its output folder, and from nothing else.

    Parameters
    ----------
    folder : output folder of a survey; every part of it may be absent.
    formats : of ``html``, ``pdf``, ``xlsx``, ``gpkg`` (the last writes a KML beside it).
    options : what the report shows.
    progress : called with the fraction done.

    Returns
    -------
    dict
        The path of each document by its format.

    Raises
    ------
    OptionError
        When a format is not known.
    InputError
        When the folder holds no run, or cannot be written to.
    MissingExtraError
        When a format needs an extra that is not installed.
    """
    folder, wanted = Path(folder), list(dict.fromkeys(formats))
    unknown = [name for name in wanted if name not in _WRITERS]
    if unknown:
        raise OptionError(Fault("report", "formats", f"{', '.join(unknown)} is not known; known are {', '.join(_WRITERS)}"))
    _check_writable(folder)
    content = read_content(folder)
    done: dict[str, Path] = {}
    for i, name in enumerate(wanted):
        writer: Callable[[Content, ReportOptions], Path] = import_module(_WRITERS[name]).write
        done[name] = writer(content, options or ReportOptions())
        _log.info("%s written to %s", name, done[name])
        if progress:
            progress((i + 1) / len(wanted))
    return done


def _check_writable(folder: Path) -> None:
    if not folder.is_dir():
        raise InputError(Fault(str(folder), "", "no such folder", "run the survey first"))
    if not os.access(folder, os.W_OK):
        raise InputError(Fault(str(folder), "", "cannot be written to", "change its permissions or copy it elsewhere"))
