"""Rollout file: rows in one order, whole at any time, readable by others."""

import pandas as pd
import pytest

from drapeplan.errors import InputError
from drapeplan.rollout_file import FIELDS, RolloutFile, read_rollouts

MADE_FROM = {"scene": "sha256:1", "seed": 0}


def row(trial, sample, stage="search", margin=0.1 + 0.2):
    """A row as tuning makes it."""
    facts = {"stage": stage, "trial": trial, "sample": sample, "margin_mm": margin}
    facts |= {"path.bend_mm": 100.0 + trial, "mold.height_mm": 12.5}
    facts |= {"tightest_cups": [[0, 1], [2, 1]], "not_good": ["touch"]}
    return dict.fromkeys(FIELDS) | facts


ROWS = [
    row(1, 5),
    row(0, None, margin=None),
    row(0, 5),
    row(0, 3, "ranking"),
    row(0, 4),
]


def file_of(path, rows=ROWS, made_from=None):
    """A file with rows."""
    file = RolloutFile(path, made_from or MADE_FROM, ["bend_mm"])
    for one in rows:
        file.add([one])
    file.write()
    return file


def test_pandas_opens_it(tmp_path):
    path = tmp_path / "new" / "rollouts.parquet"
    file_of(path)
    frame = pd.read_parquet(path)
    assert list(frame["trial"]) == [0, 0, 0, 1, 0]
    assert frame["sample"].isna().tolist() == [True, False, False, False, False]
    assert frame["margin_mm"][1] == 0.1 + 0.2
    assert frame["path.bend_mm"].tolist() == [100.0, 100.0, 100.0, 101.0, 100.0]
    assert [list(cup) for cup in frame["tightest_cups"][1]] == [[0, 1], [2, 1]]


def test_the_order_of_work_does_not_show(tmp_path):
    file_of(tmp_path / "a.parquet")
    file_of(tmp_path / "b.parquet", ROWS[::-1])
    a, b = ((tmp_path / name).read_bytes() for name in ("a.parquet", "b.parquet"))
    assert a == b


def test_rows_come_back_as_they_were(tmp_path):
    path = tmp_path / "rollouts.parquet"
    rows = file_of(path).rows()
    again = RolloutFile(path, MADE_FROM, ["bend_mm"])
    again.resume()
    assert again.rows() == rows
    assert again.row("ranking", (100.0, None), 3) == ROWS[3]
    assert again.row("ranking", (100.0, None), 4) is None
    assert again.row("search", (100.0, None), None)["margin_mm"] is None


def test_each_batch_is_in_the_file_soon(tmp_path):
    path = tmp_path / "rollouts.parquet"
    file = RolloutFile(path, MADE_FROM, ["bend_mm"])
    file.add([ROWS[0]])
    assert read_rollouts(path)[1].num_rows == 1
    assert [p.name for p in tmp_path.iterdir()] == ["rollouts.parquet"]


@pytest.mark.parametrize("other", [{"scene": "sha256:2"}, {"seed": 1}])
def test_rollouts_of_something_else_are_refused(tmp_path, other):
    path = tmp_path / "rollouts.parquet"
    file_of(path)
    file = RolloutFile(path, MADE_FROM | other, ["bend_mm"])
    with pytest.raises(InputError, match=f"of another {next(iter(other))}"):
        file.resume()


def test_what_is_no_rollout_file_is_bad_input(tmp_path):
    text, table = tmp_path / "text", tmp_path / "table"
    text.write_text("margin\n1\n")
    pd.DataFrame({"margin": [1]}).to_parquet(table)
    for path in (text, table, tmp_path / "missing", tmp_path):
        with pytest.raises(InputError) as refused:
            read_rollouts(path)
        assert "\n" not in str(refused.value)
