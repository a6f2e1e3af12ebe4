"""Fixed sparsity patterns: sparse matrices refilled with numbers and never rebuilt."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

Array = NDArray[np.float64]
Indices = NDArray[np.int_]


class RowPattern:
    """Rows with entries in given columns."""

    def __init__(self, columns: Indices, n_columns: int) -> None:
        """Fix the pattern.

        Args:
            columns: Column of each entry of each row, shape (m, k); entries at -1
                belong to nothing that varies and are left out.
            n_columns: Number of columns of the matrix.
        """
        row = np.broadcast_to(np.arange(len(columns))[:, None], columns.shape)
        kept = np.flatnonzero(columns.ravel() >= 0)
        row, column = row.ravel()[kept], columns.ravel()[kept]
        order = np.lexsort([row, column])
        self._entries = kept[order]
        count = np.bincount(column, minlength=n_columns)
        starts = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
        self._pattern = row[order].astype(np.int32), starts
        self._shape = len(columns), n_columns

    def fill(self, data: Array) -> csc_matrix:
        """The matrix with given entries; zeros among them stay in the pattern.

        Args:
            data: Entries, shape (m, k), as the columns were given.
        """
        entries = data.ravel()[self._entries]
        matrix = csc_matrix((entries, *self._pattern), self._shape)
        matrix.has_sorted_indices = matrix.has_canonical_format = True
        return matrix


def block_pattern(n_blocks: int, size: int) -> RowPattern:
    """Square dense blocks along the diagonal; entries come as (n_blocks * size, size).

    Args:
        n_blocks: Number of blocks.
        size: Rows and columns of each.
    """
    columns = np.arange(n_blocks * size).reshape(n_blocks, 1, size)
    rows = np.broadcast_to(columns, (n_blocks, size, size))
    return RowPattern(rows.reshape(-1, size), n_blocks * size)
