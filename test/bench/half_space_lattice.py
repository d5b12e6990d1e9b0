#!/usr/bin/env python3
"""Response of a half-space lattice of unit cells to forces at nodes of its surface, times E* (missing_compliance.c).

The first table is the displacement of a node by a unit force at a distance of 0, 1, sqrt(2) and 2 cells, averaged over
both kinds of nodes and over the directions. The far field of the finite block is replaced by Boussinesq's solution,
1 / (pi r). The second is the variance by which a lattice smooths a pressure: that of a Gaussian pressure of variance 1,
from the difference to a lattice of half the cell size. It needs numpy and scipy.
"""
import itertools

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl

from grasp_compliance import CORNERS, PARITY, stiffness

KAPPA = 1 / (2 * np.sqrt(np.pi))  # mean displacement by a Gaussian pressure of variance 1, times E* over the force


def tetrahedron(x, mu, lame):
    """Return K of a tetrahedron with linear shape functions."""
    inverse = np.linalg.inv(np.hstack([x, np.ones((4, 1))]))
    g, volume = inverse[:3].T, 1 / abs(np.linalg.det(inverse)) / 6
    k = lame * np.einsum("ai,bj->aibj", g, g) + mu * np.einsum("aj,bi->aibj", g, g)
    k += mu * np.einsum("ac,bc,ij->aibj", g, g, np.eye(3))
    return volume * k.reshape(12, 12)


class Block:
    """A block of n x n x depth cells whose surface is free; all other sides are fixed."""

    def __init__(self, hexahedra, nu, n, depth):
        mu, lame = 1, 2 * nu / (1 - 2 * nu)
        self.n, self.depth, self.modulus = n, depth, 2 * (1 + nu) / (1 - nu * nu)
        at = np.array(list(itertools.product(range(n), range(n), range(depth))))
        node = np.stack([self.node(*(at + c).T) for c in CORNERS], 1)
        entries = []
        if hexahedra:
            entries.append((node, stiffness(mu, lame)))
        else:
            for p in range(2):
                for tet in [list(PARITY[p])] + [[t, t ^ 1, t ^ 2, t ^ 4] for t in PARITY[1 - p]]:
                    k = tetrahedron(CORNERS[tet].astype(float), mu, lame)
                    entries.append((node[at.sum(1) % 2 == p][:, tet], k))
        rows, cols, values = [], [], []
        for nodes, k in entries:
            dof = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
            rows.append(np.repeat(dof, dof.shape[1], 1).ravel())
            cols.append(np.tile(dof, (1, dof.shape[1])).ravel())
            values.append(np.tile(k.ravel(), len(nodes)))
        self.size = 3 * (n + 1) ** 2 * (depth + 1)
        place = np.concatenate(rows), np.concatenate(cols)
        k = sp.coo_matrix((np.concatenate(values), place), 2 * (self.size,)).tocsc()
        i, j, z = np.meshgrid(range(n + 1), range(n + 1), range(depth + 1), indexing="ij")
        fixed = (i == 0) | (i == n) | (j == 0) | (j == n) | (z == 0)
        self.free = np.flatnonzero(~np.repeat(fixed.ravel(), 3))
        self.factor = spl.splu(k[self.free][:, self.free], permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0,
                               options={"SymmetricMode": True})

    def node(self, i, j, k):
        return (i * (self.n + 1) + j) * (self.depth + 1) + k

    def press(self, load):
        """Return the displacements times E* by forces on the surface, (n + 1) x (n + 1)."""
        force = np.zeros((self.n + 1, self.n + 1, self.depth + 1, 3))
        force[:, :, self.depth, 2] = load
        out = np.zeros(self.size)
        out[self.free] = self.factor.solve(force.ravel()[self.free])
        return self.modulus * out.reshape(force.shape)[:, :, self.depth, 2]


def responses(hexahedra, nu):
    block, c, far, near = Block(hexahedra, nu, 22, 14), 11, [], np.zeros((2, 4))
    for kind in range(2):
        load = np.zeros((23, 23))
        load[c + kind, c] = 1
        u = np.roll(block.press(load), -kind, 0)
        for x, y in ((4, 0), (0, 4), (3, 3), (4, 1), (1, 4), (5, 0), (4, 3), (3, 4)):
            far.append(u[c + x, c + y] - 1 / np.pi / np.hypot(x, y))
        for d, (x, y) in enumerate(((0, 0), (1, 0), (1, 1), (2, 0))):
            around = itertools.product((-1, 1), (-1, 1), ((x, y), (y, x)))
            near[kind, d] = np.mean([u[c + s * a, c + t * b] for s, t, (a, b) in around])
    return near.mean(0) - np.mean(far)


def smoothing(hexahedra, nu):
    mean = []
    for ratio in (1, 2):
        at = np.arange(12 * ratio + 1) / ratio - 6 - 0.25
        load = np.exp(-0.5 * (at[:, None] ** 2 + at ** 2))
        load[[0, -1]] = load[:, [0, -1]] = 0
        load /= load.sum()
        mean.append(ratio * (load * Block(hexahedra, nu, 12 * ratio, 7 * ratio).press(load)).sum())
    return (mean[1] - mean[0]) / (0.75 * KAPPA / 2)  # KAPPA / sqrt(1 + b) and KAPPA / sqrt(1 + b / 4)


if __name__ == "__main__":
    print("cells       nu    0       1       sqrt(2) 2       smoothing")
    for hexahedra, nu in itertools.product((False, True), (0, 0.3, 0.45, 0.49)):
        values = [*responses(hexahedra, nu), smoothing(hexahedra, nu)]
        name = "hexahedra" if hexahedra else "tetrahedra"
        print("%-11s %-5g" % (name, nu), *("%-7.3f" % v for v in values), flush=True)
