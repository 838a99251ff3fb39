"""Naive twin of the weld alignment: the whole matrix, every move written out, plain Python, nothing scaled, nothing banded."""

from __future__ import annotations

import math

import numpy as np

STATES = ("M", "D", "A", "B")


def t3(r, sigma):
    """Student's t with three degrees of freedom."""
    return 2.0 / (math.pi * math.sqrt(3.0) * sigma) / (1.0 + (r / sigma) ** 2 / 3.0) ** 2


def move_weight(a, b, i, j, x, y, g, g_at, t):
    """Weights (same welds in between, strangers in between) of a joints of A against b of B that end at (i, j).

    ``g`` gives the density at joint k of a list ('a' or 'b'), ``g_at`` at a length.
    """
    la = [x[i - k] - x[i - k - 1] for k in range(a)]
    lb = [y[j - k] - y[j - k - 1] for k in range(b)]
    r = sum(lb) - sum(la)
    f = t3(r, t.sigma)
    ga, gb = [g("a", i - k) for k in range(a)], [g("b", j - k) for k in range(b)]
    if (a, b) == (1, 1):
        return t.same * f / math.sqrt(ga[0] * gb[0]), 0.0
    if abs(r) > 15 * t.sigma:
        return 0.0, 0.0
    if (a, b) in ((1, 2), (1, 3)):
        return f * _split(sum(la), ga[0], gb, t.missed_a, t.false_b), 0.0
    if (a, b) in ((2, 1), (3, 1)):
        return f * _split(sum(lb), gb[0], ga, t.missed_b, t.false_a), 0.0
    shift = lb[1] - la[1]
    cauchy = 1.0 / (math.pi * t.shift_m * (1.0 + (shift / t.shift_m) ** 2))
    same = f * t.shifted * cauchy / math.sqrt(ga[0] * ga[1] * gb[0] * gb[1])
    whole = sum(la)
    # index 1 is the first joint, 0 the second
    each_missed_one = t.missed_a * t.missed_b * g_at(abs(shift)) / ((ga[0] * gb[1]) if shift > 0 else (ga[1] * gb[0]))
    one_false = t.missed_a * t.false_a / whole / (ga[0] * ga[1]) + t.missed_b * t.false_b / whole / (gb[0] * gb[1])
    both_false = t.false_a * t.false_b / whole**2 * g_at(whole) / (ga[0] * ga[1] * gb[0] * gb[1])
    return same, f * (each_missed_one + one_false + both_false)


def _split(whole, g_whole, pieces, missed, false):
    k = len(pieces) - 1
    real = missed**k / g_whole
    none = math.factorial(k) * (false / whole) ** k / math.prod(pieces)
    mixed = 0.0
    if k == 2:
        mixed = missed * false / whole / g_whole * (1.0 / pieces[0] + 1.0 / pieces[2])
    return real + none + mixed


def alignments(x, y, g, g_at, t, evidence=lambda i, j: 1.0, ending=lambda i, j: 1.0, traits=lambda i, j: 1.0):
    """Weight of all alignments, posterior of every pair, part of it displaced, weight of the best alignment."""
    n, m = len(x), len(y)
    moves = [(1, 1), (1, 2), (2, 1), (1, 3), (3, 1), (2, 2)]

    def weight(a, b, i, j):
        same, strangers = move_weight(a, b, i, j, x, y, g, g_at, t)
        if (a, b) == (2, 2):
            same *= evidence(i - 1, j - 1)
        if (a, b) == (1, 1):
            same *= traits(i - 1, j - 1)
        return same, strangers

    steps = [("M", "D", 1, 1, t.open_both), ("D", "D", 1, 1, t.extend)]
    for s, di, dj in (("A", 1, 0), ("B", 0, 1)):
        steps += [("D", s, di, dj, t.switch), (s, s, di, dj, t.extend_one)]

    close = {"D": t.close, "A": t.close_one, "B": t.close_one}

    def sweep(join):
        f = {s: np.zeros((n, m)) for s in STATES}
        for i in range(n):
            for j in range(m):
                begin = i == 0 or j == 0
                into = {s: [0.0] for s in STATES}
                if begin:
                    into["M"].append(1.0)
                    into["D"].append(t.open_both)
                for a, b, di, dj, w in steps:
                    if i >= di and j >= dj:
                        into[b].append(f[a][i - di, j - dj] * w)
                for a, b in moves:
                    if i >= a and j >= b:
                        into["M"].append(f["M"][i - a, j - b] * sum(weight(a, b, i, j)))
                for s in "DAB":
                    f[s][i, j] = join(into[s])
                into["M"] += [close[s] * ending(i, j) * f[s][i, j] for s in "DAB"]
                f["M"][i, j] = join(into["M"]) * evidence(i, j)
        ends = [f[s][i, j] for s in STATES for i in range(n) for j in range(m) if i == n - 1 or j == m - 1]
        return f, join(ends)

    f, total = sweep(sum)
    _, best = sweep(max)
    rest = {s: np.zeros((n, m)) for s in STATES}
    shifted = np.zeros((n, m))
    for i in range(n - 1, -1, -1):
        for j in range(m - 1, -1, -1):
            out = dict.fromkeys(STATES, 1.0 if i == n - 1 or j == m - 1 else 0.0)
            for a, b, di, dj, w in steps:
                if i + di < n and j + dj < m:
                    out[a] += w * rest[b][i + di, j + dj]
            for a, b in moves:
                if i + a < n and j + b < m:
                    same, strangers = weight(a, b, i + a, j + b)
                    after = rest["M"][i + a, j + b] * evidence(i + a, j + b)
                    out["M"] += (same + strangers) * after
                    if (a, b) == (2, 2):
                        shifted[i + 1, j + 1] += f["M"][i, j] * same * after / total
            rest["M"][i, j] = out["M"]
            for s in "DAB":
                rest[s][i, j] = out[s] + close[s] * ending(i, j) * evidence(i, j) * out["M"]
    match = f["M"] * rest["M"] / total + shifted
    return total, match, shifted, best
