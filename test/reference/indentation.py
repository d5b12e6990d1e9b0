"""Reference forces of bench_force: axisymmetric finite elements with the corotational law, independent of Pliant.

A rigid indenter presses a cylinder of tissue whose bottom is fixed, without friction. Elements are quadrilaterals with
nine nodes, graded towards the contact. The law is W = mu |F - R|^2 + lambda / 2 (tr(R'F) - 3)^2. Points on the surface
get a penalty force, which is stiff enough that the penetration is below a thousandth of the depth.

usage: python3 indentation.py [calibration] [element ...]     calibration: tools and block of bench_force calibrate;
    sizes of the smallest elements [m]; default: 1e-3 5e-4
"""
import sys

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl

YOUNG, POISSON = 10e3, 0.45
G3 = np.sqrt(0.6) * np.array([-1, 0, 1]), np.array([5, 8, 5]) / 9


def shape(x):
    """Quadratic functions in one dimension, and their derivatives."""
    return (np.array([0.5 * x * (x - 1), 1 - x * x, 0.5 * x * (x + 1)]), np.array([x - 0.5, -2 * x, x + 0.5]))


def spaced(length, smallest, growth):
    """Return positions from 0 to length; the distances grow."""
    at, step = [0.0], smallest
    while at[-1] + step < length:
        at.append(at[-1] + step)
        step *= growth
    return np.array(at) * length / at[-1]


class Cylinder:
    """Mesh, and values at its integration points."""

    def __init__(self, radius, height, smallest, fine, growth=1.15):
        inner = np.arange(0, fine, smallest)
        r = np.concatenate([inner, inner[-1] + smallest + spaced(radius - inner[-1] - smallest, smallest, growth)])
        z = -spaced(height, smallest, growth)[::-1]
        middle = lambda v: np.sort(np.concatenate([v, 0.5 * (v[1:] + v[:-1])]))
        r, z = middle(r), middle(z)
        nr, nz = len(r), len(z)
        self.rest = np.stack(np.meshgrid(r, z, indexing="ij"), -1).reshape(-1, 2)
        node = lambda i, j: i * nz + j
        i, j = np.meshgrid(np.arange(0, nr - 2, 2), np.arange(0, nz - 2, 2), indexing="ij")
        self.element = np.stack([node(i + a, j + b) for a in range(3) for b in range(3)], -1).reshape(-1, 9)
        self.line = np.stack([node(np.arange(0, nr - 2, 2) + a, nz - 1) for a in range(3)], -1)
        self.top = [node(k, nz - 1) for k in range(nr)]
        free = np.ones((len(self.rest), 2), bool)
        free[self.rest[:, 1] <= -height + 1e-9] = False
        free[self.rest[:, 0] == 0, 0] = False
        self.free = np.flatnonzero(free.ravel())
        self.points = []
        for x, wx in zip(*G3):
            for y, wy in zip(*G3):
                (a, da), (b, db) = shape(x), shape(y)
                n = np.outer(a, b).ravel()
                d = np.stack([np.outer(da, b).ravel(), np.outer(a, db).ravel()])
                at = self.rest[self.element]
                j = np.einsum("gk,ekd->egd", d, at)
                det = np.linalg.det(j)
                grad = np.einsum("edg,gk->ekd", np.linalg.inv(j), d)
                r0 = at[:, :, 0] @ n
                self.points.append((n, grad, r0, 2 * np.pi * r0 * det * wx * wy))

    def elastic(self, x, mu, lam):
        """Return the forces, and the stiffness as a matrix."""
        force, rows, cols, values = np.zeros(x.size), [], [], []
        dof = (2 * self.element[:, :, None] + np.arange(2)).reshape(len(self.element), -1)
        at = x.reshape(-1, 2)[self.element]
        for n, grad, r0, weight in self.points:
            f = np.einsum("eki,ekj->eij", at, grad)
            s = (at[:, :, 0] @ n) / r0
            p, q = f[:, 0, 0] + f[:, 1, 1], f[:, 1, 0] - f[:, 0, 1]
            t = np.hypot(p, q)
            one = np.zeros((len(s), 5))
            one[:, 0] = one[:, 3] = p / t
            one[:, 2], one[:, 1] = q / t, -q / t
            hoop = np.zeros(5)
            hoop[4] = 1
            flat = np.concatenate([f.reshape(-1, 4), s[:, None]], 1)
            tension = lam * (t + s - 3)
            stress = 2 * mu * (flat - one - hoop) + tension[:, None] * (one + hoop)
            ortho = np.zeros((len(s), 5))  # the gradient of t, turned by 90 degrees
            ortho[:, 0] = ortho[:, 3] = -q / t
            ortho[:, 2], ortho[:, 1] = p / t, -p / t
            both = one + hoop
            moduli = (2 * mu * np.eye(5) + lam * np.einsum("ei,ej->eij", both, both) +
                      ((tension - 2 * mu) / t)[:, None, None] * np.einsum("ei,ej->eij", ortho, ortho))
            b = np.zeros((len(s), 5, 18))
            b[:, 0, 0::2] = b[:, 2, 1::2] = grad[:, :, 0]
            b[:, 1, 0::2] = b[:, 3, 1::2] = grad[:, :, 1]
            b[:, 4, 0::2] = n / r0[:, None]
            np.add.at(force, dof, weight[:, None] * np.einsum("eik,ei->ek", b, stress))
            values.append(np.einsum("e,eik,eij,ejl->ekl", weight, b, moduli, b, optimize=True))
        total = sum(values)
        rows, cols = np.repeat(dof, 18, 1).ravel(), np.tile(dof, (1, 18)).ravel()
        return force, sp.coo_matrix((total.ravel(), (rows, cols)), (x.size, x.size)).tocsr()

    def contact(self, x, gap, stiffness):
        """Return the forces on the surface, their sum along z, and the stiffness.

        gap(r, z): distance, its gradient, its curvature; fraction of the penalty, and its derivative along r."""
        force, total, rows, cols, values = np.zeros(x.size), 0.0, [], [], []
        for s, w in zip(np.linspace(-5 / 6, 5 / 6, 6), np.full(6, 1 / 3)):
            n, d = shape(s)
            at, rest = x.reshape(-1, 2)[self.line], self.rest[self.line]
            weight = 2 * np.pi * (rest[:, :, 0] @ n) * (rest[:, :, 0] @ d) * w * stiffness
            here = np.einsum("k,ekd->ed", n, at)
            distance, normal, curvature, fraction, slope = gap(here)
            on = distance < 0
            deep = np.where(on, -distance, 0) * weight
            pressed = deep * fraction
            dof = (2 * self.line[:, :, None] + np.arange(2)).reshape(-1, 6)
            b = np.einsum("k,ed->ekd", n, normal).reshape(-1, 6)
            np.add.at(force, dof, pressed[:, None] * b)
            total += pressed @ normal[:, 1]
            across = np.stack([normal[:, 1], -normal[:, 0]], 1)
            c = np.einsum("k,ed->ekd", n, across).reshape(-1, 6)
            along = np.zeros_like(b)
            along[:, 0::2] = n
            k = np.einsum("e,ei,ej->eij", weight * fraction * on, b, b)
            k -= np.einsum("e,ei,ej->eij", pressed * curvature, c, c)
            k -= np.einsum("e,ei,ej->eij", deep * slope, b, along)
            rows.append(np.repeat(dof, 6, 1).ravel())
            cols.append(np.tile(dof, (1, 6)).ravel())
            values.append(k.ravel())
        k = sp.coo_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), (x.size, x.size))
        return force, total, k.tocsr()


