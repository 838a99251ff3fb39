"""Numba kernel of the caliper's arms: ranges of a ring in, centre of the pipe in the tool's cross-section out (metre, radian)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def ring_centres(counts, scale, offset, fill, angle, out):
    """Fill out (scan, 2) with right and up of the circle's centre in the tool; NaN with fewer than half of the arms.

    First harmonic of the ranges by least squares, twice: in the second round arms further than three robust sigmas stay out.
    """
    n_arms = angle.size
    sines, cosines = np.sin(angle), np.cos(angle)
    rest, sizes = np.empty(n_arms), np.empty(n_arms)
    for k in range(counts.shape[0]):
        right = up = radius = limit = 0.0
        for turn in range(2):
            n = s = c = ss = cc = sc = y = ys = yc = 0.0
            for i in range(n_arms):
                if counts[k, i] == fill:
                    continue
                r = offset + scale * counts[k, i]
                if r != r:
                    continue
                if turn == 1 and abs(r - radius - right * sines[i] - up * cosines[i]) > limit:
                    continue
                n += 1.0
                s += sines[i]
                c += cosines[i]
                ss += sines[i] * sines[i]
                cc += cosines[i] * cosines[i]
                sc += sines[i] * cosines[i]
                y += r
                ys += r * sines[i]
                yc += r * cosines[i]
            if n < 3.0 or n < 0.5 * n_arms:
                right = up = np.nan
                break
            a, b, d = ss - s * s / n, sc - s * c / n, cc - c * c / n
            p, q = ys - y * s / n, yc - y * c / n
            det = a * d - b * b
            if det < 1e-9 * n * n:
                right = up = np.nan
                break
            right, up = (p * d - q * b) / det, (q * a - p * b) / det
            radius = (y - right * s - up * c) / n
            if turn == 0:
                m = 0
                for i in range(n_arms):
                    if counts[k, i] == fill:
                        continue
                    r = offset + scale * counts[k, i]
                    rest[i] = abs(r - radius - right * sines[i] - up * cosines[i])
                    sizes[m] = rest[i]
                    m += 1
                limit = 3.0 * 1.4826 * np.median(sizes[:m]) + 1e-9
        if math.isfinite(right) and math.isfinite(up):
            out[k, 0], out[k, 1] = right, up
        else:
            out[k, 0] = out[k, 1] = np.nan
