"""Other programs that relax the ply as a cloth, and one way to bring them to rest.

Each gets the same mesh, the same bending stiffness and lengths, and begins at the
shape of cubic fibers. They are dynamic: velocities are set to zero whenever the kinetic
energy falls, which needs no damping to be chosen. Masses and time are those of a
relaxation, not of a ply.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from benchmarks.charts._cloth import BENDING, STRETCH, THICKNESS, Cloth
from ply.fiber import Array

REMEDY = "not installed: pip install 'drapeplan[peers]'"
NOT_RUN = {  # looked at, and not taken
    "PyBullet": "its bending springs have no stiffness where a ply is flat",
    "Taichi": "a language, which brings no cloth",
}
MUJOCO = {  # mesh intervals a span, steps, softness along the fibers
    "MuJoCo flex": (7, (100, 400, 1600), 1.0),
    "MuJoCo flex, softer": (7, (100, 400, 1600), 100.0),
    "MuJoCo flex, finer": (14, (400, 1600, 6400), 1.0),
}
NEWTON = {  # solver, time step over the time of the stiffest spring, options
    "Newton mass-spring": ("SolverSemiImplicit", 0.3, {}),
    "Newton XPBD": ("SolverXPBD", 2.0, {"iterations": 10}),
    "Newton VBD": ("SolverVBD", 3.0, {"iterations": 30}),
}
FAR = 0.1  # [m] vertices that move this far have run away


class AbstractPeer(ABC):
    """A cloth in another program."""

    @abstractmethod
    def step(self) -> np.ndarray:
        """Make one step; returns velocities, which may be set to zero in place."""

    @abstractmethod
    def vertices(self) -> Array:
        """Where the vertices are, shape (n, 3), in [m]."""


class MujocoFlex(AbstractPeer):
    """A flex of MuJoCo: an isotropic shell, integrated explicitly."""

    def __init__(self, cloth: Cloth, softer: float) -> None:
        """Give every vertex three slides; those on cups are too heavy to move.

        Args:
            cloth: The mesh.
            softer: How much softer than the ply the shell is along its fibers; it is
                as stiff in shear, since it is isotropic.
        """
        import mujoco

        thickness = THICKNESS * softer**0.5
        young = 12 * BENDING / thickness**3
        step = 0.6 / np.sqrt(8 * young * thickness)
        slides = "".join(
            f'<joint type="slide" axis="{axis}"/>'
            for axis in ("1 0 0", "0 1 0", "0 0 1")
        )
        bodies = "".join(
            f'<body name="v{n}" pos="{x} {y} {z}"><inertial pos="0 0 0" '
            f'mass="{1e9 if held else 1}" diaginertia="1 1 1"/>{slides}</body>'
            for n, ((x, y, z), held) in enumerate(
                zip(cloth.flat.tolist(), cloth.held, strict=True)
            )
        )
        names = " ".join(f"v{n}" for n in range(len(cloth.flat)))
        corners = " ".join(map(str, cloth.triangles.ravel()))
        self._mujoco = mujoco
        self._model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option gravity="0 0 0" timestep="{step}">'
            f'<flag contact="disable"/></option><worldbody>{bodies}</worldbody>'
            f'<deformable><flex name="ply" dim="2" radius="1e-4" body="{names}" '
            f'element="{corners}"><contact selfcollide="none"/><elasticity '
            f'young="{young}" poisson="0" thickness="{thickness}" elastic2d="both"/>'
            "</flex></deformable></mujoco>"
        )
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = (cloth.start - cloth.flat).ravel()
        self._held = np.repeat(cloth.held, 3)
        self._flat = cloth.flat

    def step(self) -> np.ndarray:
        """Make one step; what cups hold stays."""
        self._mujoco.mj_step(self._model, self._data)
        self._data.qvel[self._held] = 0
        return self._data.qvel

    def vertices(self) -> Array:
        """Where the vertices are, in [m]."""
        return self._flat + self._data.qpos.reshape(-1, 3)


class NewtonCloth(AbstractPeer):
    """A cloth of springs and hinges in Newton (NVIDIA, DeepMind, Disney), on the CPU.

    Springs along the fibers and weak diagonals are the weave's membrane; hinges between
    the meshes bend, their diagonals do not. The unit of length is the mesh and that of
    energy the bending stiffness: Newton's hinges mean the same there in each solver.
    """

    def __init__(self, cloth: Cloth, solver: str, step: float, **options: int) -> None:
        """Build the cloth.

        Args:
            cloth: The mesh, whose meshes are squares.
            solver: Name of the solver's class.
            step: Time step, over the time of the stiffest spring.
            options: What the solver takes.
        """
        import warp

        warp.config.log_level = warp.LOG_ERROR  # newton's import reads it
        import newton

        self._mesh = float(cloth.s[1] - cloth.s[0])
        builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
        for place, held in zip(cloth.flat / self._mesh, cloth.held, strict=True):
            mass = 0.0 if held else 1.0
            builder.add_particle(warp.vec3(*place), warp.vec3(0.0), mass, radius=0.01)
        unit = self._mesh**2 / BENDING
        for (i, j), stiffness in zip(
            *map(np.ndarray.tolist, cloth.springs()), strict=True
        ):
            builder.add_spring(i, j, stiffness * unit, 0.0, 0)
        for corners in cloth.hinges.tolist():
            builder.add_edge(*corners, rest=0.0, edge_ke=1.0, edge_kd=0.0)
        builder.color()
        model = builder.finalize(device="cpu")
        self._solver = getattr(newton.solvers, solver)(model, **options)
        self._step = step / np.sqrt(STRETCH * unit)
        self._now, self._next = model.state(), model.state()
        start = (cloth.start / self._mesh).astype(np.float32)
        for state in (self._now, self._next):
            state.particle_q.assign(start)

    def step(self) -> np.ndarray:
        """Make one step."""
        self._now.clear_forces()
        self._solver.step(self._now, self._next, None, None, self._step)
        self._now, self._next = self._next, self._now
        return self._now.particle_qd.numpy()

    def vertices(self) -> Array:
        """Where the vertices are, in [m]."""
        return self._now.particle_q.numpy().astype(float) * self._mesh


class Peer(NamedTuple):
    """How a program is asked: mesh intervals a span, steps looked at, the cloth."""

    per_span: int
    steps: tuple[int, ...]
    make: Callable[[Cloth], AbstractPeer]


def peers(quick: bool = False) -> tuple[dict[str, Peer], dict[str, str]]:
    """Programs that are installed, by the name of their method, and what is missing.

    Args:
        quick: Whether to leave out Newton, which compiles for seconds.
    """
    found: dict[str, Peer] = {}
    missing = dict(NOT_RUN)
    for name, (per_span, steps, softer) in MUJOCO.items():
        if find_spec("mujoco"):
            make = partial(MujocoFlex, softer=softer)
            found[name] = Peer(per_span, steps, make)
    for name, (solver, step, options) in NEWTON.items():
        if quick:
            missing[name] = "not in a quick run"
        elif find_spec("newton"):
            make = partial(NewtonCloth, solver=solver, step=step, **options)
            found[name] = Peer(7, (100, 400, 1600), make)
    for name in {**MUJOCO, **NEWTON}:
        if name not in found:
            missing.setdefault(name, REMEDY)
    return found, missing


def relax(
    peer: AbstractPeer, steps: tuple[int, ...], start: Array
) -> list[tuple[float, Array]]:
    """Let a cloth come to rest, and look at it after so many steps.

    Args:
        peer: The cloth.
        steps: Rising numbers of steps.
        start: Vertices at the start, shape (n, 3), in [m]: those of a cloth that has
            run away are replaced by them.

    Returns:
        Processor time and vertices, in [s] and [m], after each number of steps.
    """
    peer.step()  # loads what it loads
    seen: list[tuple[float, Array]] = []
    energy, spent = 0.0, 0.0
    for first, last in pairwise((0, *steps)):
        begin = time.process_time()
        for _ in range(first, last):
            velocity = peer.step()
            new = float(np.vdot(velocity, velocity))
            if new < energy:
                velocity[:] = 0
                new = 0.0
            energy = new
        spent += time.process_time() - begin
        vertices = peer.vertices()
        lost = not abs(vertices - start).max() < FAR
        seen.append((spent, start if lost else vertices))
    return seen
