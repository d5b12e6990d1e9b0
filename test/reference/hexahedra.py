"""Quadratic hexahedra with 27 nodes and large strains, independent of Pliant. Other files here use this module.

The laws are those of indentation.py. pypardiso makes the linear solver much faster; without it scipy's SuperLU is used.
"""
import numpy as np
import scipy.sparse as sp

try:
    from pypardiso import PyPardisoSolver
except ImportError:
    PyPardisoSolver = None
    from scipy.sparse.linalg import splu

G3 = np.sqrt(0.6) * np.array([-1, 0, 1]), np.array([5, 8, 5]) / 9


def line(x):
    """Quadratic functions in one dimension, and their derivatives."""
    return (np.array([0.5 * x * (x - 1), 1 - x * x, 0.5 * x * (x + 1)]), np.array([x - 0.5, -2 * x, x + 0.5]))


def lame(young, poisson):
    return young / 2 / (1 + poisson), young * poisson / (1 + poisson) / (1 - 2 * poisson)


def corotational(f, mu, lam):
    """Return stress and moduli of deformation gradients (points x 3 x 3)."""
    left, stretch, right = np.linalg.svd(f)
    sign = np.linalg.det(left) * np.linalg.det(right)
    left[:, :, 2] *= sign[:, None]
    stretch[:, 2] *= sign
    r = left @ right
    tension = lam * (stretch.sum(1) - 3)
    flat = r.reshape(-1, 9)
    moduli = 2 * mu * np.eye(9) + lam * flat[:, :, None] * flat[:, None, :]
    for i, j in ((0, 1), (0, 2), (1, 2)):  # the rotation turns with F
        mode = (left[:, :, i, None] * right[:, None, j] - left[:, :, j, None] * right[:, None, i]).reshape(-1, 9)
        factor = (tension - 2 * mu) / np.maximum(stretch[:, i] + stretch[:, j], 0.05)
        moduli += factor[:, None, None] * mode[:, :, None] * mode[:, None, :]
    return 2 * mu * (f - r) + tension[:, None, None] * r, moduli


def neo_hookean(f, mu, lam):
    """As corotational."""
    a, b, c = f[:, 0], f[:, 1], f[:, 2]
    slope = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1)  # of the volume
    volume = (a * slope[:, 0]).sum(1)
    pressure = lam * (volume - 1) - mu / volume
    flat = slope.reshape(-1, 9)
    moduli = mu * np.eye(9) + (lam + mu / volume**2)[:, None, None] * flat[:, :, None] * flat[:, None, :]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # second derivative of the volume
        for p, q, r in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            value = pressure * f[:, i, p]
            for first, second, sign in ((3 * j + q, 3 * k + r, 1), (3 * j + r, 3 * k + q, -1)):
                moduli[:, first, second] += sign * value
                moduli[:, second, first] += sign * value
    return mu * f + pressure[:, None, None] * slope, moduli


LAWS = {law.__name__: law for law in (corotational, neo_hookean)}


class Mesh:
    """A grid of hexahedra from the positions of its planes [m]; `moved` maps the nodes of the grid to their places."""

    def __init__(self, planes, moved=lambda at: at):
        lines = [np.sort(np.concatenate([p, 0.5 * (p[1:] + p[:-1])])) for p in map(np.asarray, planes)]
        self.size = [len(p) for p in lines]
        self.grid = np.stack(np.meshgrid(*lines, indexing="ij"), -1).reshape(-1, 3)
        self.rest = moved(self.grid)
        first = np.stack(np.meshgrid(*[np.arange(0, n - 2, 2) for n in self.size], indexing="ij"), -1).reshape(-1, 3)
        corner = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 3)
        self.element = np.ravel_multi_index(np.moveaxis(first[:, None] + corner, -1, 0), self.size)
        self.top = np.flatnonzero(first[:, 2] == self.size[2] - 3)  # elements; their upper face is every third node
        points = [(a, b, c) for a in range(3) for b in range(3) for c in range(3)]
        value, slope = [line(x) for x in G3[0]], []
        for a, b, c in points:
            (na, da), (nb, db), (nc, dc) = value[a], value[b], value[c]
            slope.append([np.einsum("i,j,k->ijk", *f).ravel() for f in ((da, nb, nc), (na, db, nc), (na, nb, dc))])
        jacobian = np.einsum("qdn,eni->eqid", np.array(slope), self.rest[self.element])
        self.gradient = np.einsum("eqdi,qdn->eqni", np.linalg.inv(jacobian), np.array(slope))
        self.weight = np.linalg.det(jacobian) * np.array([G3[1][a] * G3[1][b] * G3[1][c] for a, b, c in points])
        pair = (self.element[:, :, None] * len(self.rest) + self.element[:, None, :]).ravel()
        unique, self.entry = np.unique(pair, return_inverse=True)
        row, self.column = np.divmod(unique, len(self.rest))
        self.start = np.searchsorted(row, np.arange(len(self.rest) + 1))
        self.solver = None

    def elastic(self, x, law, mu, lam, with_stiffness=True):
        """Return the forces (nodes x 3), and the stiffness of the elements (elements x 27 x 3 x 27 x 3)."""
        force = np.zeros_like(x)
        stiffness = np.empty((len(self.element), 27, 3, 27, 3)) if with_stiffness else None
        for part in np.array_split(np.arange(len(self.element)), len(self.element) // 200 + 1):
            n, gradient, weight = len(part), self.gradient[part], self.weight[part]
            f = np.einsum("eni,eqnj->eqij", x[self.element[part]], gradient, optimize=True)
            stress, moduli = law(f.reshape(-1, 3, 3), mu, lam)
            stress = stress.reshape(n, 27, 3, 3) * weight[..., None, None]
            np.add.at(force, self.element[part], np.einsum("eqij,eqnj->eni", stress, gradient, optimize=True))
            if not with_stiffness: continue
            moduli = moduli.reshape(n, 27, 27, 3) * weight[..., None, None]  # (i, J, k) and L
            half = (moduli @ gradient.transpose(0, 1, 3, 2)).reshape(n, 27, 3, 3, 3, 27)  # q, i, J, k, node
            half = half.transpose(0, 2, 1, 3, 5, 4).reshape(n, 3, 81, 81)
            left = gradient.transpose(0, 2, 1, 3).reshape(n, 1, 27, 81)
            stiffness[part] = (left @ half).reshape(n, 3, 27, 27, 3).transpose(0, 2, 1, 3, 4)
        return force, stiffness

    def solve(self, stiffness, fixed, right, symmetric=True):
        """Solve with the stiffness of the elements; fixed unknowns (nodes x 3) stay."""
        blocks = np.stack([np.bincount(self.entry, stiffness[:, :, i, :, j].ravel(), len(self.column))
                           for i in range(3) for j in range(3)], -1).reshape(-1, 3, 3)
        k = sp.bsr_matrix((blocks, self.column, self.start), (3 * len(self.rest),) * 2).tocsr()
        free = ~fixed.ravel()
        k.data *= np.repeat(free, np.diff(k.indptr)) & free[k.indices]
        k = k + sp.diags(1.0 * ~free)
        right = np.where(free, right.ravel(), 0)
        if not PyPardisoSolver:
            return splu(k.tocsc()).solve(right).reshape(-1, 3)
        self.solver = self.solver or PyPardisoSolver(-2 if symmetric else 11)
        return self.solver.solve(sp.triu(k, format="csr") if symmetric else k.tocsr(), right).reshape(-1, 3)
