"""Loops of the circle and ellipse adjustment: batches of sections, one after the other or in parallel."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

TUKEY = 4.685  # width of the biweight in sigma
_TINY = 1e-14
_STEP, _STEP_ROBUST = 1e-4, 1e-2  # sigma: a step below this ends the iteration


@njit(cache=True, error_model="numpy", inline="always")
def _cholesky(normal, size):
    """Factor the lower triangle in place; False when it is not positive definite."""
    for i in range(size):
        for j in range(i + 1):
            value = normal[i, j]
            for k in range(j):
                value -= normal[i, k] * normal[j, k]
            if i == j:
                if not value > _TINY:
                    return False
                normal[i, i] = np.sqrt(value)
            else:
                normal[i, j] = value / normal[j, j]
    return True


@njit(cache=True, error_model="numpy", inline="always")
def _back(factor, right, size):
    """Solve with a Cholesky factor in place."""
    for i in range(size):
        value = right[i]
        for k in range(i):
            value -= factor[i, k] * right[k]
        right[i] = value / factor[i, i]
    for i in range(size - 1, -1, -1):
        value = right[i]
        for k in range(i + 1, size):
            value -= factor[k, i] * right[k]
        right[i] = value / factor[i, i]


@njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def _conic_sums(x, z, arms, scale, sums):
    """Sums of the 14 products of (x^2, xz, z^2, x, z) that the direct fit needs; true when no point is missing."""
    s40 = s31 = s22 = s13 = s04 = s30 = s21 = s12 = s03 = s20 = s11 = s02 = s10 = s01 = 0.0
    for a in range(arms):
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
    return not np.isnan(s20 + s02)


@njit(cache=True, error_model="numpy")
def _conic(sums, normal, right):
    """Solve for the conic A u^2 + B uv + C v^2 + D u + E v = 1; false when it is no ellipse or singular."""
    s = sums
    normal[0, 0] = s[0]
    normal[1, 0], normal[1, 1] = s[1], s[2]
    normal[2, 0], normal[2, 1], normal[2, 2] = s[2], s[3], s[4]
    normal[3, 0], normal[3, 1], normal[3, 2], normal[3, 3] = s[5], s[6], s[7], s[9]
    normal[4, 0], normal[4, 1], normal[4, 2], normal[4, 3], normal[4, 4] = s[6], s[7], s[8], s[10], s[11]
    right[0], right[1], right[2], right[3], right[4] = s[9], s[10], s[11], s[12], s[13]
    if not _cholesky(normal, 5):
        return False
    _back(normal, right, 5)
    return 4.0 * right[0] * right[2] - right[1] ** 2 > 0.0


@njit(cache=True, error_model="numpy")
def _centred(conic, scale, out):
    """Turn a conic of scaled points into (cx, cz, m, p, q): m (X^2 + Z^2) + p (Z^2 - X^2) + 2 q X Z = 1 about the centre."""
    a, b, c, d, e = conic
    determinant = 4.0 * a * c - b * b
    cu = (b * e - 2.0 * c * d) / determinant
    cv = (b * d - 2.0 * a * e) / determinant
    level = 1.0 + a * cu * cu + b * cu * cv + c * cv * cv
    factor = scale * scale / level
    out[0], out[1] = cu / scale, cv / scale
    out[2], out[3], out[4] = 0.5 * (a + c) * factor, 0.5 * (c - a) * factor, 0.5 * b * factor


@njit(cache=True, error_model="numpy")
def ellipse_direct(x, z, scale, out, present, work_x, work_z):
    """Direct fit of one section after the other; out (n, 5) = cx, cz, m, p, q, NaN where it fails."""
    n, arms = x.shape
    sums, normal, right = np.empty(14), np.empty((5, 5)), np.empty(5)
    for i in range(n):
        count = arms
        good = _conic_sums(x[i], z[i], arms, scale, sums)
        if not good:
            count = 0
            for a in range(arms):
                if not np.isnan(x[i, a] + z[i, a]):
                    work_x[count], work_z[count] = x[i, a], z[i, a]
                    count += 1
            if count >= 5:
                good = _conic_sums(work_x, work_z, count, scale, sums)
        present[i] = count
        if good and count >= 5 and _conic(sums, normal, right):
            _centred(right, scale, out[i])
        else:
            out[i] = np.nan


@njit(cache=True, error_model="numpy", parallel=True)
def adjust_sections(x, z, sigma, tangential, robust, size, rounds, unknowns, covariance, residual, weight_sum, variance):
    """Combined (Gauss-Helmert) adjustment of each section, from the starting values in ``unknowns``.

    x, z (n, arms) m, NaN where missing; sigma, tangential: m, of a point along and across its ray from the origin; size: 5
    for an ellipse, 3 for a circle, whose p and q stay; unknowns (n, 5) = cx, cz, m, p, q, updated in place; covariance
    (n, 5, 5) by the points' sigmas; residual (n, arms) m along the ray; weight_sum (n); variance (n) of unit weight.
    """
    n, arms = x.shape
    for i in prange(n):
        weight_sum[i], variance[i] = _adjust_one(
            x[i], z[i], arms, sigma, tangential, robust, size, rounds, unknowns[i], covariance[i], residual[i]
        )
        if np.isnan(variance[i]):
            unknowns[i] = np.nan
            covariance[i] = np.nan
            residual[i] = np.nan


@njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def _normal_sums(x, z, weight, count, along2, across2, unknowns, miss2, normal, right):
    """Normal equations of the section at ``unknowns``; miss2 receives the squared misclosure of each point in its sigma.

    Per point: f, its gradient (fx, fz), its variance B C B' by the radial and the tangential part, the row A of derivatives
    by cx, cz, m, p, q. Returns the weighted sum of squares.
    """
    cx, cz, m, p, q = unknowns
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
def _adjust_one(x, z, arms, sigma, tangential, robust, size, rounds, unknowns, covariance, residual):
    """Adjust one section; returns the sum of weights and the variance of unit weight (NaN when it fails)."""
    work = np.empty((4, arms))
    px, pz, weight, miss2 = work[0], work[1], work[2], work[3]
    normal, right, scales = np.empty((5, 5)), np.empty(5), np.ones(5)
    count = 0
    for a in range(arms):
        if not np.isnan(x[a] + z[a]):
            px[count], pz[count], weight[count] = x[a], z[a], 1.0
            count += 1
    if count <= size or np.isnan(unknowns[0] + unknowns[2]):
        return float(count), np.nan
    weights, squares = float(count), 0.0
    for turn in range(rounds):
        squares = _normal_sums(px, pz, weight, count, sigma * sigma, tangential * tangential, unknowns, miss2, normal, right)
        if weights <= size:
            return weights, np.nan
        for k in range(size):
            scales[k] = 1.0 / np.sqrt(max(normal[k, k], 1e-300))
        for k in range(size):
            right[k] *= scales[k]
            for j in range(k + 1):
                normal[k, j] *= scales[k] * scales[j]
        if not _cholesky(normal, size):
            return weights, np.nan
        _back(normal, right, size)
        largest = 0.0
        for k in range(size):
            unknowns[k] += right[k] * scales[k]
            largest = max(largest, abs(right[k]))
        if unknowns[2] <= 0.0 or unknowns[3] ** 2 + unknowns[4] ** 2 >= unknowns[2] ** 2:
            return weights, np.nan
        if turn > 0 and largest < (_STEP_ROBUST if robust else _STEP):
            break
        if robust:
            weights = _reweigh(miss2, count, weight)
    _invert(normal, scales, size, covariance)
    cx, cz, m, p, q = unknowns
    for a in range(arms):
        u, v = x[a] - cx, z[a] - cz
        fx, fz = 2.0 * ((m - p) * u + q * v), 2.0 * ((m + p) * v + q * u)
        radial, side = fx * x[a] + fz * z[a], fz * x[a] - fx * z[a]
        f = m * (u * u + v * v) + p * (v * v - u * u) + 2.0 * q * u * v - 1.0
        length = np.sqrt(x[a] * x[a] + z[a] * z[a])
        residual[a] = (
            f * radial * length * sigma * sigma / (radial * radial * sigma * sigma + side * side * tangential * tangential)
        )
    return weights, squares / (weights - size)


@njit(cache=True, error_model="numpy")
def _reweigh(miss2, count, weight):
    """Biweights of the misclosures, the scale no smaller than the stated sigma; returns their sum."""
    ordered = np.sort(miss2[:count])
    width2 = TUKEY**2 * max(1.0, 2.198 * ordered[count // 2])
    total = 0.0
    for a in range(count):
        part = miss2[a] / width2
        weight[a] = (1.0 - part) ** 2 if part < 1.0 else 0.0
        total += weight[a]
    return total


@njit(cache=True, error_model="numpy")
def _invert(factor, scales, size, covariance):
    """Inverse of the normal matrix from its scaled Cholesky factor."""
    column = np.empty(5)
    covariance[:, :] = 0.0
    for k in range(size):
        column[:] = 0.0
        column[k] = 1.0
        _back(factor, column, size)
        for j in range(size):
            covariance[j, k] = column[j] * scales[j] * scales[k]


@njit(cache=True, error_model="numpy")
def propagate_axes(major, minor, cos, sin, length, circle, covariance):
    """Turn the covariance of cx, cz, m, p, q into that of right, up, semi_major, semi_minor, orientation, in place."""
    jacobian, part = np.zeros((5, 5)), np.empty((5, 5))
    jacobian[0, 0] = jacobian[1, 1] = 1.0
    for i in range(major.size):
        a3, b3 = 0.5 * major[i] ** 3, 0.5 * minor[i] ** 3
        jacobian[2, 2], jacobian[3, 2] = -a3, -b3
        if not circle:
            noise = np.sqrt(0.5 * (covariance[i, 3, 3] + covariance[i, 4, 4]))
            turn = 0.5 / max(length[i], noise)
            jacobian[2, 3], jacobian[2, 4] = a3 * cos[i], a3 * sin[i]
            jacobian[3, 3], jacobian[3, 4] = -b3 * cos[i], -b3 * sin[i]
            jacobian[4, 3], jacobian[4, 4] = -turn * sin[i], turn * cos[i]
        for j in range(5):
            for k in range(5):
                value = 0.0
                for m in range(5):
                    value += jacobian[j, m] * covariance[i, m, k]
                part[j, k] = value
        for j in range(5):
            for k in range(5):
                value = 0.0
                for m in range(5):
                    value += part[j, m] * jacobian[k, m]
                covariance[i, j, k] = value
