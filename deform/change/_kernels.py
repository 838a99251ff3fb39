"""Jitted loops of the change room: arrays in, arrays out, SI and radian, no validation; free of the interpreter's lock."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy", nogil=True)
def drift_filter(place, tangent, right, lift, value, noise, used, walk, state, cover, ahead_state, ahead_cover):
    """Run the drift of a pair of runs forward along the pipe; return minus twice the log likelihood of the used nodes.

    State: drift east, north, up (m), relative heading, pitch (rad) and scale (1), the last three random walks.
    ``walk`` holds their intensities (rad²/m, rad²/m, 1/m); ``noise`` (n, 3) the variances of east, north, up.
    ``state``, ``cover`` receive the filtered, ``ahead_*`` the predicted moments of each node.
    """
    n = place.shape[0]
    x = np.zeros(6)
    c = np.zeros((6, 6))
    for i in range(3):
        c[i, i] = 1e6
        c[i + 3, i + 3] = 1e-2
    gain = np.zeros(6)
    score = 0.0
    for k in range(n):
        if k > 0:
            _predict(x, c, place[k] - place[k - 1], tangent[k - 1], right[k - 1], lift[k - 1], walk)
        for i in range(6):
            ahead_state[k, i] = x[i]
            for j in range(6):
                ahead_cover[k, i, j] = c[i, j]
        if used[k]:
            for m in range(3):
                s = c[m, m] + noise[k, m]
                miss = value[k, m] - x[m]
                if s < 1e5:
                    score += np.log(s) + miss * miss / s
                for i in range(6):
                    gain[i] = c[i, m] / s
                for i in range(6):
                    x[i] += gain[i] * miss
                for i in range(6):
                    for j in range(i, 6):
                        c[i, j] -= gain[i] * gain[j] * s
                        c[j, i] = c[i, j]
        for i in range(6):
            state[k, i] = x[i]
            for j in range(6):
                cover[k, i, j] = c[i, j]
    return score


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _predict(x, c, ds, tangent, right, lift, walk):
    """Carry the drift over a stretch of pipe: position turns with relative heading, pitch and scale."""
    f = np.zeros((3, 3))
    for i in range(3):
        f[i, 0] = right[i] * ds
        f[i, 1] = lift[i] * ds
        f[i, 2] = tangent[i] * ds
    for i in range(3):
        x[i] += f[i, 0] * x[3] + f[i, 1] * x[4] + f[i, 2] * x[5]
    b = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            b[i, j] = f[i, 0] * c[3, j + 3] + f[i, 1] * c[4, j + 3] + f[i, 2] * c[5, j + 3]
    for i in range(3):
        for j in range(i, 3):
            e = 0.0
            w = 0.0
            for m in range(3):
                e += f[i, m] * c[m + 3, j] + f[j, m] * c[m + 3, i] + b[i, m] * f[j, m]
                w += f[i, m] * f[j, m] * walk[m] * ds / 3.0
            c[i, j] += e + w
            c[j, i] = c[i, j]
    for i in range(3):
        for j in range(3):
            c[i, j + 3] += b[i, j] + 0.5 * f[i, j] * walk[j] * ds
            c[j + 3, i] = c[i, j + 3]
    for m in range(3):
        c[m + 3, m + 3] += walk[m] * ds


@numba.njit(cache=True, error_model="numpy", nogil=True)
def drift_smooth(place, tangent, right, lift, state, cover, ahead_state, ahead_cover):
    """Turn filtered moments into smoothed ones, in place (Rauch–Tung–Striebel)."""
    n = place.shape[0]
    f = np.eye(6)
    for k in range(n - 2, -1, -1):
        ds = place[k + 1] - place[k]
        for i in range(3):
            f[i, 3] = right[k, i] * ds
            f[i, 4] = lift[k, i] * ds
            f[i, 5] = tangent[k, i] * ds
        cf = np.zeros((6, 6))
        for i in range(6):
            for j in range(6):
                e = cover[k, i, j]
                if j < 3:
                    e += cover[k, i, 3] * f[j, 3] + cover[k, i, 4] * f[j, 4] + cover[k, i, 5] * f[j, 5]
                cf[i, j] = e
        back = np.linalg.solve(ahead_cover[k + 1], cf.T).T
        miss = state[k + 1] - ahead_state[k + 1]
        for i in range(6):
            for j in range(6):
                state[k, i] += back[i, j] * miss[j]
        gap = cover[k + 1] - ahead_cover[k + 1]
        part = np.zeros((6, 6))
        for i in range(6):
            for j in range(6):
                e = 0.0
                for m in range(6):
                    e += back[i, m] * gap[m, j]
                part[i, j] = e
        for i in range(6):
            for j in range(i, 6):
                e = 0.0
                for m in range(6):
                    e += part[i, m] * back[j, m]
                cover[k, i, j] += e
                cover[k, j, i] = cover[k, i, j]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def block_means(values, size, out):
    """Mean of the finite values of each block of ``size`` rows; NaN when fewer than half are finite."""
    n, columns = out.shape
    for i in range(n):
        for c in range(columns):
            total = 0.0
            count = 0
            for k in range(i * size, min((i + 1) * size, values.shape[0])):
                v = values[k, c]
                if np.isfinite(v):
                    total += v
                    count += 1
            out[i, c] = total / count if 2 * count >= size else np.nan


@numba.njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "contract"})
def _weighted(values, first, weights):
    total = 0.0
    for k in range(weights.size):
        total += weights[k] * values[first + k]
    return total


@numba.njit(cache=True, error_model="numpy", nogil=True)
def weighted_across(value, axis, weights, gone, out):
    """Weighted sum of vectors (3, m) about each place along the axis (m, 3) there, NaN where ``gone``.

    The weights are odd in number, and must not reach beyond the ends elsewhere.
    """
    half = weights.size // 2
    for i in range(out.size):
        out[i] = np.nan
        if not gone[i]:
            total = 0.0
            for c in range(3):
                if axis[i, c] != 0.0:  # the lateral axis is level
                    total += axis[i, c] * _weighted(value[c], i - half, weights)
            out[i] = total


@numba.njit(cache=True, error_model="numpy", nogil=True)
def weighted_every(values, weights, size, out):
    """Weighted sum about the middle of each ``size`` places; ``values`` has half the weights' number added at both ends."""
    for i in range(out.size):
        out[i] = _weighted(values, i * size + size // 2, weights)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def both(k, other):
    """Sum of the sizes of two components, of what is known of them."""
    size = abs(k) if k == k else 0.0
    return size + abs(other) if other == other else size


@numba.njit(cache=True, error_model="numpy", nogil=True)
def curvature_difference(
    before,
    after,
    beside,
    sigma_before,
    sigma_after,
    stated,
    speed_before,
    speed_after,
    table_before,
    table_after,
    map_sigma,
    fraction,
    lean,
    spill,
    fade,
    shift,
    step,
    first,
    last,
    change,
    sigma,
):
    """Change of curvature and its sigma from place ``first`` to before ``last``: f² (σ₁² + σ₂²) + (a k)² + (b² + σ_map²) (dk/ds)²
    + c² (k² + k'²) + d² (h² + g²), k' the curvature ``beside``, of the other component.

    f² = ``table_before`` at the speed step of the first run + ``table_after`` at that of the second. h and g are the greatest
    |k| + |k'| before and behind the place, fading by ``fade`` from place to place.
    """
    n = before.shape[0]
    reach = int(12.0 / max(1.0 - fade, 1e-3)) + 1
    near = 0.0
    for i in range(max(first - reach, 0), first):
        near = max(near * fade, both(before[i], beside[i]))
    for i in range(first, last):
        change[i] = after[i] - before[i]
        square = table_before[speed_before[i]] + table_after[speed_after[i]]
        if stated:
            square *= sigma_before[i] * sigma_before[i] + sigma_after[i] * sigma_after[i]
        k, other = before[i], beside[i]
        left, right = max(i - 1, 0), min(i + 1, n - 1)
        slope = (before[right] - before[left]) / (step * max(right - left, 1))
        if slope == slope:
            wrong = map_sigma[i]
            if wrong != wrong:
                wrong = 0.0
            square += (shift * shift + wrong * wrong) * slope * slope
        square += (fraction * fraction + lean * lean) * k * k
        if other == other:
            square += lean * lean * other * other
        near = max(near * fade, both(k, other))
        sigma[i] = square + spill * spill * near * near
    near = 0.0
    for i in range(min(last + reach, n) - 1, first - 1, -1):
        near = max(near * fade, both(before[i], beside[i]))
        if i < last:
            sigma[i] = np.sqrt(sigma[i] + spill * spill * near * near)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def explained(place, change, weight, starts, ends, shortest, shapes, out):
    """Fill out (starts, ends) with the chi-square that shapes between each start and end explain, both components at once.

    ``weight`` (n, 2) holds square roots of weights; ``shapes`` (count, powers) the polynomials of x = (s - a) / (b - a), powers
    rising. Minus one where a stretch is too short or holds too little. Normal equations by Cholesky; the shapes are near
    orthogonal, so that they are well conditioned.
    """
    n, count, powers = place.shape[0], shapes.shape[0], shapes.shape[1]
    value = np.empty(count)
    normal = np.empty((2, count, count))
    right = np.empty((2, count))
    for i in range(starts.shape[0]):
        first = np.searchsorted(place, starts[i])
        for j in range(ends.shape[0]):
            out[i, j] = -1.0
            last = np.searchsorted(place, ends[j])
            length = ends[j] - starts[i]
            if length < shortest or last - first < count + 1:
                continue
            normal[:] = 0.0
            right[:] = 0.0
            for k in range(first, min(last, n)):
                x = (place[k] - starts[i]) / length
                for p in range(count):
                    v = shapes[p, powers - 1]
                    for q in range(powers - 2, -1, -1):
                        v = v * x + shapes[p, q]
                    value[p] = v
                for c in range(2):
                    w = weight[k, c] * weight[k, c]
                    if w > 0.0:
                        for p in range(count):
                            right[c, p] += w * value[p] * change[k, c]
                            for q in range(p + 1):
                                normal[c, p, q] += w * value[p] * value[q]
            total = 0.0
            for c in range(2):
                total += _quadratic(normal[c], right[c])
            out[i, j] = total


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _quadratic(a, b):
    """B' A⁻¹ b of a symmetric matrix, given by its lower triangle and overwritten; directions without weight count nothing."""
    n = b.shape[0]
    largest = 0.0
    for i in range(n):
        largest = max(largest, a[i, i])
    if not largest > 0.0:
        return 0.0
    total = 0.0
    for i in range(n):
        for j in range(i):
            s = a[i, j]
            for k in range(j):
                s -= a[i, k] * a[j, k]
            a[i, j] = s / a[j, j] if a[j, j] > 0.0 else 0.0
        s = a[i, i]
        t = b[i]
        for k in range(i):
            s -= a[i, k] * a[i, k]
            t -= a[i, k] * b[k]
        if s > 1e-9 * largest:
            a[i, i] = np.sqrt(s)
            b[i] = t / a[i, i]
        else:
            a[i, i] = 0.0
            b[i] = 0.0
        total += b[i] * b[i]
    return total
