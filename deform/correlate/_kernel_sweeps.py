"""Two lists, a band, rates and evidence in, the weights of all alignments, or of the best, over the band out.

A cell (i, j) means: weld i of A and weld j of B are one weld. Weights are linear, with one unit per row, so that no logarithm
stands in a loop. With ``best`` each sum becomes the larger of its terms. Three kinds of move end in a cell: those of a few welds;
a cut-out of up to `LONGEST_CUT` listed joints, looked for only where its length is kept, from cells that matter in their row; and
a re-route of any size, which costs the same per joint of either run, so that a running sum over rows and columns holds them all.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from deform.correlate._kernel_moves import (
    FIT_M,
    against_three,
    against_two,
    begin,
    cut_table,
    displaced,
    fit,
    joint_at,
    move_cut,
    noise,
    span,
    two_against_two,
)
from deform.correlate._kernel_types import BIN, LONGEST_CUT, MOST_LOOSE

MATTERS = 1e-5  # of the row's largest weight; a cell with less begins no cut-out


@njit(cache=True, error_model="numpy")
def ahead(s, band, t, ev, best):
    """Weight of all alignments, or of the best, up to every cell.

    Returns
    -------
    total : (cells) in units of the row.
    norm : (n) unit of each row in units of the row before.
    log_scale : (n) logarithm of the unit of each row.
    log_total : logarithm of the weight of all alignments, or of the best; that of none at all, both runs strangers, is 0.
    """
    n, m = s.x.size, s.y.size
    x, y, inv_a, inv_b, shared = s.x, s.y, s.inv_a, s.inv_b, s.shared
    last = shared.size - 1
    f, table = noise(t), cut_table(s, t)
    total, norm, log_scale = np.zeros(band.offset[n]), np.ones(n), np.zeros(n)
    opened, before, folded = np.zeros(m), 0.0, band.low[0]  # re-routes open at each column, and at all before the band
    width = (band.high - band.low).max() + 1
    cuts = np.zeros(width)
    column, pointer = np.zeros((LONGEST_CUT + 1, width), np.int64), np.zeros((LONGEST_CUT + 1, width), np.int64)
    count = np.zeros(LONGEST_CUT + 1, np.int64)
    joints, welds = ev.joint.size > 0, ev.weld.size > 0
    for i in range(n):
        low, high, o0 = span(band, i)
        l1, h1, o1 = span(band, i - 1)
        l2, h2, o2 = span(band, i - 2)
        l3, h3, o3 = span(band, i - 3)
        q2 = 1.0 / norm[i - 1] if i > 1 else 1.0
        q3 = q2 / norm[i - 2] if i > 2 else 1.0
        may_begin = i == 0 or low == 0 or i + low <= MOST_LOOSE
        start = np.exp(-max(log_scale[i - 1], -600.0)) if i > 0 and may_begin else 1.0
        while folded < low:
            before = t.reroute_more * (max(before, opened[folded]) if best else before + opened[folded])
            folded += 1
        _cuts_into(
            i, x, y, s.fresh, s.closing, band.low, band.offset, band.high, table, total, norm, column, pointer, count, cuts, best
        )
        open_, top = before, 0.0
        u1 = x[i] - x[i - 1] if i > 0 else 0.0
        u2, u3 = x[i] - x[max(i - 2, 0)], x[i] - x[max(i - 3, 0)]
        a1, a2, a3 = inv_a[i], inv_a[max(i - 1, 0)], inv_a[max(i - 2, 0)]
        for j in range(low, high + 1):
            v = cuts[j - low]
            cuts[j - low] = 0.0
            if may_begin:
                w = start * begin(i, j, t)
                v = max(v, w) if best else v + w
            if j > low:
                open_ = t.reroute_more * (max(open_, opened[j - 1]) if best else open_ + opened[j - 1])
            w = t.reroute * open_
            v = max(v, w) if best else v + w
            if l1 <= j - 1 <= h1:
                r = y[j] - y[j - 1] - u1
                w = total[o1 + j - 1] * t.same * fit(r, f) * shared[min(int((u1 + 0.5 * r) / BIN), last)] * a1 * inv_b[j]
                if joints:
                    w *= ev.joint[o0 + j]
                v = max(v, w) if best else v + w
            if l1 <= j - 2 <= h1:
                r = y[j] - y[j - 2] - u1
                if abs(r) < f[3]:
                    w = total[o1 + j - 2] * against_two(r, a1, inv_b[j - 1], inv_b[j], t.missed_a, t.false_b, f)
                    w *= joint_at(ev.joint, band, i, j - 1) if joints else 1.0
                    v = max(v, w) if best else v + w
            if l1 <= j - 3 <= h1:
                r = y[j] - y[j - 3] - u1
                if abs(r) < f[3]:
                    w = against_three(r, a1, inv_b[j - 2], inv_b[j - 1], inv_b[j], t.missed_a, t.again, t.false_b, f)
                    w *= total[o1 + j - 3] * (joint_at(ev.joint, band, i, j - 2) if joints else 1.0)
                    v = max(v, w) if best else v + w
            if l2 <= j - 1 <= h2:
                r = y[j] - y[j - 1] - u2
                if abs(r) < f[3]:
                    w = total[o2 + j - 1] * q2 * against_two(r, inv_b[j], a2, a1, t.missed_b, t.false_a, f)
                    w *= joint_at(ev.joint, band, i - 1, j) if joints else 1.0
                    v = max(v, w) if best else v + w
            if l2 <= j - 2 <= h2:
                r = y[j] - y[j - 2] - u2
                if abs(r) < f[3]:
                    shift = y[j - 1] - y[j - 2] - u2 + u1
                    same, strangers = two_against_two(r, shift, u2, a2, a1, inv_b[j - 1], inv_b[j], s.density, t, f)
                    w = total[o2 + j - 2] * q2 * (same * displaced(i, j, band, ev) + strangers)
                    v = max(v, w) if best else v + w
            if l3 <= j - 1 <= h3:
                r = y[j] - y[j - 1] - u3
                if abs(r) < f[3]:
                    w = total[o3 + j - 1] * q3 * against_three(r, inv_b[j], a3, a2, a1, t.missed_b, t.again, t.false_a, f)
                    w *= joint_at(ev.joint, band, i - 2, j) if joints else 1.0
                    v = max(v, w) if best else v + w
            if welds:
                v *= ev.weld[o0 + j]
            total[o0 + j] = v
            top = max(top, v)
        if top <= 0.0:
            top = 1.0
        norm[i] = top
        log_scale[i] = np.log(top) + (log_scale[i - 1] if i > 0 else 0.0)
        _close_row(i, band, t, top, total, opened, column, pointer, count, best)
        before *= t.reroute_more / top
    return total, norm, log_scale, _log_total(total, log_scale, band, m, t, best)


@njit(cache=True, error_model="numpy")
def _cuts_into(i, x, y, fresh, closing, low, offset, high, table, total, norm, column, pointer, count, cuts, best):
    """Weights of the cut-outs that end in row i, by column of the band."""
    unit, first, last = 1.0, low[i], high[i]
    for a in range(1, min(LONGEST_CUT, i) + 1):
        r = (i - a) % (LONGEST_CUT + 1)
        o = offset[i - a] - low[i - a]
        for c in range(count[r]):
            j0, j = column[r, c], pointer[r, c]
            aim = y[j0] + x[i] - x[i - a]
            while j < y.size and y[j] < aim - FIT_M:
                j += 1
            pointer[r, c] = j
            while j <= last and y[j] <= aim + FIT_M:
                if j >= first and j > j0:
                    new = move_cut(y[j] - aim, a, j - j0, fresh[j] - fresh[j0], closing[j] - closing[j0], table)
                    w = total[o + j0] * unit * new
                    cuts[j - first] = max(cuts[j - first], w) if best else cuts[j - first] + w
                j += 1
        unit /= norm[i - a]


@njit(cache=True, error_model="numpy")
def _close_row(i, band, t, top, total, opened, column, pointer, count, best):
    """Bring row i to its unit, open a re-route at each of its cells, and note the cells from which a cut-out may begin."""
    low, high, o = span(band, i)
    r = i % (LONGEST_CUT + 1)
    count[r] = 0
    for j in range(low, high + 1):
        v = total[o + j] / top
        total[o + j] = v
        open_ = opened[j] / top
        opened[j] = t.reroute_more * (max(open_, v) if best else open_ + v)
        if v > MATTERS:
            column[r, count[r]], pointer[r, count[r]] = j, j
            count[r] += 1


@njit(cache=True, error_model="numpy")
def _log_total(total, log_scale, band, m, t, best):
    """Logarithm of the sum over all cells, or of the best, in which an alignment may end."""
    n = band.low.size
    top, rest = -np.inf, 0.0
    for i in range(n):
        low, high, o = span(band, i)
        v = 0.0
        for j in range(low if n - 1 - i <= MOST_LOOSE else max(m - 1, low), high + 1):
            w = total[o + j] * begin(n - 1 - i, m - 1 - j, t)
            v = max(v, w) if best else v + w
        if v <= 0.0:
            continue
        v = np.log(v) + log_scale[i]
        if v > top:
            rest, top = rest * np.exp(top - v) + 1.0, v
        else:
            rest += np.exp(v - top)
    return top if best else top + np.log(rest)


@njit(cache=True, error_model="numpy")
def behind(s, band, t, ev, total, norm, log_scale, log_total, best):
    """Posterior of every cell of the band; with ``best``, the best alignment through each over the best of all.

    Returns
    -------
    match : (cells) for weld i of A and weld j of B being one, a displaced weld included.
    shifted : (cells) the part of it in which the weld is displaced.
    """
    n, m = s.x.size, s.y.size
    x, y, inv_a, inv_b, shared = s.x, s.y, s.inv_a, s.inv_b, s.shared
    last = shared.size - 1
    f, table = noise(t), cut_table(s, t)
    match, shifted = np.zeros(band.offset[n]), np.zeros(band.offset[n], np.float32)
    ring = LONGEST_CUT + 1
    width = (band.high - band.low).max() + 1
    rest = np.zeros((ring, width))  # what lies behind each cell, its own evidence counted; row modulo ring
    closed, after, folded = np.zeros(m), 0.0, band.high[n - 1]  # re-routes that end at each column, and at all behind the band
    joints, welds = ev.joint.size > 0, ev.weld.size > 0
    for i in range(n - 1, -1, -1):
        q1 = 1.0 / norm[i + 1] if i + 1 < n else 0.0
        q2 = q1 / norm[i + 2] if i + 2 < n else 0.0
        q3 = q2 / norm[i + 3] if i + 3 < n else 0.0
        low, high, o0 = span(band, i)
        l1, h1, o1 = span(band, i + 1)
        l2, h2, _ = span(band, i + 2)
        l3, h3, _ = span(band, i + 3)
        r0, r1, r2, r3 = i % ring, (i + 1) % ring, (i + 2) % ring, (i + 3) % ring
        may_end = i == n - 1 or high == m - 1 or n + m - 2 - i - high <= MOST_LOOSE
        stop = np.exp(min(log_scale[i] - log_total, 600.0)) if may_end else 0.0
        while folded > high:
            after = t.reroute_more * (max(after, closed[folded]) if best else after + closed[folded])
            folded -= 1
        close = after
        u1 = x[min(i + 1, n - 1)] - x[i]
        u2, u3 = x[min(i + 2, n - 1)] - x[i], x[min(i + 3, n - 1)] - x[i]
        a1, a2, a3 = inv_a[min(i + 1, n - 1)], inv_a[min(i + 2, n - 1)], inv_a[min(i + 3, n - 1)]
        for j in range(high, low - 1, -1):
            v = stop * begin(n - 1 - i, m - 1 - j, t) if may_end else 0.0
            if j < high:
                close = t.reroute_more * (max(close, closed[j + 1]) if best else close + closed[j + 1])
            w = t.reroute * close
            v = max(v, w) if best else v + w
            if l1 <= j + 1 <= h1:
                r = y[j + 1] - y[j] - u1
                w = rest[r1, j + 1 - l1] * q1 * t.same * fit(r, f)
                w *= shared[min(int((u1 + 0.5 * r) / BIN), last)] * a1 * inv_b[j + 1]
                if joints:
                    w *= ev.joint[o1 + j + 1]
                v = max(v, w) if best else v + w
            if l1 <= j + 2 <= h1:
                r = y[j + 2] - y[j] - u1
                if abs(r) < f[3]:
                    w = rest[r1, j + 2 - l1] * q1 * against_two(r, a1, inv_b[j + 1], inv_b[j + 2], t.missed_a, t.false_b, f)
                    w *= joint_at(ev.joint, band, i + 1, j + 1) if joints else 1.0
                    v = max(v, w) if best else v + w
            if l1 <= j + 3 <= h1:
                r = y[j + 3] - y[j] - u1
                if abs(r) < f[3]:
                    w = against_three(r, a1, inv_b[j + 1], inv_b[j + 2], inv_b[j + 3], t.missed_a, t.again, t.false_b, f)
                    w *= rest[r1, j + 3 - l1] * q1 * (joint_at(ev.joint, band, i + 1, j + 1) if joints else 1.0)
                    v = max(v, w) if best else v + w
            if l2 <= j + 1 <= h2:
                r = y[j + 1] - y[j] - u2
                if abs(r) < f[3]:
                    w = rest[r2, j + 1 - l2] * q2 * against_two(r, inv_b[j + 1], a1, a2, t.missed_b, t.false_a, f)
                    w *= joint_at(ev.joint, band, i + 1, j + 1) if joints else 1.0
                    v = max(v, w) if best else v + w
            if l2 <= j + 2 <= h2:
                r = y[j + 2] - y[j] - u2
                if abs(r) < f[3]:
                    shift = y[j + 1] - y[j] - u1
                    same, strangers = two_against_two(r, shift, u2, a1, a2, inv_b[j + 1], inv_b[j + 2], s.density, t, f)
                    w = rest[r2, j + 2 - l2] * q2
                    same *= displaced(i + 2, j + 2, band, ev)
                    if l1 <= j + 1 <= h1:
                        part = np.float32(total[o0 + j] * w * same)
                        shifted[o1 + j + 1] = max(shifted[o1 + j + 1], part) if best else shifted[o1 + j + 1] + part
                    w *= same + strangers
                    v = max(v, w) if best else v + w
            if l3 <= j + 1 <= h3:
                r = y[j + 1] - y[j] - u3
                if abs(r) < f[3]:
                    w = rest[r3, j + 1 - l3] * q3 * against_three(r, inv_b[j + 1], a1, a2, a3, t.missed_b, t.again, t.false_a, f)
                    w *= joint_at(ev.joint, band, i + 1, j + 1) if joints else 1.0
                    v = max(v, w) if best else v + w
            if total[o0 + j] > MATTERS:
                w = _cuts_from(i, j, x, y, s.fresh, s.closing, band.low, band.high, table, norm, rest, best)
                v = max(v, w) if best else v + w
            match[o0 + j] = total[o0 + j] * v
            rest[r0, j - low] = v * ev.weld[o0 + j] if welds else v
        unit = 1.0 / norm[i]  # of this row in the row before
        for j in range(low, high + 1):
            close = max(closed[j], rest[r0, j - low]) if best else closed[j] + rest[r0, j - low]
            closed[j] = t.reroute_more * unit * close
        after *= t.reroute_more * unit
    for k in range(match.size):
        match[k] = max(match[k], np.float64(shifted[k])) if best else min(match[k] + shifted[k], 1.0)
    return match, shifted


@njit(cache=True, error_model="numpy")
def _cuts_from(i, j0, x, y, fresh, closing, low, high, table, norm, rest, best):
    """Weight of everything behind the cut-outs that begin at (i, j0)."""
    v, unit, j = 0.0, 1.0, j0
    for a in range(1, min(LONGEST_CUT, x.size - 1 - i) + 1):
        unit /= norm[i + a]
        aim = y[j0] + x[i + a] - x[i]
        while j < y.size and y[j] < aim - FIT_M:
            j += 1
        k = j
        while k <= high[i + a] and y[k] <= aim + FIT_M:
            if k >= low[i + a] and k > j0:
                new = move_cut(y[k] - aim, a, k - j0, fresh[k] - fresh[j0], closing[k] - closing[j0], table)
                w = rest[(i + a) % rest.shape[0], k - low[i + a]] * unit * new
                v = max(v, w) if best else v + w
            k += 1
    return v
