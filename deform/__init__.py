"""Multi-epoch deformation analysis of pipelines: inspection runs in, honest change with sigma out.

Conventions
-----------
Units
    SI inside. Files and tables: metre, second, degree for angles, ``1`` for strain; percent and microstrain in reports only.
Body frame
    x right, y forward (the way the tool travels), z up.
Navigation frame
    East, north, up at the tool. Positions in files are latitude, longitude (degree) and height (m) on WGS84.
Attitude
    Azimuth clockwise from true north, pitch positive nose up, roll positive right side down (Porter 1990, 3-38): the
    matrix from body to navigation axes is Rz(-azimuth) Rx(pitch) Ry(roll).
Clock angle
    Looking downstream, 0 at the top, clockwise, degree.
Curvature
    ``curvature_vertical`` = d pitch / d chainage, positive = sag. ``curvature_horizontal`` = cos(pitch) d azimuth / d chainage,
    positive = to the right. Bending strain = curvature times outside diameter / 2; its total is carried with the clock of
    its tension side, atan2(-horizontal, -vertical).
Chainage
    Agreed distance along the pipe of the reference run, rising downstream. ``log_distance`` is one run's odometer, slip
    included.
Change
    Always formed per component, never from totals. Every derived number has a ``<name>_sigma`` partner, one standard
    deviation.

The public names below are loaded when they are first used; ``import deform`` itself is cheap.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from deform.kernel_cache import drop_outdated

_PUBLIC = {
    "run_survey": "deform.survey",
    "process": "deform.processing",
    "process_raw": "deform.processing",
    "read_survey": "deform.survey_file",
    "read_source": "deform.readers.reader",
    "read_run": "deform.run.store",
    "write_run": "deform.run.store",
    "validate_run": "deform.run.schema",
    "navigate": "deform.nav.navigate",
    "measure": "deform.caliper.measure",
    "add_bending": "deform.strain.bending",
    "add_dent_strain": "deform.strain.dent",
    "match_runs": "deform.correlate.weld_matching",
    "compare": "deform.change.compare",
    "trends": "deform.change.trend",
    "write_report": "deform.report",
    "write_dent_surfaces": "deform.mesh",
    "simulate": "deform.synthetic.simulate",
    "Options": "deform.options",
    "InputError": "deform.errors",
}

__all__ = list(_PUBLIC)

drop_outdated(Path(__file__).parent)


def __getattr__(name: str) -> Any:
    """Load a public name from its room when it is first used."""
    if name not in _PUBLIC:
        raise AttributeError(f"module 'deform' has no attribute {name!r}; public are {', '.join(_PUBLIC)}")
    value = getattr(import_module(_PUBLIC[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])
