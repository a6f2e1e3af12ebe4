"""A synthetic drape to look at, and a browser to look at it with."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from viewer.plan_view import Mesh, PlanView

ROWS, COLUMNS, PITCH, OVERHANG = 8, 6, 0.110, 0.040  # [m] ply: 630 x 850 mm
RADIUS_X, RADIUS_Y = 1.2, 2.5  # [m] of the mold, a paraboloid
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",  # WebGL 2 without a graphics card
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--no-first-run",
    "--force-device-scale-factor=1",
)
PATIENCE = 30_000  # [ms] software rendering on a busy machine
LOCAL = ("file://", "data:", "blob:", "about:")


def height(x, y):
    """Height of the mold above its origin [m]."""
    return -(x**2) / (2 * RADIUS_X) - y**2 / (2 * RADIUS_Y)


def mold_mesh(nx=41, ny=51, size=(0.8, 1.0)):
    x, y = (np.linspace(-s / 2, s / 2, n) for s, n in zip(size, (nx, ny), strict=True))
    X, Y = np.meshgrid(x, y)
    i = np.arange(nx * ny).reshape(ny, nx)
    a, b, c, d = i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return np.stack([X, Y, height(X, Y)], axis=-1).reshape(-1, 3), faces


def box_mesh(name, low, high, color):
    corners = np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij"))
    vertices = corners.reshape(3, -1).T.astype(float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6]]
    quads += [[0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)])
    return Mesh(name, vertices, faces, np.tile(color, (len(vertices), 1)))


def synthetic_view(
    poses=24, samples=(43, 32), origin=(0.75, 0.0, 0.2), scale=1.0, **changes
):
    """A ply lowered on a paraboloid in a wave from its middle rows, by a formula."""
    nt, ns = samples
    T = np.linspace(-1, 1, nt)[:, None] * ((ROWS - 1) * PITCH / 2 + OVERHANG)
    S = np.linspace(-1, 1, ns) * ((COLUMNS - 1) * PITCH / 2 + OVERHANG) + 0 * T
    T = T + 0 * S
    cup_t = np.repeat((np.arange(ROWS) - (ROWS - 1) / 2) * PITCH, COLUMNS)
    cup_s = np.tile((np.arange(COLUMNS) - (COLUMNS - 1) / 2) * PITCH, ROWS)
    front = np.linspace(-0.05, (ROWS - 1) * PITCH / 2 + 0.08, poses)[:, None, None]

    def lift(t):
        return 0.9 * np.maximum(0, np.abs(t) - front) ** 2

    gap = lift(T[None])
    points = np.stack(
        np.broadcast_arrays(S[None], T[None], height(S, T)[None] + gap), -1
    )
    rise = lift(cup_t[None, None])[:, 0]
    cups = np.stack(
        np.broadcast_arrays(cup_s, cup_t, height(cup_s, cup_t) + rise), axis=-1
    )
    ring = np.abs(cup_t) - front[:, 0]
    states = np.where(ring < 0, 2, np.where(ring < 0.055, 1, 0)).astype(np.uint8)
    slope = np.stack([cup_s / RADIUS_X, cup_t / RADIUS_Y, 1 + 0 * cup_t], axis=-1)
    n = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    s = np.cross([0.0, 1.0, 0.0], n)
    s /= np.linalg.norm(s, axis=-1, keepdims=True)
    frames = np.stack([s, np.cross(n, s), n], axis=-1)
    placement = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (poses, 1, 1))
    placement[:, 2, 3] = 0.40 + np.linspace(0.1, 0, poses)
    universals = np.broadcast_to(
        np.stack([cup_s, cup_t, 0 * cup_s], axis=-1), cups.shape
    ).copy()
    universals[..., 2] = placement[:, 2, 3, None] - 0.06
    vertices, faces = mold_mesh()
    index = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    links = np.concatenate(
        [
            np.stack([index[:, :-1], index[:, 1:]], -1).reshape(-1, 2),
            np.stack([index[:-1], index[1:]], -1).reshape(-1, 2),
        ]
    )
    arm = box_mesh("column", (-0.06, -0.06, 0), (0.06, 0.06, 0.6), (0.4, 0.55, 0.65))
    arm_at = np.tile(np.eye(4), (poses, 1, 1, 1))
    arm_at[:, 0, :3, 3] = placement[:, :3, 3]
    shift = np.asarray(origin, float)
    placement[:, :3, 3] = scale * placement[:, :3, 3] + shift
    arm_at[:, 0, :3, 3] = placement[:, :3, 3]
    arm_at[:, :, :3, :3] *= scale
    mold_at = np.eye(4)
    mold_at[:3, 3] = shift
    names = [f"{i + 1},{j + 1}" for i in range(ROWS) for j in range(COLUMNS)]
    view = {
        "title": "Panel, radii 1.2 and 2.5 m",
        "subtitle": "48 cups in a wave from the middle rows",
        "verdict": ["Touches outward from the start.", "Margin 0.62 mm at step 3."],
        "good": True,
        "mold_vertices": scale * vertices + shift,
        "mold_faces": faces,
        "ply_points": scale * points + shift,
        "gap": scale * gap,
        "labels": [f"step {k // 4 + 1}, pose {k + 1}" for k in range(poses)],
        "phases": ["approach" if k < 3 else "wave" for k in range(poses)],
        "wave_step": np.array([-1 if k < 3 else k // 4 + 1 for k in range(poses)]),
        "tau": np.array(
            [(k + 1) / 3 if k < 3 else k % 4 / 4 + 0.25 for k in range(poses)]
        ),
        "cup_positions": scale * cups + shift,
        "cup_rotations": np.broadcast_to(frames, (*cups.shape, 3)),
        "cup_states": states,
        "cup_names": names,
        "universals": scale * universals + shift,
        "balls": scale * (cups + 0.005 * n) + shift,
        "interlinks": links,
        "half_width": 0.02 * scale,
        "tool_placement": placement,
        "platform_size": (0.63 * scale, 0.85 * scale),
        "arm_meshes": [arm],
        "arm_placements": arm_at,
        "mold_placement": mold_at,
    }
    return PlanView(**{**view, **changes})


def find_browser():
    """Path of an installed Chromium, or None."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return os.environ.get("DRAPEPLAN_BROWSER") or next(
        filter(None, map(shutil.which, names)), None
    )


