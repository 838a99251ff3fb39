"""Points in two systems with sigmas in, the similarity (Helmert) transformation out, with covariance and outlier tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from deform.errors import Fault, InputError

PARAMETERS = ("east", "north", "up", "rotation_x", "rotation_y", "rotation_z", "scale")
MODELS: dict[str, tuple[str, ...]] = {
    "translation": ("east", "north", "up"),
    "translation_heading": ("east", "north", "up", "rotation_z"),
    "translation_heading_scale": ("east", "north", "up", "rotation_z", "scale"),
    "rigid": ("east", "north", "up", "rotation_x", "rotation_y", "rotation_z"),
    "similarity": PARAMETERS,
    "plane": ("east", "north", "rotation_z", "scale"),
    "plane_rigid": ("east", "north", "rotation_z"),
}
_BOUND = 2.5  # standardised residual beyond which a robust fit takes weight off (Huber with a descending third part)


@dataclass(frozen=True)
class Similarity:
    """target = shift + scale · rotation · (source − centre) + centre.

    Attributes
    ----------
    rotation : (3, 3) matrix.
    scale : 1 + m.
    shift : (3) metre, at ``centre``, the weighted centre of the source points.
    centre : (3) metre.
    parameters : names of what was estimated, in the order of the covariance.
    covariance : of the parameters at the solution: metre, radian (small rotations about the axes after the estimated one), 1.
    residual : (n, 3) target minus transformed source, metre.
    w : (n, 3) standardised residuals (Baarda's w-test), NaN for a coordinate that no other controls.
    redundancy : (n, 3) share of an error of each coordinate that shows in its own residual, 0 to 1.
    sigma0 : a-posteriori standard deviation of unit weight; 1 when the sigmas are right.
    degrees_of_freedom : observations minus parameters.
    suspects : points whose largest w exceeds its critical value, worst first.
    weight : (n) what the robust fit left of each point's weight; 1 for good points.
    undetermined : directions of the parameters that the points do not determine, in words.
    """

    rotation: np.ndarray
    scale: float
    shift: np.ndarray
    centre: np.ndarray
    parameters: tuple[str, ...]
    covariance: np.ndarray
    residual: np.ndarray
    w: np.ndarray
    redundancy: np.ndarray
    sigma0: float
    degrees_of_freedom: int
    suspects: tuple[int, ...]
    weight: np.ndarray
    undetermined: tuple[str, ...]

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Transform points (k, 3), metre."""
        return self.centre + self.shift + self.scale * (np.asarray(points, float) - self.centre) @ self.rotation.T

    def inverse(self, points: np.ndarray) -> np.ndarray:
        """Transform points of the target system (k, 3) back, metre."""
        return self.centre + (np.asarray(points, float) - self.centre - self.shift) @ self.rotation / self.scale

    @property
    def translation(self) -> np.ndarray:
        """Translation about the origin (3), metre: target = translation + scale · rotation · source."""
        return self.centre + self.shift - self.scale * self.rotation @ self.centre

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return dict(zip(self.parameters, np.sqrt(np.diag(self.covariance)), strict=True))

    def covariance_at(self, points: np.ndarray) -> np.ndarray:
        """Covariance (k, 3, 3) of transformed points from that of the parameters, metre²."""
        turned = self.scale * (np.asarray(points, float) - self.centre) @ self.rotation.T
        rows = _design(turned, self.parameters)
        return rows @ self.covariance @ np.swapaxes(rows, 1, 2)


def fit_similarity(
    source: np.ndarray,
    target: np.ndarray,
    sigma: np.ndarray | float = 1.0,
    *,
    model: str = "similarity",
    robust: bool = False,
    significance: float = 0.001,
) -> Similarity:
    """Fit a similarity transformation of 3 to 7 parameters.

    Parameters
    ----------
    source, target : the same points in both systems (n, 3), metre; east, north, up or any right-handed axes.
    sigma : standard deviation of target minus source: one number, (n), (n, 3), or covariances (n, 3, 3) in metre².
    model : a key of `MODELS`; ``plane`` and ``plane_rigid`` leave the third coordinate as it is.
    robust : take the weight off points that do not fit (iteratively reweighted), so that one wrong point does not spoil the rest.
    significance : probability of calling a good coordinate an outlier.

    Raises
    ------
    InputError
        When there are fewer points than the model needs, or shapes do not fit, or a value is not finite.

    Notes
    -----
    Gauss–Newton on the linearised model with the rotation updated as a matrix, so that rotations may be of any size:
    v = target − (T + s·R·x), design row [I, [s·R·x]ₓ-part, s·R·x]. Nothing that the points do not determine is
    invented: directions of the parameters without information are left at zero and named in ``undetermined`` (points on one line
    leave the roll about it free). w-tests after Baarda: w = v / (σ₀ √q_vv), with the stated sigmas.

    References
    ----------
    Ghilani and Wolf, Adjustment Computations, chapter 18 (two- and three-dimensional conformal transformation);
    Baarda 1968, A testing procedure for use in geodetic networks.

    Examples
    --------
    >>> points = np.array([[0.0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 50]])
    >>> fit = fit_similarity(points, points + [1.0, 2.0, 3.0], model="translation")
    >>> fit.shift.round(6).tolist()
    [1.0, 2.0, 3.0]
    """
    source, target, precision = _checked(source, target, sigma, model)
    names = MODELS[model]
    weight = np.ones(len(source))
    for _ in range(50 if robust else 1):
        fitted = _solve(source, target, precision * weight[:, None, None], names)
        if not robust:
            break
        new = _weights(fitted, precision)
        if np.abs(new - weight).max() < 1e-4:
            break
        weight = new
    return _tested(fitted, source, target, precision, weight, names, significance)


def fit_sections(
    source: np.ndarray, target: np.ndarray, section: np.ndarray, sigma: np.ndarray | float = 1.0, **options
) -> dict[int, Similarity]:
    """Fit each section of a line on its own, such as between hard control points; ``section`` (n) numbers the points."""
    sigma = np.asarray(sigma, float)
    own = [(int(k), np.asarray(section) == k) for k in np.unique(section)]
    return {k: fit_similarity(source[m], target[m], sigma[m] if sigma.ndim else sigma, **options) for k, m in own}


def _checked(source, target, sigma, model):
    if model not in MODELS:
        raise InputError(Fault("similarity", "model", f"{model!r} is unknown; known are {', '.join(MODELS)}"))
    source, target = np.asarray(source, float), np.asarray(target, float)
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 3:
        raise InputError(Fault("similarity", "points", f"have shapes {source.shape} and {target.shape}; both must be (n, 3)"))
    n = len(source)
    sigma = np.asarray(sigma, float)
    if sigma.ndim == 3:
        precision = np.linalg.inv(sigma)
    else:
        spread = np.broadcast_to(sigma[:, None] if sigma.ndim == 1 else sigma, (n, 3))
        precision = np.einsum("ni,ij->nij", 1.0 / spread**2, np.eye(3))
    if not (np.isfinite(source).all() and np.isfinite(target).all() and np.isfinite(precision).all()):
        raise InputError(Fault("similarity", "points", "hold a coordinate or a sigma that is not finite or is zero"))
    needed = int(np.ceil(len(MODELS[model]) / (2 if model.startswith("plane") else 3)))
    if n < needed:
        raise InputError(Fault("similarity", "points", f"are {n}; the model {model!r} needs {needed}"))
    return source, target, precision


def _design(turned: np.ndarray, names) -> np.ndarray:
    """Derivatives (n, 3, parameters) of the transformed points; ``turned`` is s·R·(x − centre)."""
    n = len(turned)
    x, y, z = turned.T
    zero = np.zeros(n)
    columns = {
        "east": np.stack([zero + 1, zero, zero], 1),
        "north": np.stack([zero, zero + 1, zero], 1),
        "up": np.stack([zero, zero, zero + 1], 1),
        "rotation_x": np.stack([zero, -z, y], 1),
        "rotation_y": np.stack([z, zero, -x], 1),
        "rotation_z": np.stack([-y, x, zero], 1),
        "scale": turned,
    }
    if "up" not in names:
        columns["scale"] = np.stack([x, y, zero], 1)
    return np.stack([columns[p] for p in names], axis=2)


@dataclass
class _Fit:
    rotation: np.ndarray
    scale: float
    shift: np.ndarray
    centre: np.ndarray
    residual: np.ndarray
    rows: np.ndarray
    cofactor: np.ndarray
    free: list[np.ndarray]
    used: np.ndarray


def _solve(source, target, precision, names) -> _Fit:
    total = precision.sum(axis=0)
    centre = np.linalg.solve(total, np.einsum("nij,nj->i", precision, source))
    plane = "up" not in names
    rotation, scale = _start(source - centre, target, precision, names)
    shift = np.linalg.solve(total, np.einsum("nij,nj->i", precision, target - centre - scale * (source - centre) @ rotation.T))
    if plane:
        shift[2] = 0.0
    for _ in range(100):
        turned = scale * (source - centre) @ rotation.T
        if plane:
            turned[:, 2] = (source - centre)[:, 2]
        residual = target - centre - shift - turned
        if plane:
            residual[:, 2] = 0.0
        rows = _design(turned, names)
        normal = np.einsum("nip,nij,njq->pq", rows, precision, rows)
        step, cofactor, free = _pseudo_solve(normal, np.einsum("nip,nij,nj->p", rows, precision, residual))
        moves = dict(zip(names, step, strict=True))
        shift = shift + np.array([moves.get(p, 0.0) for p in ("east", "north", "up")])
        rotation = _small(np.array([moves.get(p, 0.0) for p in ("rotation_x", "rotation_y", "rotation_z")])) @ rotation
        scale *= 1.0 + moves.get("scale", 0.0)
        if np.abs(step).max() < 1e-13 * max(1.0, np.abs(shift).max()):
            break
    return _Fit(rotation, scale, shift, centre, residual, rows, cofactor, free, precision)


def _start(source, target, precision, names):
    """Rotation and scale to begin with: closed form (Horn, Umeyama) over the axes that are free."""
    if not any(p.startswith("rotation") for p in names):
        return np.eye(3), 1.0
    weight = np.trace(precision, axis1=1, axis2=2)
    a, b = (p - np.average(p, axis=0, weights=weight) for p in (source, target))
    if "rotation_x" not in names:
        a, b = a * [1.0, 1.0, 0.0], b * [1.0, 1.0, 0.0]
        angle = np.arctan2(np.sum(weight * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), np.sum(weight * (a * b).sum(axis=1)))
        rotation = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    else:
        u, _, vt = np.linalg.svd((b * weight[:, None]).T @ a)
        rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    size = np.sum(weight * (a * a).sum(axis=1))
    scale = float(np.sum(weight * (b * (a @ rotation.T)).sum(axis=1)) / size) if "scale" in names and size > 0 else 1.0
    return rotation, scale


def _pseudo_solve(normal, right):
    """Solve the normal equations; directions without information stay zero. Returns step, cofactor matrix, free directions."""
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    known = values > 1e-10 * values.max()
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T / np.outer(size, size)
    return inverse @ right, inverse, [vectors[:, k] / size for k in np.flatnonzero(~known)]


def _small(angle: np.ndarray) -> np.ndarray:
    """Rotation matrix of a rotation vector (radian)."""
    size = np.linalg.norm(angle)
    if size == 0.0:
        return np.eye(3)
    x, y, z = angle / size
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(size) * k + (1.0 - np.cos(size)) * k @ k


def _standardised(fit: _Fit, precision):
    """W of every coordinate and its redundancy number, with the full weights of the good points."""
    covariance = np.linalg.inv(precision)
    shown = covariance - fit.rows @ fit.cofactor @ np.swapaxes(fit.rows, 1, 2)
    part = np.clip(np.diagonal(shown @ precision, axis1=1, axis2=2), 0.0, 1.0)
    spread = np.sqrt(np.maximum(np.diagonal(shown, axis1=1, axis2=2), 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(part > 1e-6, fit.residual / spread, np.nan), part


def _weights(fit: _Fit, precision) -> np.ndarray:
    """Weight of each point from its largest residual in sigmas: 1, Huber's share, then falling with the square."""
    sigma = 1.0 / np.sqrt(np.diagonal(precision, axis1=1, axis2=2))
    z = np.abs(fit.residual) / sigma
    scale = max(float(np.median(z[z > 0]) / 0.6745) if (z > 0).any() else 1.0, 1e-12)
    worst = z.max(axis=1) / scale
    return np.where(worst <= _BOUND, 1.0, (_BOUND / np.maximum(worst, _BOUND)) ** np.where(worst > 3 * _BOUND, 4, 1))


def _tested(fit: _Fit, source, target, precision, weight, names, significance) -> Similarity:
    w, part = _standardised(fit, precision)
    count = (2 if "up" not in names else 3) * len(source)
    freedom = count - len(names) + len(fit.free)
    square = float(np.einsum("n,ni,nij,nj->", weight, fit.residual, precision, fit.residual))
    sigma0 = float(np.sqrt(square / freedom)) if freedom > 0 else np.nan
    critical = stats.norm.ppf(1.0 - significance / 2.0)
    worst = np.nanmax(np.where(np.isfinite(w), np.abs(w), 0.0), axis=1)
    suspects = tuple(int(k) for k in np.argsort(-worst) if worst[k] > critical)
    return Similarity(
        rotation=fit.rotation,
        scale=float(fit.scale),
        shift=fit.shift,
        centre=fit.centre,
        parameters=names,
        covariance=fit.cofactor,
        residual=fit.residual,
        w=w,
        redundancy=part,
        sigma0=sigma0,
        degrees_of_freedom=int(freedom),
        suspects=suspects,
        weight=weight,
        undetermined=tuple(_in_words(v, names) for v in fit.free),
    )


def _in_words(direction: np.ndarray, names) -> str:
    share = direction / np.abs(direction).max()
    return " and ".join(f"{share[k]:+.2f} {names[k]}" for k in np.argsort(-np.abs(share)) if abs(share[k]) > 0.05)
