import numpy as np
from numpy.testing import assert_array_equal
from scipy.sparse import block_diag

from drapeplan.patterns import RowPattern, block_pattern


def test_rows_are_filled_where_their_columns_are():
    columns = np.array([[2, 0, -1], [1, -1, 3]])
    data = np.array([[20.0, 0.0, 99.0], [11.0, 99.0, 13.0]])
    found = RowPattern(columns, 5).fill(data)
    assert_array_equal(found.toarray(), [[0, 0, 20, 0, 0], [0, 11, 0, 13, 0]])
    assert found.nnz == 4  # the zero at (0, 0) stays in the pattern
    assert found.has_sorted_indices


def test_blocks_stand_on_the_diagonal_in_the_same_order_each_time():
    blocks = np.random.default_rng(0).normal(size=(4, 3, 3))
    blocks[1] = 0.0
    pattern = block_pattern(4, 3)
    found = pattern.fill(blocks)
    assert_array_equal(found.toarray(), block_diag(list(blocks)).toarray())
    assert found.nnz == 36
    assert_array_equal(found.indices, pattern.fill(blocks + 1).indices)


def test_no_rows():
    assert RowPattern(np.zeros((0, 12), int), 6).fill(np.zeros((0, 12))).shape == (0, 6)
