"""Kernels of the distance grid: exact distances to triangles, and reading the grid."""

import numba
import numpy as np

MISSING = -32768  # stored where no distance is known


@numba.njit(cache=True)
def closest(x, y, z, t):  # type: ignore[no-untyped-def]  # numba
    """Vector from the nearest point of a triangle t, and its feature [Ericson2005].

    Features: 0 the face, 1-3 the edges 01, 12, 20, 4-6 the corners.
    """
    ux, uy, uz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    vx, vy, vz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    px, py, pz = x - t[0, 0], y - t[0, 1], z - t[0, 2]
    d1, d2 = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    if d1 <= 0 and d2 <= 0:
        return px, py, pz, 4
    uu, uv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz
    vv = vx * vx + vy * vy + vz * vz
    d3, d4 = d1 - uu, d2 - uv  # the same from corner 1
    d5, d6 = d1 - uv, d2 - vv  # and from corner 2
    along, across, feature = 0.0, 0.0, 0
    vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if d3 >= 0 and d4 <= d3:
        along, feature = 1.0, 5
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        along, feature = d1 / (d1 - d3), 1
    elif d6 >= 0 and d5 <= d6:
        across, feature = 1.0, 6
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        across, feature = d2 / (d2 - d6), 3
    elif va <= 0 and d4 >= d3 and d5 >= d6:
        across, feature = (d4 - d3) / ((d4 - d3) + (d5 - d6)), 2
        along = 1 - across
    else:
        along, across = vb / (va + vb + vc), vc / (va + vb + vc)
    px -= along * ux + across * vx
    py -= along * uy + across * vy
    pz -= along * uz + across * vz
    return px, py, pz, feature


@numba.njit(cache=True, inline="always")
def _side(x, y, z, n):  # type: ignore[no-untyped-def]  # numba
    """1 on the side that a normal looks to, or -1."""
    return 1.0 if x * n[0] + y * n[1] + z * n[2] >= 0 else -1.0


@numba.njit(cache=True, error_model="numpy")
def band_distances(corners, features, origin, step, shape, band):  # type: ignore[no-untyped-def]  # numba
    """Signed distances of all nodes nearer than a band, and their triangles.

    Beyond, the distance is infinite and the triangle -1.

    Args: triangles (f, 3, 3), their outward normals (f, 7, 3), origin (3,), step,
    shape and band, in [m].
    """
    square = np.full(shape, band * band)
    out, owner = np.full(shape, np.inf), np.full(shape, -1)
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for f in range(len(corners)):
        a, b, c = corners[f, 0], corners[f, 1], corners[f, 2]
        n = features[f, 0]
        for k in range(3):
            least = min(a[k], b[k], c[k]) - band - origin[k]
            most = max(a[k], b[k], c[k]) + band - origin[k]
            low[k] = max(0, int(np.ceil(least / step)))
            high[k] = min(shape[k] - 1, int(np.floor(most / step)))
        for i in range(low[0], high[0] + 1):
            x = origin[0] + step * i
            for j in range(low[1], high[1] + 1):
                y = origin[1] + step * j
                first, last = low[2], high[2]
                level = n[0] * (a[0] - x) + n[1] * (a[1] - y) + n[2] * a[2]
                if abs(n[2]) > 1e-6:  # nodes within the band about the plane
                    middle, half = level / n[2] - origin[2], band / abs(n[2])
                    first = max(first, int(max((middle - half) / step, 0.0)))
                    last = min(last, int(max((middle + half) / step + 1, -1.0)))
                for k in range(first, last + 1):
                    z = origin[2] + step * k
                    away = n[2] * z - level
                    if away * away >= square[i, j, k]:
                        continue
                    vx, vy, vz, feature = closest(x, y, z, corners[f])
                    d = vx * vx + vy * vy + vz * vz
                    if d < square[i, j, k]:
                        square[i, j, k] = d
                        sign = _side(vx, vy, vz, features[f, feature])
                        out[i, j, k], owner[i, j, k] = sign * np.sqrt(d), f
    return out, owner


