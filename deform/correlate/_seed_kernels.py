"""Two weld lists in, places where a sequence of joint lengths occurs in both out: the jitted search for seeds."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def search(x, y, starts, first, last, k, least_scale, most_scale, tolerance, most_hits):
    """Find windows of ``k`` joints of A in B.

    Parameters
    ----------
    x, y : weld places of A and B, metre, rising.
    starts : first weld of each window of A (w).
    first, last : first and last weld of B at which each window may begin (w).
    least_scale, most_scale : bounds of the scale of B against A (w).
    tolerance : largest difference of a joint's length after the window's own scale, metre.
    most_hits : a window that occurs more often says nothing and is left out.

    Returns
    -------
    window, j, scale, misfit : one entry per occurrence; misfit is the root mean square difference, metre.
    """
    w, h = starts.size, 0
    window = np.empty(w * most_hits, np.int64)
    place = np.empty(w * most_hits, np.int64)
    scale = np.empty(w * most_hits)
    misfit = np.empty(w * most_hits)
    for q in range(w):
        i, found = starts[q], 0
        length = x[i + k] - x[i]
        shortest, longest = least_scale[q] * length, most_scale[q] * length
        for j in range(max(first[q], 0), min(last[q], y.size - k - 1) + 1):
            whole = y[j + k] - y[j]
            if whole < shortest or whole > longest:
                continue
            s, total = whole / length, 0.0
            for c in range(k):
                r = y[j + c + 1] - y[j + c] - s * (x[i + c + 1] - x[i + c])
                if abs(r) > tolerance:
                    total = -1.0
                    break
                total += r * r
            if total < 0.0:
                continue
            if found < most_hits:
                window[h + found], place[h + found], scale[h + found], misfit[h + found] = q, j, s, np.sqrt(total / k)
            found += 1
            if found > most_hits:
                break
        if found <= most_hits:
            h += found
    return window[:h], place[:h], scale[:h], misfit[:h]


@njit(cache=True, error_model="numpy")
def heaviest_chain(i, j, weight, m):
    """Heaviest subset that rises strictly in i and in j; entries sorted by i, then by j falling. Returns their indices.

    A Fenwick tree over j holds the best chain that ends at or before each j: n log m.
    """
    n = i.size
    best = np.zeros(n)
    before = np.full(n, -1, np.int64)
    tree = np.full(m + 1, -1, np.int64)
    top = -1
    for e in range(n):
        value, link = 0.0, -1
        p = j[e]  # tree places 1..m hold j = 0..m-1; ask for all j smaller than this one
        while p > 0:
            t = tree[p]
            if t >= 0 and best[t] > value:
                value, link = best[t], t
            p -= p & -p
        best[e], before[e] = value + weight[e], link
        p = j[e] + 1
        while p <= m:
            t = tree[p]
            if t < 0 or best[t] < best[e]:
                tree[p] = e
            p += p & -p
        if top < 0 or best[e] > best[top]:
            top = e
    count, e = 0, top
    while e >= 0:
        count += 1
        e = before[e]
    chain = np.empty(count, np.int64)
    e = top
    for c in range(count - 1, -1, -1):
        chain[c] = e
        e = before[e]
    return chain
