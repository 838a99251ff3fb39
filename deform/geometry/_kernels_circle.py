"""Loops of the circle and ellipse adjustment: batches of sections, one after the other or in parallel."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from deform.geometry._kernels_solve import backward, biweights, cholesky, forward

BLOCK = 256  # sections that share scratch
_STEP, _STEP_ROBUST = 1e-3, 1e-2  # sigma: a step below this ends the iteration; the next one would be a hundredth of it
_FAST = {"contract", "reassoc", "nsz", "arcp"}


@njit(cache=True, error_model="numpy", parallel=True)
def fit_directly(x, z, scale, values):
    """Direct fit of each section: values (n, 5) = right, up, semi-axes (m), orientation (rad); NaN where it fails."""
    n, arms = x.shape
    for block in prange((n + BLOCK - 1) // BLOCK):
        work = np.empty((5, arms))
        normal, vectors = np.empty((5, 5)), np.empty((5, 16))
        for i in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            px, pz, count = x[i], z[i], arms
            if not _complete(px, pz):
                count = _gather(px, pz, work)
                px, pz = work[0], work[1]
            if _direct(px, pz, count, scale, normal, vectors):
                _axes(vectors[0], values[i])
            else:
                for k in range(5):
                    values[i, k] = np.nan


@njit(cache=True, error_model="numpy", parallel=True)
def adjust_sections(x, z, sigma, tangential, robust, circle, rounds, scale, values, covariance, residual, weights, variance):
    """Combined (Gauss-Helmert) adjustment of each section, from its direct fit.

    x, z (n, arms) m, NaN where missing; sigma, tangential: m, of a point along and across its ray from the origin; values
    (n, 5) = right, up, semi-axes (m), orientation (rad), and their covariance (n, 5, 5) by the points' sigmas; residual
    (n, arms) m along the ray; weights (n), their sum; variance (n) of unit weight. NaN where a section fails.
    """
    n, arms = x.shape
    for block in prange((n + BLOCK - 1) // BLOCK):
        work = np.empty((5, arms))
        normal, vectors, turned = np.empty((5, 5)), np.empty((5, 16)), np.empty((5, 5))
        for i in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            px, pz, count = x[i], z[i], arms
            if not _complete(px, pz):
                count = _gather(px, pz, work)
                px, pz = work[0], work[1]
            good = _direct(px, pz, count, scale, normal, vectors)
            if good:
                good, weights[i], variance[i] = _adjust(
                    px, pz, work, count, sigma, tangential, robust, circle, rounds, normal, vectors
                )
            else:
                weights[i], variance[i] = float(count), np.nan
            if good:
                _axes(vectors[0], values[i])
                _propagate(normal, vectors, values[i], circle, turned, covariance[i])
                _residuals(x[i], z[i], sigma, tangential, vectors[0], residual[i])
            else:
                for a in range(arms):
                    residual[i, a] = np.nan
                for j in range(5):
                    values[i, j] = np.nan
                    for k in range(5):
                        covariance[i, j, k] = np.nan


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _complete(x, z):
    """True when no point is missing."""
    total = 0.0
    for a in range(x.size):
        total += x[a] + z[a]
    return not np.isnan(total)


@njit(cache=True, error_model="numpy")
def _gather(x, z, work):
    """Gather the points that are there in work[0] and work[1]; return their number."""
    count = 0
    for a in range(x.size):
        if not np.isnan(x[a] + z[a]):
            work[0, count], work[1, count] = x[a], z[a]
            count += 1
    return count


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _conic_sums(x, z, count, scale, sums):
    """Sums of the 14 products of (x^2, xz, z^2, x, z) that the direct fit needs."""
    s40 = s31 = s22 = s13 = s04 = s30 = s21 = s12 = s03 = s20 = s11 = s02 = s10 = s01 = 0.0
    for a in range(count):
        u, v = x[a] * scale, z[a] * scale
        uu, uv, vv = u * u, u * v, v * v
        s40 += uu * uu
        s31 += uu * uv
        s22 += uu * vv
        s13 += uv * vv
        s04 += vv * vv
        s30 += uu * u
        s21 += uu * v
        s12 += u * vv
        s03 += vv * v
        s20 += uu
        s11 += uv
        s02 += vv
        s10 += u
        s01 += v
    sums[0], sums[1], sums[2], sums[3], sums[4] = s40, s31, s22, s13, s04
    sums[5], sums[6], sums[7], sums[8] = s30, s21, s12, s03
    sums[9], sums[10], sums[11], sums[12], sums[13] = s20, s11, s02, s10, s01


@njit(cache=True, error_model="numpy")
def _direct(x, z, count, scale, normal, vectors):
    """Solve for the conic A u^2 + B uv + C v^2 + D u + E v = 1 of the first ``count`` points, and turn it into vectors[0].

    vectors[0] = cx, cz, m, p, q with m (X^2 + Z^2) + p (Z^2 - X^2) + 2 q X Z = 1 about the centre. False when it is no
    ellipse or singular.
    """
    if count < 5:
        return False
    out, right, inverse, s = vectors[0], vectors[1], vectors[2], vectors[3]
    _conic_sums(x, z, count, scale, s)
    normal[0, 0] = s[0]
    normal[1, 0], normal[1, 1] = s[1], s[2]
    normal[2, 0], normal[2, 1], normal[2, 2] = s[2], s[3], s[4]
    normal[3, 0], normal[3, 1], normal[3, 2], normal[3, 3] = s[5], s[6], s[7], s[9]
    normal[4, 0], normal[4, 1], normal[4, 2], normal[4, 3], normal[4, 4] = s[6], s[7], s[8], s[10], s[11]
    right[0], right[1], right[2], right[3], right[4] = s[9], s[10], s[11], s[12], s[13]
    if not cholesky(normal, inverse, 5):
        return False
    forward(normal, inverse, right, 5)
    backward(normal, inverse, right, 5)
    a, b, c, d, e = right[0], right[1], right[2], right[3], right[4]
    determinant = 4.0 * a * c - b * b
    if not determinant > 0.0:
        return False
    over = 1.0 / determinant
    cu, cv = (b * e - 2.0 * c * d) * over, (b * d - 2.0 * a * e) * over
    factor = scale * scale / (1.0 + a * cu * cu + b * cu * cv + c * cv * cv)
    out[0], out[1] = cu / scale, cv / scale
    out[2], out[3], out[4] = 0.5 * (a + c) * factor, 0.5 * (c - a) * factor, 0.5 * b * factor
    return out[2] > 0.0


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _normal_sums(x, z, weight, miss2, count, along2, across2, unknowns, normal, right):
    """Normal equations of the section at ``unknowns``; miss2 receives the squared misclosure of each point in its sigma.

    Per point: f, its gradient (fx, fz), its variance B C B' by the radial and the tangential part, the row A of derivatives
    by cx, cz, m, p, q. Returns the weighted sum of squares.
    """
    cx, cz, m, p, q = unknowns[0], unknowns[1], unknowns[2], unknowns[3], unknowns[4]
    n00 = n10 = n11 = n20 = n21 = n22 = n30 = n31 = n32 = n33 = n40 = n41 = n42 = n43 = n44 = 0.0
    r0 = r1 = r2 = r3 = r4 = squares = 0.0
    for a in range(count):
        u, v = x[a] - cx, z[a] - cz
        s, d, t = u * u + v * v, v * v - u * u, 2.0 * u * v
        f = m * s + p * d + q * t - 1.0
        fx = 2.0 * ((m - p) * u + q * v)
        fz = 2.0 * ((m + p) * v + q * u)
        radial, side = fx * x[a] + fz * z[a], fz * x[a] - fx * z[a]
        inverse = (x[a] * x[a] + z[a] * z[a]) / (radial * radial * along2 + side * side * across2)
        w = weight[a] * inverse
        miss2[a] = f * f * inverse
        squares += w * f * f
        w0, w1, w2, w3, w4 = -w * fx, -w * fz, w * s, w * d, w * t
        n00 -= w0 * fx
        n10 -= w1 * fx
        n11 -= w1 * fz
        n20 -= w2 * fx
        n21 -= w2 * fz
        n22 += w2 * s
        n30 -= w3 * fx
        n31 -= w3 * fz
        n32 += w3 * s
        n33 += w3 * d
        n40 -= w4 * fx
        n41 -= w4 * fz
        n42 += w4 * s
        n43 += w4 * d
        n44 += w4 * t
        r0 -= w0 * f
        r1 -= w1 * f
        r2 -= w2 * f
        r3 -= w3 * f
        r4 -= w4 * f
    normal[0, 0] = n00
    normal[1, 0], normal[1, 1] = n10, n11
    normal[2, 0], normal[2, 1], normal[2, 2] = n20, n21, n22
    normal[3, 0], normal[3, 1], normal[3, 2], normal[3, 3] = n30, n31, n32, n33
    normal[4, 0], normal[4, 1], normal[4, 2], normal[4, 3], normal[4, 4] = n40, n41, n42, n43, n44
    right[0], right[1], right[2], right[3], right[4] = r0, r1, r2, r3, r4
    return squares


@njit(cache=True, error_model="numpy")
def _adjust(x, z, work, count, sigma, tangential, robust, circle, rounds, normal, vectors):
    """Iterate vectors[0] to the adjusted section; whether it stands, the sum of weights and the variance of unit weight.

    Leaves in ``normal`` the Cholesky factor of the scaled normal matrix, in vectors[1] the scales, in vectors[2] the
    reciprocal diagonal of the factor.
    """
    unknowns, scales, inverse, right = vectors[0], vectors[1], vectors[2], vectors[3]
    weight, size = work[2], 3 if circle else 5
    for a in range(count):
        weight[a] = 1.0
    total, squares = float(count), 0.0
    if circle:
        unknowns[3] = unknowns[4] = 0.0
    if count <= size:
        return False, total, np.nan
    for turn in range(rounds):
        squares = _normal_sums(x, z, weight, work[3], count, sigma**2, tangential**2, unknowns, normal, right)
        if circle:  # p and q stay: their equations become 1 * step = 0
            for k in range(5):
                normal[3, k] = normal[4, k] = 0.0
            normal[3, 3] = normal[4, 4] = 1.0
            right[3] = right[4] = 0.0
        if total <= size:
            return False, total, np.nan
        for k in range(5):
            scales[k] = 1.0 / np.sqrt(max(normal[k, k], 1e-300))
            right[k] *= scales[k]
            for j in range(k + 1):
                normal[k, j] *= scales[k] * scales[j]
        if not cholesky(normal, inverse, 5):
            return False, total, np.nan
        forward(normal, inverse, right, 5)
        backward(normal, inverse, right, 5)
        largest = 0.0
        for k in range(5):
            unknowns[k] += right[k] * scales[k]
            largest = max(largest, abs(right[k]))
        if not (unknowns[2] > 0.0 and unknowns[3] ** 2 + unknowns[4] ** 2 < unknowns[2] ** 2):
            return False, total, np.nan
        if largest < (_STEP_ROBUST if robust else _STEP) and (turn > 0 or not robust):
            break
        if robust:
            total = biweights(work[3], count, 1.0, weight, work[4])
    return True, total, squares / (total - size)


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _residuals(x, z, sigma, tangential, unknowns, residual):
    """Measured minus adjusted along each ray (m)."""
    cx, cz, m, p, q = unknowns[0], unknowns[1], unknowns[2], unknowns[3], unknowns[4]
    along2, across2 = sigma * sigma, tangential * tangential
    for a in range(x.size):
        u, v = x[a] - cx, z[a] - cz
        fx, fz = 2.0 * ((m - p) * u + q * v), 2.0 * ((m + p) * v + q * u)
        radial, side = fx * x[a] + fz * z[a], fz * x[a] - fx * z[a]
        f = m * (u * u + v * v) + p * (v * v - u * u) + 2.0 * q * u * v - 1.0
        length = np.sqrt(x[a] * x[a] + z[a] * z[a])
        residual[a] = f * radial * length * along2 / (radial * radial * along2 + side * side * across2)


@njit(cache=True, error_model="numpy")
def _axes(unknowns, values):
    """Turn cx, cz, m, p, q into right, up, semi-major, semi-minor (m) and orientation (rad, in 0 .. pi)."""
    m, p, q = unknowns[2], unknowns[3], unknowns[4]
    length = np.sqrt(p * p + q * q)
    values[0], values[1] = unknowns[0], unknowns[1]
    values[2], values[3] = 1.0 / np.sqrt(m - length), 1.0 / np.sqrt(m + length)
    turn = 0.5 * np.arctan2(-q, -p)
    values[4] = turn + np.pi if turn < 0.0 else turn


@njit(cache=True, error_model="numpy")
def _propagate(factor, vectors, values, circle, turned, covariance):
    """Covariance of right, up, axes and orientation: J N^-1 J' = Y' Y with Y = L^-1 S J', S the scales of the normal matrix.

    Where the section is round within its noise the direction is bounded by that noise.
    """
    unknowns, scales, inverse, right = vectors[0], vectors[1], vectors[2], vectors[3]
    p, q = unknowns[3], unknowns[4]
    length = np.sqrt(p * p + q * q)
    cos, sin = (p / length, q / length) if length > 0.0 else (1.0, 0.0)
    a3, b3 = 0.5 * values[2] ** 3, 0.5 * values[3] ** 3
    for j in range(5):  # rows: unknowns cx, cz, m, p, q; columns: right, up, semi-major, semi-minor, orientation
        for k in range(5):
            turned[j, k] = 0.0
    turned[0, 0], turned[1, 1] = scales[0], scales[1]
    turned[2, 2], turned[2, 3] = -a3 * scales[2], -b3 * scales[2]
    if not circle:
        noise = 0.0
        for k in range(3, 5):  # variance of p and of q
            for j in range(5):
                right[j] = 0.0
            right[k] = scales[k]
            forward(factor, inverse, right, 5)
            for j in range(k, 5):
                noise += 0.5 * right[j] * right[j]
        turn = 0.5 / max(length, np.sqrt(noise))
        turned[3, 2], turned[4, 2] = a3 * cos * scales[3], a3 * sin * scales[4]
        turned[3, 3], turned[4, 3] = -b3 * cos * scales[3], -b3 * sin * scales[4]
        turned[3, 4], turned[4, 4] = -turn * sin * scales[3], turn * cos * scales[4]
    for c in range(5):
        forward(factor, inverse, turned[:, c], 5)
    for j in range(5):
        for k in range(j + 1):
            value = 0.0
            for m in range(5):
                value += turned[m, j] * turned[m, k]
            covariance[j, k] = covariance[k, j] = value
