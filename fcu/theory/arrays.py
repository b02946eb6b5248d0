"""Operations on small matrices with any leading axes; each acts on the last one or two axes.

Leading axes form a batch: an array of shape (1000, n, n) holds a thousand systems, and every
function of this package computes all of them in one call.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[np.float64]]


def times(M: Array, v: Array) -> Array:
    """M v: (..., i, j) by (..., j) to (..., i)."""
    return np.asarray(np.einsum("...ij,...j->...i", M, v))


def transposed_times(M: Array, v: Array) -> Array:
    """M^T v: (..., i, j) by (..., i) to (..., j)."""
    return np.asarray(np.einsum("...ji,...j->...i", M, v))


def outer(a: Array, b: Array) -> Array:
    """a b^T: (..., i) by (..., j) to (..., i, j)."""
    return a[..., :, None] * b[..., None, :]


def transposed(M: Array) -> Array:
    """M^T: (..., i, j) to (..., j, i)."""
    return np.swapaxes(M, -1, -2)


def inner(X: Array, Y: Array) -> Array:
    """tr(X^T Y): (..., i, j) and (..., i, j) to (...)."""
    return np.asarray((X * Y).sum(axis=(-2, -1)))


def frobenius(X: Array) -> Array:
    """sqrt(tr(X^T X)), the norm of every bound in this package: (..., i, j) to (...)."""
    return np.sqrt(inner(X, X))


def length(v: Array) -> Array:
    """Euclidean norm: (..., i) to (...)."""
    return np.asarray(np.sqrt((v * v).sum(axis=-1)))
