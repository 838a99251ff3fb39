"""Numba kernels of the wobble as a chain of states: what drives it, itself and its mean led over an epoch, and taken back."""

from __future__ import annotations

from numba import njit

from deform.nav._kernels import TRAVEL
from deform.nav._kernels_state import B_MEAN, B_SWAY, B_WOBBLE, MEAN, WOBBLE


@njit(cache=True, error_model="numpy")
def follow_rows(F, at, follows, recalls):
    """Rows F of a transition become those that act behind `drive_wobble`."""
    w, u, m = at[B_WOBBLE], at[B_SWAY], at[B_MEAN]
    for i in range(follows.size):
        for r in range(F.shape[0]):
            F[r, w + i] -= recalls[i % 2] * F[r, m + i % 2]
            F[r, u + i] -= follows[i] * F[r, w + i]


@njit(cache=True, error_model="numpy")
def drive_wobble(P, at, follows, recalls):
    """Covariance when the mean has taken its part of the wobble, and the wobble its part of what drives it."""
    w, u, m = at[B_WOBBLE], at[B_SWAY], at[B_MEAN]
    for i in range(follows.size):
        for j in range(P.shape[0]):
            P[m + i % 2, j] += recalls[i % 2] * P[w + i, j]
            P[w + i, j] += follows[i] * P[u + i, j]
    for i in range(follows.size):
        for j in range(P.shape[0]):
            P[j, m + i % 2] += recalls[i % 2] * P[j, w + i]
            P[j, w + i] += follows[i] * P[j, u + i]


@njit(cache=True, error_model="numpy")
def adjoint_drive_wobble(adjoint, information, at, follows, recalls):
    """Take `drive_wobble` back."""
    w, u, m = at[B_WOBBLE], at[B_SWAY], at[B_MEAN]
    for i in range(follows.size):
        adjoint[u + i] += follows[i] * adjoint[w + i]
        adjoint[w + i] += recalls[i % 2] * adjoint[m + i % 2]
        for j in range(adjoint.size):
            information[u + i, j] += follows[i] * information[w + i, j]
            information[w + i, j] += recalls[i % 2] * information[m + i % 2, j]
    for i in range(follows.size):
        for j in range(adjoint.size):
            information[j, u + i] += follows[i] * information[j, w + i]
            information[j, w + i] += recalls[i % 2] * information[j, m + i % 2]


@njit(cache=True, error_model="numpy")
def share_noise(P, at, shared):
    """Add the noise that each state of the wobble shares with the one that drives it."""
    w, u = at[B_WOBBLE], at[B_SWAY]
    for i in range(shared.size):
        P[w + i, u + i] += shared[i]
        P[u + i, w + i] += shared[i]


@njit(cache=True, error_model="numpy")
def lead_errors(dx, F, decay, follows, recalls, at, led):
    """Lead errors over an epoch as `drive_wobble` and `predict` lead their covariance."""
    full = F.shape[0]
    w, u, m = at[B_WOBBLE], at[B_SWAY], at[B_MEAN]
    for i in range(follows.size):
        dx[m + i % 2] += recalls[i % 2] * dx[w + i]
        dx[w + i] += follows[i] * dx[u + i]
    for i in range(dx.size):
        led[i] = decay[i] * dx[i]
    for i in range(full):
        led[i] = 0.0
        for j in range(dx.size):
            led[i] += F[i, j] * dx[j]
    dx[:] = led


@njit(cache=True, error_model="numpy")
def slope_of_mean(x, P, adjoint, information, at, row, F, decay, reach, follows, recalls, v, led, recalled):
    """Add to ``recalled`` (2,) the slope of the log-likelihood to the logarithm of the length of the wobble's mean, right and up.

    The mean m goes to d m + (1 - d) w, d = exp(-s / length): its slope to d is that of the state along m - w.
    """
    n, m, first = adjoint.size, at[B_MEAN], at[B_WOBBLE]
    for c in range(2):
        known = x[MEAN + c]
        for j in range(n):
            v[j] = P[m + c, j]
        for i in range(c, follows.size, 2):
            known -= x[WOBBLE + i]
            for j in range(n):
                v[j] -= P[first + i, j]
        lead_errors(v, F, decay, follows, recalls, at, led)
        total = -adjoint[m + c] * known
        for j in range(n):
            total += (adjoint[m + c] * adjoint[j] - information[m + c, j]) * v[j]
        recalled[c] += total * decay[m + c] * abs(row[TRAVEL]) / reach[m + c]
