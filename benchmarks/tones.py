"""Tones of a tool's wobble and of its shift: errors of the pipe's direction and turns, and how honest the stated sigma is."""

from __future__ import annotations

import numpy as np

from deform.nav.pipe_direction import TURN_LAGS_M, direction_along
from tests.nav.test_pipe_direction import GRID, S, made, turns
from tests.nav.wheels import header

GAUGE_M = 2.0
TOOL = {"wobble_deg": 0.05, "length": 8.0, "shift": 3e-4}  # what the tool does beside its tone


def wave(amplitude: float, length: float, drift: float = 0.0) -> np.ndarray:
    """Sinusoid along the line whose length drifts by a part of itself from end to end."""
    step = S[1] - S[0]
    return amplitude * np.sin(2.0 * np.pi * np.cumsum(step / (length * (1.0 + drift * (S / S[-1] - 0.5)))) + 0.8)


def cases() -> dict[str, dict]:
    """What is added to the tool or the pipe, by name."""
    none = {"": {}}
    tones = {f"tone {m} m, {a} degree": {"tone": (wave(a, m), 0.0)} for m in (3, 6, 12, 30, 100) for a in (0.02, 0.08, 0.3)}
    tones["tone 12 m, 0.1 degree, both axes"] = {"tone": (wave(0.1, 12), wave(0.1, 12))}
    tones |= {f"tone 12 m, 0.1 degree, drift {d:.0%}": {"tone": (wave(0.1, 12, d), 0.0)} for d in (0.01, 0.05, 0.15)}
    shifts = {f"shift {m} m, {a} mm": {"swing": wave(1e-3 * a, m)} for m, a in ((5.5, 0.3), (12, 0.5))}
    pipe = wave(0.5, 12)
    pipes = {
        "pipe bends 0.5 degree every 12 m": {"periodic": pipe},
        "the same, calm tool": {"periodic": pipe, "wobble_deg": 0.003},
        "the same, tool cuts its corners by 5 %": {"periodic": pipe, "tone": (-0.05 * pipe, -0.05 * pipe)},
        "the same, tone 12.2 m, 0.1 degree": {"periodic": pipe, "tone": (wave(0.1, 12.2), 0.0)},
        "the same, tone 12 m, 0.1 degree": {"periodic": pipe, "tone": (wave(0.1, 12), 0.0)},
    }
    return none | tones | shifts | pipes


def judged(case: dict) -> list[float]:
    """Of azimuth and pitch on straight pipe: rms error, rms error of the turn over 2 m, its mean square over sigma."""
    trajectory, azimuth, pitch, away = made(**(TOOL | case))
    found = direction_along(trajectory, S, GRID, header())
    inside, lag = np.interp(GRID, S, away) > 0.99, round(GAUGE_M / (GRID[1] - GRID[0]))
    row: list[float] = []
    for said, true, sigma in zip((found.azimuth, found.pitch), (azimuth, pitch), found.turn_sigma, strict=True):
        error = (said - np.interp(GRID, S, true) + 180.0) % 360.0 - 180.0
        turn = turns(error, GAUGE_M)[inside[lag:] & inside[:-lag]]
        row += [np.sqrt(np.mean(error[inside] ** 2)), np.sqrt(np.mean(turn**2))]
        row.append(float(np.mean(turn**2)) / sigma[list(TURN_LAGS_M).index(GAUGE_M)] ** 2)
    return row


def main() -> None:
    """Print the table."""
    print("1.5 km, no ring; degree. Without a tone first: no line may be much worse than it.")
    print(f"{'added':42s} {'azimuth':>8s} {'turn 2 m':>9s} {'square':>7s} {'pitch':>8s} {'turn 2 m':>9s} {'square':>7s}")
    for name, case in cases().items():
        a, b, c, d, e, f = judged(case)
        print(f"{name:42s} {a:8.4f} {b:9.4f} {c:7.2f} {d:8.4f} {e:9.4f} {f:7.2f}", flush=True)


if __name__ == "__main__":
    main()
