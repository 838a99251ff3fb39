"""Naive twin of the weld alignment: the whole matrix, every move written out, plain Python, nothing scaled, nothing banded."""

from __future__ import annotations

import math

import numpy as np

FEW = [(1, 1), (1, 2), (2, 1), (1, 3), (3, 1), (2, 2)]


def student(r, sigma, shape):
    """Student's t with 2 ** (shape + 1) - 1 degrees of freedom."""
    nu = 2.0 ** (shape + 1) - 1.0
    peak = math.gamma(0.5 * (nu + 1.0)) / math.gamma(0.5 * nu) / math.sqrt(math.pi * nu)
    return peak / sigma / (1.0 + r * r / (nu * sigma * sigma)) ** (0.5 * (nu + 1.0))


class Twin:
    """Two lists of places, densities as functions of a length, rates, and hints as functions of a cell."""

    def __init__(self, x, y, density, shared, fresh, slack, t, weld=lambda i, j: 1.0, joint=lambda i, j: 1.0):
        self.x, self.y, self.density, self.shared, self.fresh = x, y, density, shared, fresh
        self.slack, self.t, self.weld, self.joint = slack, t, weld, joint

    def few(self, a, b, i, j):
        """Weights (the weld between them displaced, all else) of a joints of A against b of B that end at (i, j)."""
        t, x, y = self.t, self.x, self.y
        la = [x[i - k] - x[i - k - 1] for k in range(a)][::-1]
        lb = [y[j - k] - y[j - k - 1] for k in range(b)][::-1]
        r = sum(lb) - sum(la)
        f = student(r, t.sigma, t.shape)
        ga, gb = [self.density(v) for v in la], [self.density(v) for v in lb]
        if (a, b) == (1, 1):
            return 0.0, t.same * f * self.shared(0.5 * (la[0] + lb[0])) / (ga[0] * gb[0]) * self.joint(i, j)
        if abs(r) >= 15 * t.sigma:
            return 0.0, 0.0
        first = self.joint(i - a + 1, j - b + 1)
        if a == 1:
            return 0.0, f * self.split(ga[0], gb, t.missed_a, t.again, t.false_b) * first
        if b == 1:
            return 0.0, f * self.split(gb[0], ga, t.missed_b, t.again, t.false_a) * first
        shift = lb[0] - la[0]
        cauchy = 1.0 / (math.pi * t.shift_m * (1.0 + (shift / t.shift_m) ** 2))
        same = f * t.shifted * cauchy / math.sqrt(ga[0] * ga[1] * gb[0] * gb[1])
        same *= first * self.joint(i, j) * self.weld(i - 1, j - 1)
        each_missed_one = t.missed_a * t.missed_b * self.density(abs(shift))
        each_missed_one /= (ga[1] * gb[0]) if shift > 0 else (ga[0] * gb[1])
        one_false = t.missed_a * t.false_a / (ga[0] * ga[1]) + t.missed_b * t.false_b / (gb[0] * gb[1])
        both_false = t.false_a * t.false_b * self.density(sum(la)) / (ga[0] * ga[1] * gb[0] * gb[1])
        return same, f * (each_missed_one + one_false + both_false)

    @staticmethod
    def split(g_whole, pieces, missed, again, false):
        """One joint against its pieces: each weld between them missed, or false."""
        k = len(pieces) - 1
        real = (missed if k == 1 else missed * again) / g_whole  # misses come in pairs
        none = math.factorial(k) * false**k / math.prod(pieces)
        mixed = missed * false / g_whole * (1.0 / pieces[0] + 1.0 / pieces[2]) if k == 2 else 0.0
        return real + none + mixed

    def cut(self, a, b, i, j):
        """Weight of a joints replaced by b of the same length, ending at (i, j)."""
        r = (self.y[j] - self.y[j - b]) - (self.x[i] - self.x[i - a])
        if abs(r) > 6.0 or not 4 <= a + b <= 32 or a > 16:
            return 0.0
        new = [self.y[j - k] - self.y[j - k - 1] for k in range(b)]
        odds = math.prod(self.fresh(v) / self.density(v) for v in new)
        closing = sum(min(1.0 / self.fresh(v), 60.0) for v in new) / b
        kept = 0.9 * student(r, self.slack[a + b], 2) + 0.1 / (math.pi * (1.0 + r * r))
        return self.t.cut * (1.0 - self.t.cut_more) * self.t.cut_more ** (a - 1) * odds * closing * kept

    def edge(self, i, j):
        """Weight of an alignment that begins (or ends) i and j welds from the ends of the lists."""
        return 1.0 if i == 0 or j == 0 else self.t.ends * self.t.reroute_more ** (i + j)

    def moves(self):
        """All moves: from, to, weight with the weld between displaced, weight of all else, whether it is a cut-out."""
        n, m, t = len(self.x), len(self.y), self.t
        for i in range(n):
            for j in range(m):
                for i0 in range(i):
                    for j0 in range(j):
                        a, b = i - i0, j - j0
                        yield (i0, j0), (i, j), 0.0, t.reroute * t.reroute_more ** (a + b), False
                        if (a, b) in FEW:
                            yield (i0, j0), (i, j), *self.few(a, b, i, j), False
                        w = self.cut(a, b, i, j)
                        if w > 0.0:
                            yield (i0, j0), (i, j), 0.0, w, True


def alignments(twin: Twin, matters: float):
    """Weight of all alignments, posterior of every pair, part of it displaced, weight of the best, best through every pair.

    A cell with less than ``matters`` of the largest weight in its row begins no cut-out.
    """
    n, m = len(twin.x), len(twin.y)
    moves = list(twin.moves())
    into: dict = {}
    for move in moves:
        into.setdefault(move[1], []).append(move)
    last = {(i, j): twin.edge(n - 1 - i, m - 1 - j) for i in range(n) for j in range(m)}

    def sweep(join):
        f = np.zeros((n, m))
        for i in range(n):
            for j in range(m):
                parts = [twin.edge(i, j)]
                for start, _, same, other, cut in into.get((i, j), []):
                    if not cut or f[start] > matters * f[start[0]].max():
                        parts.append(f[start] * (same + other))
                f[i, j] = join(parts) * twin.weld(i, j)
        rest, shifted = np.zeros((n, m)), np.zeros((n, m))
        total = join([f[c] * last[c] for c in last])
        behind = {c: [last[c]] for c in last}
        for i in range(n - 1, -1, -1):
            for j in range(m - 1, -1, -1):
                rest[i, j] = join(behind[i, j])
                for start, _, same, other, cut in into.get((i, j), []):
                    if not cut or f[start] > matters * f[start[0]].max():
                        after = twin.weld(i, j) * rest[i, j]
                        behind[start].append((same + other) * after)
                        if same > 0.0:
                            at = (i - 1, j - 1)
                            shifted[at] = join([shifted[at], f[start] * same * after / total])
        return total, f * rest / total, shifted

    total, match, shifted = sweep(sum)
    best, through, displaced = sweep(max)
    return total, match + shifted, shifted, best, np.maximum(through, displaced)
