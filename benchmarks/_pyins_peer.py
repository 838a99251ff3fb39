"""Integration and feedback filter of python-ins over a stretch written by `benchmarks.navigation`; prints seconds of processor.

Run by an interpreter in which python-ins is installed: ``PYTHON _pyins_peer.py STRETCH.npz``.
"""

from __future__ import annotations

import sys
import time

import numpy as np
import pandas as pd
from pyins import filters, measurements


def seconds(stretch, samples: int) -> float:
    """Processor seconds for the first samples, one update by the odometer's velocity a second."""
    at = stretch["time"][: samples + 1]
    columns = ["dt", "theta_x", "theta_y", "theta_z", "dv_x", "dv_y", "dv_z"]
    table = np.column_stack([np.diff(at), stretch["turn"][:samples], stretch["push"][:samples]])
    increments = pd.DataFrame(table, index=pd.Index(at[1:], name="time"), columns=columns)
    names = ["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"]
    start = pd.Series(stretch["start"], index=names, name=at[0])
    whole = np.arange(200, samples, 200)
    speed = pd.DataFrame({"VX": stretch["speed"][whole], "VY": 0.0, "VZ": 0.0}, index=at[whole])
    begin = time.process_time()
    filters.run_feedback_filter(start, 1.0, 0.1, 0.1, 0.5, increments, measurements=[measurements.BodyVelocity(speed, 0.02)],
                                time_step=1.0)  # fmt: skip
    return time.process_time() - begin


if __name__ == "__main__":
    given = np.load(sys.argv[1])
    seconds(given, 2000)  # compiles
    for count in (int(n) for n in sys.argv[2:]):
        print(count, seconds(given, count))
