"""Loops of the circle and ellipse adjustment: batches of sections, one after the other or in parallel."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from deform.geometry._kernels_solve import TINY, backward, biweights, cholesky, forward

BLOCK = 256  # sections that share scratch
_STEP, _STEP_ROBUST = 1e-3, 1e-2  # sigma: a step below this ends the iteration; the next one would be a hundredth of it
_FAST = {"contract", "reassoc", "nsz", "arcp"}
# of the 14 sums in the lower triangle of the normal matrix of (x^2, xz, z^2, x, z), and in its right side
_PLACES = np.array([0, 1, 2, 2, 3, 4, 5, 6, 7, 9, 6, 7, 8, 10, 11, 9, 10, 11, 12, 13])


@njit(cache=True, error_model="numpy", parallel=True)
def fit_directly(x, z, scale, values):
    """Direct fit of each section: values (n, 5) = right, up, semi-axes (m), orientation (rad); NaN where it fails."""
    n, arms = x.shape
    for block in prange((n + BLOCK - 1) // BLOCK):
        first, last = block * BLOCK, min(n, (block + 1) * BLOCK)
        work, sums, conics, vector = np.empty((2, arms)), np.empty((BLOCK, 14)), np.empty((5, BLOCK)), np.empty(5)
        _conics(x[first:last], z[first:last], scale, work, sums, conics)
        for i in range(first, last):
            for k in range(5):
                vector[k] = conics[k, i - first]
            _axes(vector, values[i])


@njit(cache=True, error_model="numpy", parallel=True)
def adjust_sections(x, z, sigma, tangential, robust, circle, rounds, scale, values, covariance, residual, weights, variance):
    """Combined (Gauss-Helmert) adjustment of each section, from its direct fit.

    x, z (n, arms) m, NaN where missing; sigma, tangential: m, of a point along and across its ray from the origin; values
    (n, 5) = right, up, semi-axes (m), orientation (rad), and their covariance (n, 5, 5) by the points' sigmas; residual
    (n, arms) m along the ray; weights (n), their sum; variance (n) of unit weight. NaN where a section fails.
    """
    n, arms = x.shape
    for block in prange((n + BLOCK - 1) // BLOCK):
        first, last = block * BLOCK, min(n, (block + 1) * BLOCK)
        work, sums, conics = np.empty((5, arms)), np.empty((BLOCK, 14)), np.empty((5, BLOCK))
        normal, vectors, turned = np.empty((5, 5)), np.empty((4, 5)), np.empty((5, 5))
        _conics(x[first:last], z[first:last], scale, work, sums, conics)
        for i in range(first, last):
            px, pz, count = x[i], z[i], arms
            if not _complete(px, pz):
                count = _gather(px, pz, work)
                px, pz = work[0], work[1]
            for k in range(5):
                vectors[0, k] = conics[k, i - first]
            good = not np.isnan(vectors[0, 2])
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
def section_sums(x, z, scale, work, sums):
    """`_conic_sums` of the points that are there; NaN where they are fewer than five."""
    _conic_sums(x, z, x.size, scale, sums)
    if np.isnan(sums[9] + sums[11]):
        count = _gather(x, z, work)
        _conic_sums(work[0], work[1], count, scale, sums)
        if count < 5:
            sums[0] = np.nan


@njit(cache=True, error_model="numpy")
def _conics(x, z, scale, work, sums, conics):
    """Direct fit of the sections of one block: conics (5, ...) = cx, cz, m, p, q, NaN where it is no ellipse or singular.

    The conic A u^2 + B uv + C v^2 + D u + E v = 1 becomes m (X^2 + Z^2) + p (Z^2 - X^2) + 2 q X Z = 1 about its centre.
    """
    size = len(x)
    for i in range(size):
        section_sums(x[i], z[i], scale, work, sums[i])
    solved = np.empty((20, size))
    for k in range(20):
        for i in range(size):
            solved[k, i] = sums[i, _PLACES[k]]
    _solve_together(solved)
    for i in range(size):
        a, b, c, d, e = solved[15, i], solved[16, i], solved[17, i], solved[18, i], solved[19, i]
        determinant = 4.0 * a * c - b * b
        over = 1.0 / determinant
        cu, cv = (b * e - 2.0 * c * d) * over, (b * d - 2.0 * a * e) * over
        factor = scale * scale / (1.0 + a * cu * cu + b * cu * cv + c * cv * cv)
        m = 0.5 * (a + c) * factor
        conics[0, i], conics[1, i] = cu / scale, cv / scale
        conics[2, i] = m if determinant > 0.0 and m > 0.0 else np.nan
        conics[3, i], conics[4, i] = 0.5 * (c - a) * factor, 0.5 * b * factor


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _solve_together(rows):
    """Cholesky solution of 5 by 5 systems, one per column; each step is done for all columns side by side.

    rows (20, n): the lower triangles row by row, then the right sides, which become the solutions; NaN where a matrix is not
    positive definite.
    """
    for i in range(6):  # the right side is a sixth row of the factor
        for j in range(min(i + 1, 5)):
            here = rows[i * (i + 1) // 2 + j]
            for k in range(j):
                _take_off(here, rows[i * (i + 1) // 2 + k], rows[j * (j + 1) // 2 + k])
            if i == j:
                for s in range(here.size):  # the reciprocal of the diagonal is what is needed
                    here[s] = 1.0 / np.sqrt(here[s]) if here[s] > TINY else np.nan
            else:
                _scale_by(here, rows[j * (j + 1) // 2 + j])
    for i in range(4, -1, -1):
        here = rows[15 + i]
        for k in range(i + 1, 5):
            _take_off(here, rows[k * (k + 1) // 2 + i], rows[15 + k])
        _scale_by(here, rows[i * (i + 1) // 2 + i])


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _take_off(target, first, second):
    for s in range(target.size):
        target[s] -= first[s] * second[s]


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _scale_by(target, factor):
    for s in range(target.size):
        target[s] *= factor[s]


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
