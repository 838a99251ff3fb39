"""Porter's study (§3.7, Fig. 3-4 to 3-6): attitude error against data rate, pulse and update formula, over the simulator.

Run with ``python benchmarks/study_data_rate.py [FIGURE.png]``; the default figure goes to the folder for temporary files.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from deform.options import RouteOptions, SimulateOptions, ToolOptions
from deform.synthetic import study
from deform.synthetic.imu import ARCSECOND
from deform.synthetic.simulate import ride

PULSE = study.PORTER_PULSE_RAD / ARCSECOND


def dynamics() -> dict[str, np.ndarray]:
    """Increments of a straight piece, of one with bends, and of Porter's own kind of test rotation."""
    tool = ToolOptions(static_start_s=10.0, stops=0, speed_m_per_s=1.5)
    calm = RouteOptions(length_m=400.0, crossings=0, bend_fields=0, induction_bends_deg=())
    bent = RouteOptions(length_m=400.0, crossings=0, induction_bends_deg=(45.0, -90.0))
    seconds = 120.0
    return {
        "elastic pipe": study.ridden_rates(ride(SimulateOptions(route=calm, tool=tool)).motion, 20.0, seconds),
        "5D and field bends": study.ridden_rates(ride(SimulateOptions(route=bent, tool=tool)).motion, 20.0, seconds),
        "sinusoids of 2 °/s": study.shaken_rates(seconds),
    }


def main(figure: Path | None = None) -> None:
    """Print the three tables and write the figure."""
    cases = dynamics()
    tables = {name: (study.data_rate(x), study.quantization(x), study.commutativity(x)) for name, x in cases.items()}
    for name, (rate, pulse, order) in tables.items():
        print(f"\n{name}: largest error (arc second; a pulse is {PULSE:.1f})")
        for r, p in zip(rate.itertuples(), pulse.itertuples(), strict=True):
            errors = f"no pulse {r.max_arcsec:10.4f}   with pulses {p.max_arcsec:8.1f}   rms {p.rms_pulses:5.2f} pulses"
            print(f"  {r.rate_hz:5.0f} Hz   {errors}")
        print("  at 16 Hz by formula: " + "   ".join(f"{o.method} {o.max_arcsec:.3f}" for o in order.itertuples()))
    path = figure or Path(tempfile.gettempdir()) / "deform_study_data_rate.png"
    draw(tables, path)
    print(f"figure: {path}")


def draw(tables: dict, path: Path) -> None:
    """Three panels as Porter's three figures."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(1, 3, figsize=(15, 4.5), layout="constrained")
    for name, (rate, pulse, _) in tables.items():
        axes[0].loglog(rate.rate_hz, rate.max_arcsec, "o-", label=name)
        axes[1].semilogx(pulse.rate_hz, pulse.max_arcsec, "o-", label=name)
    width = 0.8 / len(tables)
    for k, (name, (_, _, order)) in enumerate(tables.items()):
        axes[2].bar(np.arange(len(order)) + k * width, order.max_arcsec, width, label=name)
    axes[2].set_xticks(np.arange(len(order)) + 0.4 - 0.5 * width, order.method)
    axes[2].set_yscale("log")
    titles = "data rate (Fig. 3-4)", f"pulses of {PULSE:.1f}″ (Fig. 3-5)", "update formula at 16 Hz (Fig. 3-6)"
    for axis, title in zip(axes, titles, strict=True):
        axis.set(title=title, ylabel="largest attitude error (arc second)")
        axis.axhline(PULSE, color="0.6", linestyle="--", linewidth=1)
        axis.grid(alpha=0.3)
    for axis in axes[:2]:
        axis.set_xlabel("data rate (Hz)")
        axis.set_xticks(study.RATES_HZ, [f"{r:.0f}" for r in study.RATES_HZ])
    axes[0].legend()
    fig.savefig(path, dpi=130)
    plt.close(fig)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
