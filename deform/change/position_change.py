"""Two runs at the same steel in, their displacement per component with sigma out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.change.stack import POSITION, Layer
from deform.geometry.earth import enu_difference

Floats = NDArray[Any]


def raw_difference(reference: Layer, other: Layer) -> Floats:
    """Return the place in a run minus the place in the reference run of the same steel: east, north, up (m), shape (n, 3).

    NaN where either run has no position. The datum of the two trajectories is still in it.
    """
    n = reference.run_chainage.size
    if not (reference.has(*POSITION) and other.has(*POSITION)):
        return np.full((n, 3), np.nan)
    places = [other.values[name] for name in POSITION] + [reference.values[name] for name in POSITION]
    return np.column_stack(enu_difference(*places))


def along_pipe(east_north_up: Floats, tangent: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Return the lateral part (level, positive to the right looking downstream) and the axial part (positive downstream).

    Parameters
    ----------
    east_north_up : (n, 3) displacement (m).
    tangent, right : (n, 3) axes of the reference pipe, see `stack.tangents`.
    """
    level = np.maximum(np.linalg.norm(right, axis=1), 1e-9)
    return np.einsum("ij,ij->i", east_north_up, right) / level, np.einsum("ij,ij->i", east_north_up, tangent)


def along_pipe_sigma(sigma: Floats, tangent: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Return the sigma of the lateral and the axial part from those of east, north, up (n, 3), taken as independent."""
    level = np.maximum(np.linalg.norm(right, axis=1), 1e-9)
    lateral = np.sqrt(np.einsum("ij,ij->i", sigma**2, right**2)) / level
    return lateral, np.sqrt(np.einsum("ij,ij->i", sigma**2, tangent**2))
