"""Two lists, a band, rates and evidence in, the weights of all alignments, or of the best, over the band out.

A cell (i, j) means: weld i of A and weld j of B are one weld. Weights are linear, with one unit per row, so that no logarithm
stands in a loop. With ``best`` each sum becomes the larger of its terms. Three kinds of move end in a cell: those of a few welds;
a cut-out of up to `LONGEST_CUT` listed joints, looked for only where its length is kept, from cells that matter in their row; and
a re-route of any size, which costs the same per joint of either run, so that one running sum over rows and columns holds them all.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from deform.correlate._kernel_moves import (
    _FIT_M,
    begin,
    displaced,
    joint_at,
    move_11,
    move_12,
    move_13,
    move_21,
    move_22,
    move_31,
    move_cut,
    noise,
    span,
)
from deform.correlate._kernel_types import LONGEST_CUT

MATTERS = 1e-10  # of the row's largest weight; a cell with less begins no cut-out


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
    f = noise(t)
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
        start = np.exp(-max(log_scale[i - 1], -600.0)) if i > 0 else 1.0
        while folded < low:
            before = t.reroute_more * (max(before, opened[folded]) if best else before + opened[folded])
            folded += 1
        _cuts_into(i, s, band, t, total, norm, column, pointer, count, cuts, best)
        open_, top = before, 0.0
        for j in range(low, high + 1):
            v = cuts[j - low]
            cuts[j - low] = 0.0
            w = start * begin(i, j, t)
            v = max(v, w) if best else v + w
            if j > low:
                open_ = t.reroute_more * (max(open_, opened[j - 1]) if best else open_ + opened[j - 1])
            w = t.reroute * open_
            v = max(v, w) if best else v + w
            if l1 <= j - 1 <= h1:
                w = total[o1 + j - 1] * move_11(i, j, s, t, f)
                if joints:
                    w *= ev.joint[o0 + j]
                v = max(v, w) if best else v + w
            if l1 <= j - 2 <= h1:
                w = total[o1 + j - 2] * move_12(i, j, s, t, f)
                if joints and w > 0.0:
                    w *= joint_at(ev.joint, band, i, j - 1)
                v = max(v, w) if best else v + w
            if l1 <= j - 3 <= h1:
                w = total[o1 + j - 3] * move_13(i, j, s, t, f)
                if joints and w > 0.0:
                    w *= joint_at(ev.joint, band, i, j - 2)
                v = max(v, w) if best else v + w
            if l2 <= j - 1 <= h2:
                w = total[o2 + j - 1] * q2 * move_21(i, j, s, t, f)
                if joints and w > 0.0:
                    w *= joint_at(ev.joint, band, i - 1, j)
                v = max(v, w) if best else v + w
            if l2 <= j - 2 <= h2:
                same, strangers = move_22(i, j, s, t, f)
                if same > 0.0:
                    same *= displaced(i, j, band, ev)
                w = total[o2 + j - 2] * q2 * (same + strangers)
                v = max(v, w) if best else v + w
            if l3 <= j - 1 <= h3:
                w = total[o3 + j - 1] * q3 * move_31(i, j, s, t, f)
                if joints and w > 0.0:
                    w *= joint_at(ev.joint, band, i - 2, j)
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
def _cuts_into(i, s, band, t, total, norm, column, pointer, count, cuts, best):
    """Weights of the cut-outs that end in row i, by column of the band."""
    low, high, _ = span(band, i)
    unit, y = 1.0, s.y
    for a in range(1, min(LONGEST_CUT, i) + 1):
        r = (i - a) % (LONGEST_CUT + 1)
        _, _, o = span(band, i - a)
        shift = s.x[i] - s.x[i - a]
        for c in range(count[r]):
            j0, j = column[r, c], pointer[r, c]
            least = y[j0] + shift - _FIT_M
            while j < y.size and y[j] < least:
                j += 1
            pointer[r, c] = j
            while j < y.size and y[j] <= least + 2.0 * _FIT_M:
                if low <= j <= high and j > j0:
                    w = total[o + j0] * unit * move_cut(i - a, j0, i, j, s, t)
                    cuts[j - low] = max(cuts[j - low], w) if best else cuts[j - low] + w
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
        for j in range(low if n - 1 - i < 400 else max(m - 1, low), high + 1):
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
    f = noise(t)
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
        l2, h2, o2 = span(band, i + 2)
        l3, h3, _ = span(band, i + 3)
        r0, r1, r2, r3 = i % ring, (i + 1) % ring, (i + 2) % ring, (i + 3) % ring
        stop = np.exp(min(log_scale[i] - log_total, 600.0))
        while folded > high:
            after = t.reroute_more * (max(after, closed[folded]) if best else after + closed[folded])
            folded -= 1
        close = after
        for j in range(high, low - 1, -1):
            v = stop * begin(n - 1 - i, m - 1 - j, t)
            if j < high:
                close = t.reroute_more * (max(close, closed[j + 1]) if best else close + closed[j + 1])
            w = t.reroute * close
            v = max(v, w) if best else v + w
            if l1 <= j + 1 <= h1:
                w = rest[r1, j + 1 - l1] * q1 * move_11(i + 1, j + 1, s, t, f)
                if joints:
                    w *= ev.joint[o1 + j + 1]
                v = max(v, w) if best else v + w
            if l1 <= j + 2 <= h1:
                w = rest[r1, j + 2 - l1] * q1 * move_12(i + 1, j + 2, s, t, f)
                if joints and w > 0.0:
                    w *= joint_at(ev.joint, band, i + 1, j + 1)
                v = max(v, w) if best else v + w
            if l1 <= j + 3 <= h1:
                w = rest[r1, j + 3 - l1] * q1 * move_13(i + 1, j + 3, s, t, f)
                if joints and w > 0.0:
                    w *= joint_at(ev.joint, band, i + 1, j + 1)
                v = max(v, w) if best else v + w
            if l2 <= j + 1 <= h2:
                w = rest[r2, j + 1 - l2] * q2 * move_21(i + 2, j + 1, s, t, f)
                if joints and w > 0.0:
                    w *= joint_at(ev.joint, band, i + 1, j + 1)
                v = max(v, w) if best else v + w
            if l2 <= j + 2 <= h2:
                w = rest[r2, j + 2 - l2] * q2
                same, strangers = move_22(i + 2, j + 2, s, t, f)
                if same > 0.0:
                    same *= displaced(i + 2, j + 2, band, ev)
                if l1 <= j + 1 <= h1:
                    part = np.float32(total[o0 + j] * w * same)
                    shifted[o1 + j + 1] = max(shifted[o1 + j + 1], part) if best else shifted[o1 + j + 1] + part
                w *= same + strangers
                v = max(v, w) if best else v + w
            if l3 <= j + 1 <= h3:
                w = rest[r3, j + 1 - l3] * q3 * move_31(i + 3, j + 1, s, t, f)
                if joints and w > 0.0:
                    w *= joint_at(ev.joint, band, i + 1, j + 1)
                v = max(v, w) if best else v + w
            if total[o0 + j] > MATTERS:
                w = _cuts_from(i, j, s, band, t, norm, rest, best)
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
def _cuts_from(i, j0, s, band, t, norm, rest, best):
    """Weight of everything behind the cut-outs that begin at (i, j0)."""
    v, unit, y, j = 0.0, 1.0, s.y, j0
    for a in range(1, min(LONGEST_CUT, s.x.size - 1 - i) + 1):
        unit /= norm[i + a]
        low, high, _ = span(band, i + a)
        least = y[j0] + s.x[i + a] - s.x[i] - _FIT_M
        while j < y.size and y[j] < least:
            j += 1
        k = j
        while k < y.size and y[k] <= least + 2.0 * _FIT_M:
            if low <= k <= high and k > j0:
                w = rest[(i + a) % rest.shape[0], k - low] * unit * move_cut(i, j0, i + a, k, s, t)
                v = max(v, w) if best else v + w
            k += 1
    return v
