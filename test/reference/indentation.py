"""Reference forces of bench_force: axisymmetric finite elements with one of two laws, independent of Pliant.

A rigid indenter presses a cylinder of tissue whose bottom is fixed, without friction. Elements are quadrilaterals with
nine nodes, graded towards the contact. Points on the surface get a penalty force, which is stiff enough that the
penetration is below a thousandth of the depth. The laws are

    corotational: W = mu |F - R|^2 + lambda / 2 (tr(R'F) - 3)^2
    neo_hookean:  W = mu / 2 (|F|^2 - 3) - mu ln J + lambda / 2 (J - 1)^2     (equation 10 of [C])

usage: python3 indentation.py [neo_hookean] [calibration] [element ...]     calibration: tools and block of
    bench_force calibrate; sizes of the smallest elements [m]; default: the corotational law, 1e-3 5e-4
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


def corotational(flat, mu, lam):
    """Return stress and moduli of deformation gradients (elements x 5): in the plane by rows, and the hoop stretch."""
    p, q, s = flat[:, 0] + flat[:, 3], flat[:, 2] - flat[:, 1], flat[:, 4]
    t = np.hypot(p, q)
    both, ortho = np.zeros(flat.shape), np.zeros(flat.shape)  # R, and the gradient of t, turned by 90 degrees
    both[:, 0] = both[:, 3] = p / t
    both[:, 2], both[:, 1], both[:, 4] = q / t, -q / t, 1
    ortho[:, 0] = ortho[:, 3] = -q / t
    ortho[:, 2], ortho[:, 1] = p / t, -p / t
    tension = lam * (t + s - 3)
    stress = 2 * mu * (flat - both) + tension[:, None] * both
    return stress, (2 * mu * np.eye(5) + lam * np.einsum("ei,ej->eij", both, both) +
                    ((tension - 2 * mu) / t)[:, None, None] * np.einsum("ei,ej->eij", ortho, ortho))


def neo_hookean(flat, mu, lam):
    """As corotational."""
    a, b, c, d, s = flat.T
    det = a * d - b * c
    volume = det * s
    slope = np.stack([d * s, -c * s, -b * s, a * s, det], 1)  # of the volume
    bend = np.zeros((len(flat), 5, 5))  # second derivative of the volume
    for i, j, value in ((0, 3, s), (1, 2, -s), (0, 4, d), (1, 4, -c), (2, 4, -b), (3, 4, a)):
        bend[:, i, j] = bend[:, j, i] = value
    pressure = lam * (volume - 1) - mu / volume
    return mu * flat + pressure[:, None] * slope, (
        mu * np.eye(5) + (lam + mu / volume**2)[:, None, None] * np.einsum("ei,ej->eij", slope, slope) +
        pressure[:, None, None] * bend)


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

    def elastic(self, x, law, mu, lam):
        """Return the forces, and the stiffness as a matrix."""
        force, rows, cols, values = np.zeros(x.size), [], [], []
        dof = (2 * self.element[:, :, None] + np.arange(2)).reshape(len(self.element), -1)
        at = x.reshape(-1, 2)[self.element]
        for n, grad, r0, weight in self.points:
            f = np.einsum("eki,ekj->eij", at, grad)
            s = (at[:, :, 0] @ n) / r0
            stress, moduli = law(np.concatenate([f.reshape(-1, 4), s[:, None]], 1), mu, lam)
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


def press(mesh, law, indenter, depths, increment=2.5e-4):
    """Return the force at each depth. The depth grows by the increment, and an iteration moves nodes by it at most, so
    that no element inverts on the way."""
    mu, lam = YOUNG / 2 / (1 + POISSON), YOUNG * POISSON / (1 + POISSON) / (1 - 2 * POISSON)
    x, out, before = mesh.rest.ravel().copy(), [], 0.0
    for depth in depths:
        for d in np.linspace(before, depth, int(np.ceil((depth - before) / increment - 1e-6)) + 1)[1:]:
            for _ in range(60):
                inside, k = mesh.elastic(x, law, mu, lam)
                outside, total, kc = mesh.contact(x, indenter(d), 3e8)
                residual = (outside - inside)[mesh.free]
                if np.linalg.norm(residual) < 1e-7 * max(np.linalg.norm(outside), 1e-9):
                    break
                step = spl.spsolve((k + kc)[mesh.free][:, mesh.free].tocsc(), residual)
                x[mesh.free] += step * min(1, increment / np.abs(step).max())
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
    law = neo_hookean if "neo_hookean" in sys.argv else corotational
    for smallest in [float(a) for a in sys.argv[1:] if a[0].isdigit()] or [1e-3, 5e-4]:
        for indenter, radius, depths in tools:
            mesh = Cylinder(size, height, smallest, 0.03 if radius > 0.02 else 0.018)
            print(f"{law.__name__}, elements of {1e3 * smallest:g} mm, {len(mesh.rest)} nodes", flush=True)
            forces = press(mesh, law, lambda d: indenter(radius, d), depths)
            print(f"  {indenter.__name__} of {1e3 * radius:g} mm:",
                  *(f"{1e3 * d:g} mm {-f:.4f} N," for d, f in zip(depths, forces)), flush=True)
