"""One time line for several drapes: aligned by phase, wave step and progress."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.browser import synthetic_view
from viewer.moments import moments

RUNS = ("pick", -1), ("approach", -1), ("approach", 0), ("wave", 1), ("wave", 2)
RUNS += ("wave", 3), ("release", -1)
SMALL = {"samples": (3, 3)}
LEAST = (1, 0, 0, 1, 0, 0, 1)  # every plan picks, lays and releases
counts = st.tuples(*(st.integers(least, 4) for least in LEAST))


def drape(poses_of_runs):
    """A view with so many poses in each run, their progress in equal steps to one."""
    found = [
        (phase, step, (k + 1) / n)
        for (phase, step), n in zip(RUNS, poses_of_runs, strict=True)
        for k in range(n)
    ]
    phases, steps, taus = zip(*found, strict=True)
    told = {"phases": list(phases), "wave_step": np.array(steps), "tau": np.array(taus)}
    return synthetic_view(len(found), **SMALL, **told)


@given(counts)
def test_one_drape_has_its_own_poses(poses):
    line = moments([drape(poses)])
    assert [moment.poses for moment in line] == [(k,) for k in range(sum(poses))]


@given(counts, counts)
def test_no_drape_goes_back_or_shows_what_is_not_yet_due(a, b):
    views = drape(a), drape(b)
    line = moments(views)
    due = [RUNS.index(moment[:2]) for moment in line]
    assert due == sorted(due)
    for i, view in enumerate(views):
        shown = np.array([moment.poses[i] for moment in line])
        assert np.all(np.diff(shown) >= 0)
        runs = list(zip(view.phases, view.wave_step.tolist(), strict=True))
        own = [RUNS.index(runs[k]) for k in shown]
        has = [moment[:2] in runs for moment in line]
        assert all(np.less_equal(own, due))
        assert np.array_equal(np.array(own)[has], np.array(due)[has])


@given(counts, counts)
def test_steps_end_together(a, b):
    """At the last moment of a run each drape that has it shows its last pose there."""
    views = drape(a), drape(b)
    line = moments(views)
    for phase, step in RUNS:
        here = [moment for moment in line if moment[:2] == (phase, step)]
        for i, view in enumerate(views):
            own = [
                k
                for k in range(view.poses)
                if (view.phases[k], view.wave_step[k]) == (phase, step)
            ]
            if own:
                assert here[-1].poses[i] == own[-1]
    assert len(line) == sum(max(n, m) for n, m in zip(a, b, strict=True))


def test_poses_stand_side_by_side_by_progress():
    fine, rough = drape([0, 0, 0, 4, 2, 0, 1]), drape([0, 0, 0, 2, 3, 1, 0])
    line = moments([fine, rough])
    assert [moment.poses for moment in line] == [
        *((0, 0), (1, 0), (2, 0), (3, 1)),  # 3/4 is as near to 1/2 as to 1: the earlier
        *((4, 2), (4, 3), (5, 4)),  # 2/3 is nearer to 1/2 than to 1
        (5, 5),  # a step of the rough one alone
        (6, 5),
    ]
    assert [moment.step for moment in line] == [1, 1, 1, 1, 2, 2, 2, 3, -1]


def test_phases_of_either_drape_keep_their_order():
    none = {"wave_step": np.full(4, -1), "tau": np.ones(4)}
    a = {"phases": ["pick", "lift", "wave", "retreat"]}
    b = {"phases": ["pick", "turn", "wave", "lift"]}
    line = moments([synthetic_view(4, **SMALL, **none, **told) for told in (a, b)])
    assert [moment.phase for moment in line] == [
        *("pick", "turn", "lift", "wave", "lift", "retreat")
    ]
    assert [moment.poses for moment in line] == [
        *((0, 0), (0, 1), (1, 1), (2, 2), (2, 3), (3, 3))
    ]
