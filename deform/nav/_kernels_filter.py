"""Numba kernels of the filter: table of epochs, aids and a state in, the state led on with covariance and innovations out."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from deform.nav._kernels import COLUMNS, GAP, PARAMETERS, advance, correct_row, place_difference, shift_place
from deform.nav._kernels_model import (
    SUMS,
    bend_gap,
    lead,
    odometer_rows,
    odometer_step,
    predict,
    process,
    track_axes,
    unit_row,
)
from deform.nav._kernels_state import (
    B_COURSE,
    B_DISTANCE,
    B_WOBBLE,
    COURSE,
    DISTANCE,
    MATRIX,
    NAVIGATED,
    WAVES,
    begin_anew,
    begin_errors_anew,
    errors_from,
    feed_back,
    follow,
)
from deform.nav._kernels_wobble import drive_wobble, follow_rows, lead_errors, share_noise

MOST_MARKS = 3  # at one bound; `aiding.mark_aid` hands on no more
MOST_SCALARS = 6 + 3 * MOST_MARKS  # scalar measurements at one bound: a joint, an azimuth, 3 of each mark, 3 of travel, a rest
SLANT = 0.02  # radian: what wheels lose by a slip is missing aslant of the tool, too
OTHER = -1.0  # kind of a measurement that is none of the travel's three components


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def scalar_update(P, dx, H, z, R, gate, K, far=3.0):
    """One scalar measurement z = H dx + noise, in Joseph's form; beyond ``gate`` sigma its variance grows with the innovation.

    It pulls by ``gate`` sigma up to ``far`` times the gate (Huber), and by less the farther out it lies beyond that.

    Returns the innovation, its variance as used, its variance before any growth. K is filled with the gain.

    Joseph's (I - K H) P (I - K H)' + K R K' is, with h = P H' and s = H h + R, the same as P - K h' - h K' + s K K', which
    stays symmetric and, whatever K is, positive.
    """
    n = dx.size
    s, innovation = R, z
    for i in range(n):
        h = 0.0
        for j in range(n):
            h += P[i, j] * H[j]
        K[i] = h
    for j in range(n):
        s += H[j] * K[j]
        innovation -= H[j] * dx[j]
    expected = s
    if gate > 0.0 and innovation * innovation > gate * gate * s:
        s = abs(innovation) * math.sqrt(s) / gate if abs(innovation) < far * gate * math.sqrt(s) else innovation * innovation
        s = max(s, expected)
    root = math.sqrt(s)
    for i in range(n):
        K[i] /= root
        dx[i] += K[i] * innovation / root
    for i in range(n):  # whole rows, not a triangle and its mirror: columns are slow to write
        k = K[i]
        for j in range(n):
            P[i, j] -= k * K[j]
    for i in range(n):
        K[i] /= root
    return innovation, s, expected


@njit(cache=True, error_model="numpy")
def note(buffers, b, used, H, K, innovation, s, kind):
    """Keep a measurement for the smoother when there is room for it; return the number kept."""
    counts, Hs, Ks, news = buffers[2:6]
    if counts.size > 0:
        Hs[b, used], Ks[b, used] = H, K
        news[b, used, 0], news[b, used, 1], news[b, used, 2] = innovation, s, kind
    return used + 1


@njit(cache=True, error_model="numpy")
def pass_mark(x, mark, m, P, dx, buffers, b, used, H, K, news):
    """Take in the passage of a mark: along the horizontal track, across, up."""
    _, place, variance, late = mark
    e, no, u = place_difference(place[m], x[0:3])
    miss = (e - x[3] * late[m], no - x[4] * late[m], u - x[5] * late[m])
    speed = math.hypot(x[3], x[4])
    a0, a1 = (x[3] / speed, x[4] / speed) if speed > 0.05 else (x[MATRIX + 1], x[MATRIX + 4])
    size = math.hypot(a0, a1)
    a0, a1 = (a0 / size, a1 / size) if size > 1e-6 else (0.0, 1.0)
    for c in range(3):
        H[:] = 0.0
        if c == 0:
            H[0], H[1], z = a0, a1, a0 * miss[0] + a1 * miss[1]
        elif c == 1:
            H[0], H[1], z = a1, -a0, a1 * miss[0] - a0 * miss[1]
        else:
            H[2], z = 1.0, miss[2]
        innovation, s, expected = scalar_update(P, dx, H, z, variance[m, c], 0.0, K)
        news[m, c], news[m, 3 + c] = innovation, expected
        used = note(buffers, b, used, H, K, innovation, s, OTHER)
    return used


@njit(cache=True, error_model="numpy")
def end_joint(x, P, dx, at, length, variance, gate, buffers, b, used, H, K):
    """Take in the known length of the joint that ends here."""
    H[:] = 0.0
    H[at[B_DISTANCE]] = 1.0
    innovation, s, _ = scalar_update(P, dx, H, length - x[DISTANCE], variance, gate, K)
    return note(buffers, b, used, H, K, innovation, s, OTHER)


@njit(cache=True, error_model="numpy")
def direction_rows(x, at, axes, tilt, unit, D, J):
    """Fill axes, D, the pipe's direction by the state (unit vector east, north, up), and J (3, n), its derivative."""
    track_axes(unit, x[MATRIX : MATRIX + 9].reshape((3, 3)), axes)
    odometer_step(unit, x, axes, 0.0, tilt, D)
    odometer_rows(unit, x, at, axes, 0.0, tilt, D, J)


