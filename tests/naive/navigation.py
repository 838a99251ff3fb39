"""Plain numpy twins of the navigation's kernels: slow, short, right by looking at them."""

from __future__ import annotations

import numpy as np

from deform.geometry.rotation import rotation_vector_to_matrix
from deform.nav import _kernels as k


def preintegrate(counts, distance, first, last):
    """One row of the table of epochs."""
    table = counts.table
    gyro = counts.gyro[first : last + 1] * counts.gyro_pulse @ table[9:12].T
    accel = counts.accel[first : last + 1] * counts.accel_pulse @ table[12:15].T
    if first == 0:
        gyro[0] = accel[0] = 0.0
    R, V, P, A, G, Sg, Sa = (
        np.eye(3),
        np.zeros(3),
        np.zeros(3),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
    )
    turn_shear, force_shear = np.zeros((3, 3)), np.zeros((3, 5))
    for i in range(1, last - first + 1):
        dt = counts.time[first + i] - counts.time[first + i - 1]
        ds = distance[first + i] - distance[first + i - 1]
        g, a, p, b = gyro[i], accel[i], gyro[i - 1], accel[i - 1]
        push = R @ (a + 0.5 * np.cross(g, a) + np.cross(g, np.cross(g, a)) / 6.0 + (np.cross(p, a) + np.cross(b, g)) / 12.0)
        P, V = P + dt * (V + 0.5 * push), V + push
        Sg, Sa = Sg + R * g, Sa + R * a
        turn_shear += R @ np.array([[0, 0, g[2]], [g[0], g[2], 0], [0, 0, 0]])
        force_shear += R @ np.array([[a[2], 0, 0, a[1], 0], [0, a[0], a[2], 0, 0], [a[0], 0, 0, 0, a[1]]])
        following = R @ rotation_vector_to_matrix(g + np.cross(p, g) / 12.0)
        A, G, R = A + 0.5 * dt * (R + following), G + 0.5 * ds * (R + following), following
    row = np.zeros(k.COLUMNS)
    row[: k.DURATION] = np.concatenate([R.ravel(), V, P, A.ravel(), G.ravel(), Sg.ravel(), Sa.ravel()])
    row[k.DURATION], row[k.TRAVEL] = counts.time[last] - counts.time[first], distance[last] - distance[first]
    row[k.SENSE] = 1.0
    row[k.TURN_BY_SHEAR : k.TURN_BY_SHEAR + 9] = turn_shear.ravel()
    row[k.FORCE_BY_SHEAR : k.FORCE_BY_SHEAR + 15] = force_shear.ravel()
    return row


def rauch_tung_striebel(states, filtered, predicted, transitions):
    """Smoothed errors and covariances of a linear filter: states (k, n), P behind and before them, Φ."""
    x, P = [states[-1]], [filtered[-1]]
    for i in range(len(states) - 2, -1, -1):
        gain = filtered[i] @ transitions[i].T @ np.linalg.inv(predicted[i + 1])
        x.insert(0, states[i] + gain @ (x[0] - transitions[i] @ states[i]))
        P.insert(0, filtered[i] + gain @ (P[0] - predicted[i + 1]) @ gain.T)
    return np.array(x), np.array(P)