@numba.njit(cache=True)
def sweep(corners, features, origin, step, values, owner):  # type: ignore[no-untyped-def]  # numba
    """Fill in the nodes beyond the band, in place, from the triangles of neighbors.

    Four passes, to and fro, hand the nearest triangle on from node to node.
    """
    nx, ny, nz = values.shape
    count = nx * ny * nz
    for turn in range(4):
        for at in range(count):
            n = count - 1 - at if turn % 2 else at
            i, j, k = n // (ny * nz), n // nz % ny, n % nz
            x, y = origin[0] + step * i, origin[1] + step * j
            z = origin[2] + step * k
            for m in range(27):
                p, q, r = i + m // 9 - 1, j + m // 3 % 3 - 1, k + m % 3 - 1
                if p < 0 or q < 0 or r < 0 or p >= nx or q >= ny or r >= nz:
                    continue
                f = owner[p, q, r]
                if f < 0 or f == owner[i, j, k]:
                    continue
                vx, vy, vz, feature = closest(x, y, z, corners[f])
                d = np.sqrt(vx * vx + vy * vy + vz * vz)
                if d < abs(values[i, j, k]):
                    values[i, j, k] = d * _side(vx, vy, vz, features[f, feature])
                    owner[i, j, k] = f


@numba.njit(cache=True, inline="always")
def _mixed(values, i, j, k, a, b, c):  # type: ignore[no-untyped-def]  # numba
    """Trilinear value in a cell."""
    i, j, k = np.uintp(i), np.uintp(j), np.uintp(k)  # no test for wrapping around
    ii, jj, kk = i + np.uintp(1), j + np.uintp(1), k + np.uintp(1)
    f00 = (1 - c) * values[i, j, k] + c * values[i, j, kk]
    f01 = (1 - c) * values[i, jj, k] + c * values[i, jj, kk]
    f10 = (1 - c) * values[ii, j, k] + c * values[ii, j, kk]
    f11 = (1 - c) * values[ii, jj, k] + c * values[ii, jj, kk]
    return (1 - a) * ((1 - b) * f00 + b * f01) + a * ((1 - b) * f10 + b * f11)


@numba.njit(cache=True, inline="always")
def _place(x, y, z, lattice, shape):  # type: ignore[no-untyped-def]  # numba
    """Cell of a point, clipped to the grid, the shares passed, and how far beyond."""
    u, v = (x - lattice[0]) / lattice[3], (y - lattice[1]) / lattice[3]
    w = (z - lattice[2]) / lattice[3]
    cu, cv = min(max(u, 0.0), shape[0] - 1.0), min(max(v, 0.0), shape[1] - 1.0)
    cw = min(max(w, 0.0), shape[2] - 1.0)
    i, j = min(int(cu), shape[0] - 2), min(int(cv), shape[1] - 2)
    k = min(int(cw), shape[2] - 2)
    return i, j, k, cu - i, cv - j, cw - k, u - cu, v - cv, w - cw


@numba.njit(cache=True, inline="always")
def _far(x, y, z, coarse, lattice):  # type: ignore[no-untyped-def]  # numba
    """Distance from the coarse grid; beside it, as if straight on."""
    i, j, k, a, b, c, du, dv, dw = _place(x, y, z, lattice, coarse.shape)
    d = lattice[4] * _mixed(coarse, i, j, k, a, b, c)
    beyond = lattice[3] * np.sqrt(du * du + dv * dv + dw * dw)
    return d + beyond if d >= 0 else d - beyond


@numba.njit(cache=True, inline="always")
def _distance(x, y, z, fine, cells, near, coarse, far):  # type: ignore[no-untyped-def]  # numba
    """Distance of one point, from the fine grid where it is known there."""
    inverse = 1 / near[3]
    u, v, w = (x - near[0]) * inverse, (y - near[1]) * inverse, (z - near[2]) * inverse
    nx, ny, nz = cells.shape
    if u >= 0 and v >= 0 and w >= 0 and u < nx and v < ny and w < nz:
        i, j, k = int(u), int(v), int(w)
        if cells[np.uintp(i), np.uintp(j), np.uintp(k)]:
            return near[4] * _mixed(fine, i, j, k, u - i, v - j, w - k)
    return _far(x, y, z, coarse, far)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def distances(points, fine, cells, near, coarse, far):  # type: ignore[no-untyped-def]  # numba
    """Distances of points of shape (n, 3), shape (n,)."""
    out = np.empty(len(points))
    for m in range(len(points)):
        x, y, z = points[m, 0], points[m, 1], points[m, 2]
        out[m] = _distance(x, y, z, fine, cells, near, coarse, far)
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def gaps(points, tops, refine, fine, cells, near, coarse, far):  # type: ignore[no-untyped-def]  # numba
    """Distances, or where more the heights over what is seen below, shape (n,)."""
    out = np.empty(len(points))
    inverse, one = refine / near[3], np.uintp(1)
    nx, ny = tops.shape
    for m in range(len(points)):
        x, y, z = points[m, 0], points[m, 1], points[m, 2]
        d = _distance(x, y, z, fine, cells, near, coarse, far)
        out[m] = d
        u, v = (x - near[0]) * inverse, (y - near[1]) * inverse
        if not (u >= 0 and v >= 0 and u < nx - 1 and v < ny - 1):
            continue
        i, j = np.uintp(u), np.uintp(v)
        a, b = u - np.floor(u), v - np.floor(v)
        f00, f01 = tops[i, j], tops[i, j + one]
        f10, f11 = tops[i + one, j], tops[i + one, j + one]
        low, top = (1 - b) * f00 + b * f01, (1 - b) * f10 + b * f11
        height = z - ((1 - a) * low + a * top)
        if height > d:  # never so where nothing is below: tops are infinite there
            along, across = top - low, (1 - a) * (f01 - f00) + a * (f11 - f10)
            slope = min((along * along + across * across) * inverse * inverse, 1.0)
            out[m] = max(d, height / np.sqrt(1 + slope))
    return out