@njit(cache=True, error_model="numpy")
def keep_course(x, P, dx, at, axes, D, J, variance, gate, buffers, b, used, H, K):
    """Take in that the pipe has the azimuth of the straight stretch that it lies in."""
    level = math.hypot(D[0], D[1])
    turn = (math.atan2(D[0], D[1]) - x[COURSE] + math.pi) % (2.0 * math.pi) - math.pi
    for j in range(dx.size):
        H[j] = axes[1, 0] * J[0, j] + axes[1, 1] * J[1, j]
    H[at[B_COURSE]] -= level
    innovation, s, _ = scalar_update(P, dx, H, -turn * level, variance * level * level, gate, K)
    return note(buffers, b, used, H, K, innovation, s, OTHER)


@njit(cache=True, error_model="numpy")
def keep_azimuth(P, dx, C, after, F, variance, gate, buffers, b, used, H, K):
    """Take in that a tool at rest does not turn about the vertical; by the gyros it does from C to ``after``, F as in `lead`.

    Its level axes are left to the displacement at rest, which sees the same noise of the gyros as a tilt.
    """
    turn = 0.0
    for j in range(3):
        turn += 0.5 * (after[1, j] * C[0, j] - after[0, j] * C[1, j])
    for j in range(dx.size):
        H[j] = F[8, j]
    H[8] -= 1.0
    innovation, s, _ = scalar_update(P, dx, H, -turn, variance, gate, K)
    return note(buffers, b, used, H, K, innovation, s, OTHER)