@contextmanager
def launch() -> Iterator:
    """Run a headless browser; without one the test skips, or fails if one must be."""
    path = find_browser()
    if path is None:
        reason = "no Chromium found: install one or set DRAPEPLAN_BROWSER"
        if os.environ.get("DRAPEPLAN_REQUIRE_BROWSER") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=path, headless=True, args=list(FLAGS)
        )
        yield browser
        browser.close()


class OpenPage:
    """A preview in a browser, with everything it logs and asks for."""

    def __init__(self, browser, path: Path, address="", size=(960, 640)):
        """Open a file without network and wait until its content stands."""
        self.path = path
        viewport = {"width": size[0], "height": size[1]}
        self.context = browser.new_context(viewport=viewport, offline=True)
        self.page = self.context.new_page()
        self.errors, self.requests = [], []
        self.page.on("console", self._log)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda socket: self.requests.append(socket.url))
        self.page.set_default_timeout(PATIENCE)
        self.page.goto(path.as_uri() + address)
        self.wait("document.body.dataset.ready")
        self.run(
            "() => { window.drape = window.app?.drapes[0];"
            " window.viewer = window.drape?.viewer; }"
        )

    def _log(self, message):
        if message.type in ("error", "warning") and "GPU stall" not in message.text:
            self.errors.append(message.text)

    def run(self, script, argument=None):
        return self.page.evaluate(script, argument)

    def rest(self):
        """Draw no more: one picture is enough where no pixel is read.

        Drawing by software takes its time.
        """
        self.run(
            "() => { for (const { viewer } of app.drapes)"
            ' Object.defineProperty(viewer, "needs_render",'
            " { get: () => false, set() {} }) }"
        )

    def wait(self, condition):
        """Wait until a condition holds, looking at every frame.

        The page's policy forbids what Playwright's own waiting does with a text.
        """
        self.run(
            "() => new Promise((done, fail) => {"
            f" setTimeout(() => fail(new Error('waited 30 s')), {PATIENCE});"
            f" const look = () => ({condition}) ? done() : requestAnimationFrame(look);"
            " look(); })"
        )

    def external(self):
        """Requests that would leave this machine."""
        return [url for url in self.requests if not url.startswith(LOCAL)]

    def pixels(self):
        """Colors of the drawing, shape (height, width, 3).

        Rendered and read in one task: afterwards the browser clears the buffer.
        """
        import base64
        import io

        from PIL import Image

        data = self.run(
            "() => { viewer.render(); "
            "return viewer.renderer.domElement.toDataURL('image/png') }"
        )
        image = Image.open(io.BytesIO(base64.b64decode(data.split(",", 1)[1])))
        return np.asarray(image.convert("RGB")).astype(int)