@numba.njit(cache=True)
def seen_heights(fine, near, refine):  # type: ignore[no-untyped-def]  # numba
    """Where lines from above meet the surface first; infinite where they do not.

    The lines stand at the steps of the grid divided by a whole number.
    """
    nx, ny, nz = fine.shape
    out = np.full(((nx - 1) * refine + 1, (ny - 1) * refine + 1), np.inf)
    for p in range(out.shape[0]):
        i = min(p // refine, nx - 2)
        a = p / refine - i
        for q in range(out.shape[1]):
            j = min(q // refine, ny - 2)
            b = q / refine - j
            above, known = 0.0, False
            for k in range(nz - 1, -1, -1):
                f00, f01 = fine[i, j, k], fine[i, j + 1, k]
                f10, f11 = fine[i + 1, j, k], fine[i + 1, j + 1, k]
                if min(min(f00, f01), min(f10, f11)) == MISSING:
                    known = False
                    continue
                d = (1 - a) * ((1 - b) * f00 + b * f01) + a * ((1 - b) * f10 + b * f11)
                if d <= 0 and known:
                    out[p, q] = near[2] + near[3] * (k - d / (above - d))
                    break
                above, known = d, d > 0
    return out


@numba.njit(cache=True, inline="always")
def _slope(values, i, j, k, a, b, c, du, dv, dw):  # type: ignore[no-untyped-def]  # numba
    """Derivatives of a trilinear value along three axes; zero along those clipped."""
    gx = _mixed(values, i, j, k, 1.0, b, c) - _mixed(values, i, j, k, 0.0, b, c)
    gy = _mixed(values, i, j, k, a, 1.0, c) - _mixed(values, i, j, k, a, 0.0, c)
    gz = _mixed(values, i, j, k, a, b, 1.0) - _mixed(values, i, j, k, a, b, 0.0)
    return gx * (du == 0), gy * (dv == 0), gz * (dw == 0)


@numba.njit(cache=True, nogil=True)
def gradients(points, fine, cells, near, coarse, far):  # type: ignore[no-untyped-def]  # numba
    """Gradients of what `distances` gives, shape (n, 3)."""
    out = np.empty((len(points), 3))
    for m in range(len(points)):
        x, y, z = points[m, 0], points[m, 1], points[m, 2]
        i, j, k, a, b, c, du, dv, dw = _place(x, y, z, near, fine.shape)
        if du == 0 and dv == 0 and dw == 0 and cells[i, j, k]:
            s = near[4] / near[3]
            g = _slope(fine, i, j, k, a, b, c, du, dv, dw)
            out[m, 0], out[m, 1], out[m, 2] = s * g[0], s * g[1], s * g[2]
            continue
        i, j, k, a, b, c, du, dv, dw = _place(x, y, z, far, coarse.shape)
        s = far[4] / far[3]
        g = _slope(coarse, i, j, k, a, b, c, du, dv, dw)
        beyond = max(np.sqrt(du * du + dv * dv + dw * dw), 1e-300)
        sign = 1.0 if _mixed(coarse, i, j, k, a, b, c) >= 0 else -1.0
        out[m, 0] = s * g[0] + sign * du / beyond
        out[m, 1] = s * g[1] + sign * dv / beyond
        out[m, 2] = s * g[2] + sign * dw / beyond
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def in_cells(points, cells, x0, y0, step_x, step_y):  # type: ignore[no-untyped-def]  # numba
    """Whether points of shape (n, 3) lie over cells of a plane grid, shape (n,)."""
    out = np.zeros(len(points), np.bool_)
    nx, ny = cells.shape
    for m in range(len(points)):
        u, v = (points[m, 0] - x0) / step_x, (points[m, 1] - y0) / step_y
        if u >= 0 and v >= 0 and u < nx and v < ny:
            out[m] = cells[int(u), int(v)]
    return out