@njit(cache=True, error_model="numpy", nogil=True)
def forward(first, last, travel, mark, span, x, P, noise, gate, buffers, news, mark_news, score, turned, about):
    """Filter the bounds ``first`` ... ``last``; x and P, the state before the first's measurements, are led on behind the last.

    travel : table of epochs, speeds at the bounds, tilt of the arms, variances of the displacement (epoch, 3), 0 for none, and
        how far out a displacement along pulls in full (`scalar_update`).
    mark : bound, place, variance along, across, up, and lateness of each mark.
    span : (bound, 2) length of the joint that ends there (NaN for none) and its variance; (bound,) variance of the azimuth of a
        straight stretch, 0 for none; (bound,) flags of what begins anew; (epoch,) variance of the turn about up at rest.
    noise : at, reckoned, walk, travel_walk, tau, reach, steady, unknown as `process` takes them.
    buffers : states, covariances behind the measurements of each bound, the measurements, and the errors against the states;
        kept when they have rows.
    about : (bound, STATE_COLUMNS) states about which everything is linear; without rows about the state estimated at each bound.

    ``news`` (epoch, 3) takes the innovations of the travel along, right, up over their sigma, ``mark_news`` (mark, 6) those of
    the marks along, across, up and their variances. ``score`` (3,) gathers the log-likelihood of the travel's innovations, those
    beyond the gate by the tails of Huber's density; ``turned`` (bound, 9), when it has rows, the attitudes.

    Where the wheels slip the displacement across the tool counts little: it is the angle between pipe and tool times the way, and
    the filter would take the lost way for a turn of the pipe, and its own part of that angle for known.
    """
    table, speeds, tilts, R, far = travel
    joint, straight, begins, resting = span
    at, reckoned, walk, travel_walk, tau, reach, steady, unknown = noise
    keep, fixed = buffers[2].size > 0, about.shape[0] > 0
    n, full = P.shape[0], NAVIGATED + (1 if at[B_DISTANCE] >= 0 else 0)
    F, J, W, D, s = np.empty((full, n)), np.empty((3, n)), np.empty((full, n)), np.empty(3), np.empty(3)
    axes, row, H, K, unit = np.empty((3, 3)), np.empty(COLUMNS), np.empty(n), np.empty(n), unit_row()
    dx, led, decay, Q = np.zeros(n), np.zeros(n), np.ones(n), np.zeros(n)
    follows, shared = np.zeros((2, 2 * WAVES if at[B_WOBBLE] >= 0 else 0))
    recalls = np.zeros(2 if at[B_WOBBLE] >= 0 else 0)
    place, v, C = np.empty(3), np.empty(3), np.empty((3, 3))
    no_tilt = np.zeros(tilts.shape[1])
    m = 0
    while m < mark[0].size and mark[0][m] < first:
        m += 1
    for k in range(first, last + 1):
        b = k - first
        moves = k < table.shape[0]
        tilt = tilts[k] if moves else no_tilt
        used = 0
        dx[:] = 0.0
        if fixed:
            errors_from(x, about[k], at, dx)
            x[:] = about[k]
        if joint.shape[0] > 0 and joint[k, 0] == joint[k, 0]:
            used = end_joint(x, P, dx, at, joint[k, 0], joint[k, 1], gate, buffers, b, used, H, K)
        if straight.size > 0 and straight[k] > 0.0:
            direction_rows(x, at, axes, tilt, unit, D, J)
            used = keep_course(x, P, dx, at, axes, D, J, straight[k], gate, buffers, b, used, H, K)
        while m < mark[0].size and mark[0][m] == k:
            used = pass_mark(x, mark, m, P, dx, buffers, b, used, H, K, mark_news)
            m += 1
        if moves:
            change = speeds[k + 1] - speeds[k]
            correct_row(table[k], x[15 : 15 + PARAMETERS], row)
            C_now = x[MATRIX : MATRIX + 9].reshape((3, 3))
            track_axes(row, C_now, axes)
            odometer_step(row, x, axes, change, tilt, D)
            s[0], s[1], s[2] = advance(row, x[0:3], x[3:6], C_now, place, v, C)
            odometer_rows(row, x, at, axes, change, tilt, D, J)
            lead(row, x, at, False, axes, J, F)
            aslant = 0.0
            for c in range(3):
                if R[k, c] <= 0.0:
                    news[k, c] = np.nan
                    continue
                z = axes[c, 0] * (D[0] - s[0]) + axes[c, 1] * (D[1] - s[1]) + axes[c, 2] * (D[2] - s[2])
                for j in range(n):
                    H[j] = axes[c, 0] * (F[0, j] - J[0, j]) + axes[c, 1] * (F[1, j] - J[1, j]) + axes[c, 2] * (F[2, j] - J[2, j])
                for j in range(3):
                    H[j] = 0.0
                innovation, variance, expected = scalar_update(P, dx, H, z, R[k, c] + aslant, gate, K, far if c == 0 else 3.0)
                if c == 0 and gate > 0.0 and innovation * innovation > gate * gate * expected:
                    aslant = (SLANT * innovation) ** 2
                size = abs(innovation) / math.sqrt(expected)
                news[k, c] = innovation / math.sqrt(expected)
                square = size * size if gate <= 0.0 or size < gate else gate * (2.0 * size - gate)
                score[c] -= 0.5 * (math.log(expected) + square)
                used = note(buffers, b, used, H, K, innovation, variance, float(c))
            if resting.size > 0 and resting[k] > 0.0:
                used = keep_azimuth(P, dx, C_now, C, F, resting[k], gate, buffers, b, used, H, K)
        if not fixed:
            feed_back(x, dx, at)
            dx[:] = 0.0
        if turned.shape[0] > 0:
            turned[k] = x[MATRIX : MATRIX + 9]
        if keep:
            buffers[0][b], buffers[1][b], buffers[2][b], buffers[6][b] = x, P, used, dx
        if begins.size > 0 and begins[k] > 0:
            direction_rows(x, at, axes, tilt, unit, D, J)
            begin_anew(x, P, at, begins[k], math.atan2(D[0], D[1]))
            begin_errors_anew(dx, at, begins[k])
        if not moves:
            feed_back(x, dx, at)
            break
        correct_row(table[k], x[15 : 15 + PARAMETERS], row)
        C_now = x[MATRIX : MATRIX + 9].reshape((3, 3))
        track_axes(row, C_now, axes)
        odometer_step(row, x, axes, change, tilt, D)
        s[0], s[1], s[2] = advance(row, x[0:3], x[3:6], C_now, place, v, C)
        dead = reckoned or row[GAP] > 0.0  # no force is known in a gap: the odometer leads the position over it
        odometer_rows(row, x, at, axes, change, tilt, D, J)
        lead(row, x, at, dead, axes, J, F)
        process(row, at, walk, travel_walk, tau, reach, steady, unknown, reckoned, R[k], axes, decay, follows, recalls, Q, shared)
        follow_rows(F, at, follows, recalls)
        drive_wobble(P, at, follows, recalls)
        predict(P, F, decay, Q, W)
        share_noise(P, at, shared)
        if dead:
            place[0], place[1], place[2] = x[0], x[1], x[2]
            shift_place(place, D[0], D[1], D[2])
            s[0], s[1], s[2] = D[0], D[1], D[2]
        if fixed:
            lead_errors(dx, F, decay, follows, recalls, at, led)
        if row[GAP] > 0.0:
            bend_gap(row, C_now, C, P, dx)
        follow(x, place, v, C, s, axes, decay, follows, recalls, at)
        if fixed:
            feed_back(x, dx, at)
