"""Dense least-squares twin of the drift between two runs: obviously right, cubic in the number of nodes."""

from __future__ import annotations

import numpy as np


def smooth(place, tangent, right, lift, value, noise, used, walk):
    """Return drift (n, 3) and its variance (n, 3) from one dense least-squares problem over all states of all nodes."""
    n = len(place)
    size = 6 * n
    normal, side = np.zeros((size, size)), np.zeros(size)
    normal[:6, :6] += np.diag([1e-6] * 3 + [1e2] * 3)
    for k in range(n):
        if used[k]:
            for m in range(3):
                normal[6 * k + m, 6 * k + m] += 1.0 / noise[k, m]
                side[6 * k + m] += value[k, m] / noise[k, m]
    for k in range(1, n):
        ds = place[k] - place[k - 1]
        f = np.column_stack([right[k - 1], lift[k - 1], tangent[k - 1]]) * ds
        step = np.eye(6)
        step[:3, 3:] = f
        shock = np.zeros((6, 6))
        shock[:3, :3] = f @ np.diag(walk) @ f.T * ds / 3.0
        shock[:3, 3:] = f @ np.diag(walk) * ds / 2.0
        shock[3:, :3] = shock[:3, 3:].T
        shock[3:, 3:] = np.diag(walk) * ds
        weight = np.linalg.inv(shock)
        rows = np.hstack([-step, np.eye(6)])
        block = slice(6 * (k - 1), 6 * (k + 1))
        normal[block, block] += rows.T @ weight @ rows
    cover = np.linalg.inv(normal)
    state = cover @ side
    return state.reshape(n, 6)[:, :3], np.diag(cover).reshape(n, 6)[:, :3]
