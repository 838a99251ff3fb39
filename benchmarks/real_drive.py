"""A recorded drive as a raw run, navigated with marks every 2 km: errors between the marks, heading at rest, coverage.

The reference is a receiver's blend of GNSS and inertial unit, itself good to metres; its heading before the car first moves is
worse than ours, so the standstill is also held against its heading of the later drive, led back by the turns of the gyros.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from deform.geometry.earth import earth_rate
from deform.nav.alignment import align
from deform.nav.navigate import aid_of, counts_of, navigate
from deform.nav.odometer import combine
from deform.nav.strapdown import epoch_bounds, preintegrate
from deform.options import NavigationOptions
from tests.nav.kingston import REST_S, Drive, at_reference, drive, errors, heading_at_rest, reference_error, wrapped

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "real" / "kingston2008"


def coarse(run: Drive) -> tuple[float, float]:
    """Azimuth of the alignment over the standstill and its sigma, before any mark."""
    counts, options = counts_of(run.raw), NavigationOptions()
    wheels = combine(run.raw, options)
    epochs = preintegrate(counts, wheels.profile, epoch_bounds(counts.time, options.filter_interval_s, np.empty(0)))
    aligned = align(counts, epochs, aid_of(epochs, wheels.profile), run.raw.header)
    return float(aligned.angles[0]), float(aligned.angle_sigma[0])


def row(run: Drive, model: str, theirs: float, headings: tuple[float, float]) -> str:
    """What one error model makes of the drive."""
    busy = time.process_time()
    found = navigate(run.raw, NavigationOptions(error_model=model))
    busy = time.process_time() - busy
    off, own = errors(found, run)
    level, up = np.hypot(off[:, 0], off[:, 1]), off[:, 2]
    alone, both = (np.mean(np.abs(off) < 1.96 * s, axis=0) for s in (own, np.hypot(own, theirs)))
    rest = run.time < REST_S
    heading, stated = (float(np.mean(at_reference(found, run, name)[rest])) for name in ("azimuth", "azimuth_sigma"))
    there, back = headings
    first, first_sigma = (float(found.diagnostics[name]) for name in ("alignment_azimuth", "alignment_azimuth_sigma"))
    return "\n   ".join((
        f"{model}: rms {np.sqrt(np.mean(level**2)):.2f} m horizontal (bar 10), {np.sqrt(np.mean(up**2)):.2f} m up, "
        f"largest {level.max():.1f} m horizontal; {busy:.0f} s of processor",
        f"inside 1.96 sigma, east, north, up: {', '.join(f'{x:.2f}' for x in alone)}; "
        f"with the reference's error {', '.join(f'{x:.2f}' for x in both)}",
        f"coarse heading it begins with ({found.diagnostics.attrs['alignment_method']}): {first:.2f} ± {first_sigma:.2f}°, "
        f"off by {wrapped(first - back):+.2f}° (bar 3°)",
        f"smoothed heading at rest off by {wrapped(heading - back):+.2f}° (stated {stated:.2f}°, bar 1°); "
        f"from the reference as it stands there {wrapped(heading - there):+.2f}°",
        f"remarks: {found.diagnostics.attrs['remarks'] or 'none'}",
    ))  # fmt: skip


def main() -> None:
    """Print what the drive tells of headings, and a row per error model."""
    if not DATA.is_dir():
        print("the recorded drive is not here (shared/data/real/kingston2008): nothing measured")
        return
    run = drive(DATA)
    theirs, passed = reference_error(run)
    stated = np.median(run.fix_sigma, axis=0)
    there, back, scatter = heading_at_rest(run)
    azimuth, sigma = coarse(run)
    limit = np.degrees(np.radians(run.raw.header.imu.gyro_bias_deg_per_h / 3600) / earth_rate(run.latitude[0])[1])
    print(
        f"{run.distance[-1] / 1000:.1f} km, {run.raw.passages.sizes['marker']} marks; the receiver states for its fixes, median: "
        f"{np.hypot(stated[0], stated[1]) / np.sqrt(2.0):.1f} m horizontal, {stated[2]:.1f} m up; "
        f"its heights on roads passed again ({passed} places) err by {theirs:.2f} m"
    )
    print(f"heading of the standstill: {there:.2f}° by the reference there, {back:.2f} ± {scatter:.2f}° by its drive, led back")
    print(f"coarse, over the rest alone: {azimuth:.2f} ± {sigma:.2f}°, off by {wrapped(azimuth - back):+.2f}° "
          f"(limit by the gyros' bias {limit:.1f}°, bar 3°)")  # fmt: skip
    for model in ("full", "odometer"):
        print(row(run, model, theirs, (there, back)))


if __name__ == "__main__":
    main()
