"""Time of the ply model: the 6 x 8 ply at 10 mm with its overhang."""

from collections.abc import Callable

import numpy as np

from benchmarks import coupled
from benchmarks._timing import median_time
from benchmarks._truth import run_truth
from ply.coupled import CoupledModel
from ply.fiber import quartic_fibers
from ply.grid import CupGrid
from ply.shape import PlySampling, ply_fibers

GRID = CupGrid(rows=8, columns=6, pitch=0.11, half_width=0.02)
STEP, OVERHANG, TAKE_UP = 0.01, 0.02, 0.8e-3  # [m] as in the default scene
BATCHES = (1, 64)
FIBERS = 10_000


def run(quick: bool) -> dict:
    """Every rung against finite elements, and times of the whole ply."""
    return run_truth(quick) | coupled_patches(quick) | whole_ply(quick)


def coupled_patches(quick: bool) -> dict:
    """Milliseconds a coupled patch alone and in a batch, and what finite elements take.

    The benchmark `coupled` has more of it.
    """
    names, seconds = coupled.cells()
    held = np.stack([np.load(coupled.DATA / f"{n}.npz")["poses"] for n in names])
    p, frames = held[..., :3, 3] / 1e3, held[..., :3, :3]
    shift = np.random.default_rng(0).normal(size=(len(p), 4, 1))
    moved = p + coupled.STEP * shift * frames[..., 2]
    model = CoupledModel(coupled.GRID)
    before = model.solve(p, frames)
    tasks: dict[str, Callable[[slice], object]] = {
        "cold": lambda k: model.solve(p[k], frames[k]),
        "warm": lambda k: model.solve(moved[k], frames[k], start=before[k]),
    }
    repeats, result = 2 if quick else 9, {}
    for name, task in tasks.items():
        alone = [
            median_time(lambda k=k, task=task: task(slice(k, k + 1)), repeats)
            for k in range(len(p))
        ]
        whole = median_time(lambda task=task: task(slice(None)), repeats)
        result[f"coupled_{name}_ms_per_patch"] = 1e3 * float(np.mean(alone))
        result[f"coupled_{name}_batched_ms_per_patch"] = 1e3 * whole / len(p)
        ratio = float(np.mean(seconds) / np.mean(alone))
        result[f"finite_elements_over_coupled_{name}_patch"] = ratio
    return result


def whole_ply(quick: bool) -> dict:
    """Milliseconds a pose, for fibers and points, and fibers a second."""
    repeats = 20 if quick else 200
    sampling = PlySampling.regular(GRID, STEP, OVERHANG)
    result: dict[str, float] = {"points": sampling.s.size * sampling.t.size}
    for batch in BATCHES:
        cups = poses(batch)
        fibers = ply_fibers(GRID, *cups)
        modal = ply_fibers(GRID, *cups, model="modal")
        tasks: dict[str, Callable[[], object]] = {
            "quartic_fibers": lambda cups=cups: ply_fibers(GRID, *cups),
            "modal_fibers": lambda cups=cups: ply_fibers(GRID, *cups, model="modal"),
            "banded_fibers": lambda cups=cups: ply_fibers(GRID, *cups, take_up=TAKE_UP),
            "points": lambda cups=cups, fibers=fibers: sampling.points(fibers, *cups),
            "modal_points": lambda cups=cups, modal=modal: sampling.points(
                modal, *cups
            ),
            "modal_gemm": products(batch),
        }
        times = {
            name: 1e3 * median_time(task, 1 + repeats // batch) / batch
            for name, task in tasks.items()
        }
        for name, milliseconds in times.items():
            result[f"batch_{batch}_{name}_ms_per_pose"] = milliseconds
        whole = times["quartic_fibers"] + times["points"]
        result[f"batch_{batch}_whole_ply_ms_per_pose"] = whole
        whole = times["modal_fibers"] + times["modal_points"]
        result[f"batch_{batch}_whole_ply_modal_ms_per_pose"] = whole
        ratio = whole / times["modal_gemm"]
        result[f"batch_{batch}_whole_ply_modal_over_gemm"] = ratio
    ends = fiber_ends(FIBERS)
    seconds = median_time(lambda: quartic_fibers(*ends, GRID.s_length), repeats // 5)
    return result | {"quartic_fibers_per_second": FIBERS / seconds}


def products(batch: int) -> Callable[[], object]:
    """One bare product with the operations of those that make the modal surface.

    Per pose and coordinate: curves of 3 fibers with 7 terms, in rows and columns, at
    all lines, and their weighted sums at all points.
    """
    sampling = PlySampling.regular(GRID, STEP, OVERHANG)
    n_s, n_t = sampling.s.size, sampling.t.size
    along_s = 3 * GRID.rows * (7 * (GRID.columns - 1) + 2 * GRID.columns) * n_s
    along_t = 3 * GRID.columns * 7 * (GRID.rows - 1) * n_t
    sums = n_s * n_t * 3 * (GRID.rows + GRID.columns)
    inner = 42  # as the products have: 18 to 49
    constant = np.random.default_rng(0).normal(size=(inner, n_s))
    rows = 3 * batch * (along_s + along_t + sums) // (inner * n_s)
    terms = np.random.default_rng(1).normal(size=(rows, inner))
    return lambda: terms @ constant


def poses(batch: int) -> tuple[np.ndarray, np.ndarray]:
    """Cups on a paraboloid of radii 1 and 2 m, with a little noise."""
    rng = np.random.default_rng(0)
    s, t = (GRID.centers - GRID.centers.mean(axis=0)).T
    height = -(s**2) / 2 - t**2 / 4
    positions = np.stack([s, t, height], axis=-1)
    positions = positions + 1e-4 * rng.normal(size=(batch, *positions.shape))
    normal = np.stack([s, t / 2, np.ones_like(s)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    x = np.stack([normal[:, 2], 0 * s, -normal[:, 0]], axis=-1)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    frames = np.stack([x, np.cross(normal, x), normal], axis=-1)
    return positions, np.broadcast_to(frames, (batch, *frames.shape))


def fiber_ends(count: int) -> tuple[np.ndarray, ...]:
    """Ends and unit tangents of disturbed fibers, each of shape (count, 3)."""
    rng = np.random.default_rng(0)
    along = np.array([1.0, 0.0, 0.0])
    tangents = along + 0.1 * rng.normal(size=(2, count, 3))
    tangents /= np.linalg.norm(tangents, axis=-1, keepdims=True)
    chords = GRID.s_length * (along + 0.01 * rng.normal(size=(count, 3)))
    return np.zeros((count, 3)), chords, tangents[0], tangents[1]