def sphere(radius, depth):
    def gap(at):
        away = at - np.array([0, radius - depth])
        length = np.hypot(away[:, 0], away[:, 1])
        return length - radius, away / length[:, None], 1 / length, np.ones(len(at)), np.zeros(len(at))
    return gap


def punch(radius, depth, border=1e-4):
    """A flat cylinder with a sharp border. The penalty vanishes at the border, and is complete at this distance.

    A rounded border is no substitute: 0.5 mm of 15 mm make the force 2 to 3 % smaller."""
    def gap(at):
        inside = (radius - at[:, 0]) / border
        slope = np.where((inside > 0) & (inside < 1), -1 / border, 0)
        none = np.zeros(len(at))
        return -at[:, 1] - depth, np.tile([[0.0, -1.0]], (len(at), 1)), none, np.clip(inside, 0, 1), slope
    return gap


def press(mesh, indenter, depths, steps=2):
    """Return the force at each depth."""
    mu, lam = YOUNG / 2 / (1 + POISSON), YOUNG * POISSON / (1 + POISSON) / (1 - 2 * POISSON)
    x, out, before = mesh.rest.ravel().copy(), [], 0.0
    for depth in depths:
        for d in np.linspace(before, depth, steps + 1)[1:]:
            for _ in range(60):
                inside, k = mesh.elastic(x, mu, lam)
                outside, total, kc = mesh.contact(x, indenter(d), 3e8)
                residual = (outside - inside)[mesh.free]
                if np.linalg.norm(residual) < 1e-7 * max(np.linalg.norm(outside), 1e-9):
                    break
                step = spl.spsolve((k + kc)[mesh.free][:, mesh.free].tocsc(), residual)
                x[mesh.free] += step * min(1, 1e-3 / np.abs(step).max())
            else:
                raise SystemExit(f"not converged at a depth of {d} m")
        out.append(total)
        before = depth
    return out


# sphere or punch, its radius [m], depths [m]
TABLE = [(sphere, 0.02, [0.002, 0.004, 0.008]), (punch, 0.015, [0.001, 0.003])]
CALIBRATION = [(sphere, 0.012, [0.0015, 0.003, 0.005]), (sphere, 0.035, [0.002, 0.005, 0.01]),
               (sphere, 0.06, [0.002, 0.006]), (punch, 0.01, [0.001, 0.0025]), (punch, 0.025, [0.001, 0.004])]


if __name__ == "__main__":
    size, height, tools = (0.0790, 0.06, CALIBRATION) if "calibration" in sys.argv else (0.0677, 0.06, TABLE)
    for smallest in [float(a) for a in sys.argv[1:] if a != "calibration"] or [1e-3, 5e-4]:
        for indenter, radius, depths in tools:
            mesh = Cylinder(size, height, smallest, 0.03 if radius > 0.02 else 0.018)
            print(f"elements of {1e3 * smallest:g} mm, {len(mesh.rest)} nodes", flush=True)
            forces = press(mesh, lambda d: indenter(radius, d), depths, 2 if indenter is sphere else 6)
            print(f"  {indenter.__name__} of {1e3 * radius:g} mm:",
                  *(f"{1e3 * d:g} mm {-f:.4f} N," for d, f in zip(depths, forces)), flush=True)
