"""Sum of local values into nodes."""

import numpy as np

from ffsi.files.arrays import Floats, Ints


def scatter(local: Floats, nodes: Ints, size: int) -> Floats:
    """Add local values (n, k, components) into nodes (n, k) of ``size`` nodes; (size, components)."""
    where = nodes.ravel()
    columns = [np.bincount(where, weights=column.ravel(), minlength=size) for column in np.moveaxis(local, -1, 0)]
    return np.column_stack(columns)
