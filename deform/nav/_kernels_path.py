"""Numba kernels of the odometer and of the path: counts and times in, knots and interpolated series out (SI, radian)."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def counts_on_knots(time, count, pulse, start, step, n_knots):
    """Travel (m) of each wheel at regular knots, linear between odometer samples, held beyond the ends; shape (knot, wheel)."""
    n, wheels = count.shape
    travel = np.empty((n_knots, wheels))
    j = 0
    for k in range(n_knots):
        t = start + k * step
        while j < n - 2 and time[j + 1] < t:
            j += 1
        span = time[j + 1] - time[j]
        w = (t - time[j]) / span if span > 0.0 else 0.0
        w = min(max(w, 0.0), 1.0)
        for i in range(wheels):
            travel[k, i] = pulse * (count[j, i] + w * (count[j + 1, i] - count[j, i]))
    return travel


@njit(cache=True, error_model="numpy")
def imu_on_knots(time, gyro, accel, mounting, gyro_pulse, accel_pulse, start, step, n_knots):
    """Turning angles about body x and z up to each knot (radian), and the rms of successive accelerations before it (m/s2)."""
    turn = np.zeros((n_knots, 2))
    shake = np.zeros(n_knots)
    n = time.shape[0]
    i, turn_x, turn_z = 0, 0.0, 0.0
    for k in range(n_knots):
        t = start + k * step
        square, used = 0.0, 0
        while i < n and time[i] <= t:
            gx, gy, gz = gyro_pulse * gyro[i, 0], gyro_pulse * gyro[i, 1], gyro_pulse * gyro[i, 2]
            turn_x += mounting[0, 0] * gx + mounting[0, 1] * gy + mounting[0, 2] * gz
            turn_z += mounting[2, 0] * gx + mounting[2, 1] * gy + mounting[2, 2] * gz
            if i > 0 and time[i] > time[i - 1]:
                dt = time[i] - time[i - 1]
                for a in range(3):
                    difference = accel_pulse * (accel[i, a] - accel[i - 1, a]) / dt
                    square += difference * difference
                used += 1
            i += 1
        turn[k, 0], turn[k, 1] = turn_x, turn_z
        shake[k] = np.sqrt(square / used) if used > 0 else (shake[k - 1] if k > 0 else 0.0)
    return turn, shake


@njit(cache=True, error_model="numpy")
def turn_at_wheels(turn, distance, lever):
    """Turning angles of the IMU when it was where the wheels are now: at ``distance + lever`` (lever < 0 behind the IMU)."""
    n = distance.shape[0]
    out = np.empty_like(turn)
    j = 0
    for k in range(n):
        target = distance[k] + lever
        while j < n - 1 and distance[j + 1] < target:
            j += 1
        while j > 0 and distance[j] > target:
            j -= 1
        if j >= n - 1 or target <= distance[0]:
            m = n - 1 if j >= n - 1 else 0
            out[k, 0], out[k, 1] = turn[m, 0], turn[m, 1]
        else:
            span = distance[j + 1] - distance[j]
            w = (target - distance[j]) / span if span > 0.0 else 0.0
            w = min(max(w, 0.0), 1.0)
            for a in range(2):
                out[k, a] = turn[j, a] + w * (turn[j + 1, a] - turn[j, a])
    return out


@njit(cache=True, error_model="numpy")
def mark_slips(step, tolerance, slack, alarm, good):
    """Mark in ``good`` (knot, wheel) where a wheel falls behind any other one: a cumulative sum per pair with its start and end.

    ``step`` are the travels per knot (m), free of scale and bend; ``tolerance`` the share of the travel that is no
    slip, ``slack`` (knot) what else is none (m), ``alarm`` the lost distance (m) at which a slip is believed.
    """
    n, wheels = step.shape
    for i in range(wheels):
        for j in range(wheels):
            if i == j:
                continue
            lost, peak, first, last, alarmed = 0.0, 0.0, 0, 0, False
            for k in range(n):
                lead = step[k, j] if np.isfinite(step[k, j]) else 0.0
                mine = step[k, i] if np.isfinite(step[k, i]) else 0.0
                lost += lead - mine - tolerance * lead - slack[k]
                if lost > peak:
                    peak, last = lost, k
                if lost > alarm:
                    alarmed = True
                over = alarmed and (lost < peak - 0.5 * alarm or k == n - 1)
                if over:
                    for m in range(first, last + 1):
                        good[m, i] = False
                if over or lost <= 0.0:
                    lost, peak, first, last, alarmed = 0.0, 0.0, k + 1, k + 1, False


@njit(cache=True, error_model="numpy")
def fuse(step, good, mean, n_good, spread):
    """Mean travel per knot over the good wheels, their number, and the spread of the wheels about it (m)."""
    n, wheels = step.shape
    for k in range(n):
        total, used = 0.0, 0
        for i in range(wheels):
            if good[k, i]:
                total += step[k, i]
                used += 1
        mean[k] = total / used if used > 0 else 0.0
        n_good[k] = used
        square = 0.0
        for i in range(wheels):
            if good[k, i]:
                square += (step[k, i] - mean[k]) ** 2
        spread[k] = np.sqrt(square / (used - 1)) if used > 1 else 0.0


@njit(cache=True, error_model="numpy")
def knots_to_samples(times, before, knots_start, knots_step, distance, slope, sigma, still, out):
    """Cubic Hermite interpolation of the knots to ``before`` and ``times``; fills distance, speed, sigma and still of ``out``."""
    out_distance, out_speed, out_sigma, out_still = out
    n, n_knots = times.shape[0] + 1, distance.shape[0]
    for m in range(n):
        t = before if m == 0 else times[m - 1]
        u = (t - knots_start) / knots_step
        k = min(max(int(np.floor(u)), 0), n_knots - 2)
        w = min(max(u - k, 0.0), 1.0)
        rise = distance[k + 1] - distance[k]
        a = slope[k] * knots_step
        b = slope[k + 1] * knots_step
        c2 = 3.0 * rise - 2.0 * a - b
        c3 = a + b - 2.0 * rise
        out_distance[m] = distance[k] + w * (a + w * (c2 + w * c3))
        out_speed[m] = max((a + w * (2.0 * c2 + 3.0 * w * c3)) / knots_step, 0.0)
        out_sigma[m] = sigma[k] + w * (sigma[k + 1] - sigma[k])
        out_still[m] = still[k] and still[k + 1]


@njit(cache=True, error_model="numpy")
def limited_slopes(distance, step):
    """Speeds at the knots: central differences, limited so that the cubic between the knots never runs backwards."""
    n = distance.shape[0]
    slope = np.zeros(n)
    for k in range(n):
        right = (distance[min(k + 1, n - 1)] - distance[min(k, n - 2)]) / step
        left = (distance[max(k, 1)] - distance[max(k - 1, 0)]) / step
        slope[k] = min(0.5 * (left + right), 3.0 * min(left, right))
    return slope


@njit(cache=True, error_model="numpy")
def smooth_chain(seen, variance, rows, push, F, Q, Q_push, P0, wanted, value, spread, odd):
    """Fixed-interval smoothing of a chain of states: Kalman filter forward, Rauch-Tung-Striebel back.

    ``seen`` (n, q) are measurements ``rows`` (q, m) times the state with ``variance`` (q,), NaN where there is none; ``push``
    (n,) scales ``Q_push`` beside the constant ``Q``. Fills ``value`` (n, p) of the rows ``wanted`` (p, m) times the state, and
    ``spread`` (n,), the standard deviation of the first. A measurement beyond five sigma loses weight until it is at five
    (Huber); ``odd`` counts them.
    """
    n, m = seen.shape[0], F.shape[0]
    x_f, P_f = np.empty((n, m)), np.empty((n, m, m))
    x, P = np.zeros(m), P0.copy()
    for k in range(n):
        if np.isfinite(seen[k, 0]):
            x[0] = seen[k, 0]
            break
    for k in range(n):
        if k > 0:
            x, P = _led(F, x, P, Q, push[k], Q_push)
        for r in range(seen.shape[1]):
            if np.isfinite(seen[k, r]):
                _measure(x, P, seen[k, r], rows[r], variance[r], odd)
        x_f[k], P_f[k] = x, P
    value[n - 1], spread[n - 1] = _times(wanted, x), _deviation(wanted[0], P)
    for k in range(n - 2, -1, -1):
        x_p, P_p = _led(F, x_f[k], P_f[k], Q, push[k + 1], Q_push)
        predicted = P_p.copy()
        for i in range(m):
            predicted[i, i] = predicted[i, i] * (1.0 + 1e-12) + 1e-30
        J = np.linalg.solve(predicted, _product(F, P_f[k])).T
        x = x_f[k] + _times(J, x - x_p)
        P = P_f[k] + _congruent(J, P - P_p)
        value[k], spread[k] = _times(wanted, x), _deviation(wanted[0], P)


@njit(cache=True, error_model="numpy")
def _led(F, x, P, Q, push, Q_push):
    """State and covariance a node on."""
    led = _congruent(F, P)
    for i in range(led.shape[0]):
        for j in range(led.shape[0]):
            led[i, j] += Q[i, j] + push * Q_push[i, j]
    return _times(F, x), led


@njit(cache=True, error_model="numpy")
def _deviation(row, P):
    """Standard deviation of a row times the state."""
    along = _times(P, row)
    variance = 0.0
    for i in range(row.size):
        variance += row[i] * along[i]
    return np.sqrt(max(variance, 0.0))


@njit(cache=True, error_model="numpy")
def _measure(x, P, z, row, R, odd):
    """Update state and covariance in place with one scalar measurement."""
    m = x.shape[0]
    PH = _times(P, row)
    S, innovation = 0.0, z
    for i in range(m):
        S += row[i] * PH[i]
        innovation -= row[i] * x[i]
    if innovation * innovation > 25.0 * (S + R):
        R = max(R, abs(innovation) * np.sqrt(S + R) / 5.0 - S)
        odd[0] += 1
    for i in range(m):
        gain = PH[i] / (S + R)
        x[i] += gain * innovation
        for j in range(i, m):
            P[i, j] -= gain * PH[j]
            P[j, i] = P[i, j]


@njit(cache=True, error_model="numpy")
def _times(A, x):
    n, m = A.shape
    out = np.zeros(n)
    for i in range(n):
        for j in range(m):
            out[i] += A[i, j] * x[j]
    return out


@njit(cache=True, error_model="numpy")
def _product(A, B):
    m = A.shape[0]
    out = np.zeros((m, m))
    for i in range(m):
        for k in range(m):
            if A[i, k] != 0.0:
                for j in range(m):
                    out[i, j] += A[i, k] * B[k, j]
    return out


@njit(cache=True, error_model="numpy")
def _congruent(A, P):
    """A P A^T."""
    half = _product(A, P)
    m = A.shape[0]
    out = np.zeros((m, m))
    for i in range(m):
        for k in range(m):
            if half[i, k] != 0.0:
                for j in range(m):
                    out[i, j] += half[i, k] * A[j, k]
    return out
