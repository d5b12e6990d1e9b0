#!/usr/bin/env python3
"""Compare nearly incompressible tissue with Taylor-Hood elements, which do not lock: quadratic displacements, linear
pressures (Boffi, Brezzi, Fortin, Mixed Finite Element Methods and Applications, 8.8). Needs scikit-fem; pypardiso
makes it faster.

  taylor_hood.py cube PLIANT_DEFORM [--refine 1] [--poisson 0.45 0.499 0.4999]
      a cube of 60 mm, 10 kPa, under gravity, which a grasp pulls by 29 mm: held point, force, and probes on meshes
      with cells of 5 and 2.5 mm against the reference, both with the corotational law. --refine 2 changes its force
      by 0.05 %.
  taylor_hood.py cook [--poisson 0.3 0.4999]
      Cook's membrane with small strains: upward displacement of the middle of its end
"""
import argparse
import csv
import os
import struct
import subprocess
import tempfile

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.helpers import ddot, div, sym_grad

try:
    from pypardiso import spsolve
except ImportError:
    from scipy.sparse.linalg import splu

    def spsolve(matrix, right):
        return splu(matrix.tocsc()).solve(right)

YOUNG, DENSITY, SIDE, RADIUS, SPRING, PULL = 1e4, 1000, 0.06, 0.006, 1000, 0.029
HELD = np.array([0.03, 0.03, 0.055])
PROBES = {"side": (0.03, 0.055, 0.045), "below": (0.03, 0.03, 0.035), "corner": (0.0549, 0.0549, 0.055),
          "held": HELD.tolist()}


class Cube:
    """Half of the cube, x < 30 mm, by symmetry. Unknowns: displacements of the P2 nodes, then pressures."""

    def __init__(self, poisson, refine):
        self.mu = YOUNG / 2 / (1 + poisson)
        self.lame = YOUNG * poisson / (1 + poisson) / (1 - 2 * poisson)
        planes = ([0, 12, 21, 26, 30], [0, 12, 21, 26, 30, 34, 39, 48, 60], [0, 16, 31, 42, 49, 55, 60])
        lines = [1e-3 * np.interp(np.arange((len(p) - 1) * refine + 1) / refine, np.arange(len(p)), p) for p in planes]
        self.basis = skfem.Basis(skfem.MeshTet.init_tensor(*lines), skfem.ElementTetP2(), intorder=4)
        pressures = self.basis.with_element(skfem.ElementTetP1())
        self.weight = self.basis.dx
        shape = self.weight.shape
        self.gradient = np.array([np.broadcast_to(f[0].grad, (3,) + shape) for f in self.basis.basis])
        self.gradient = self.gradient.transpose(2, 3, 0, 1).copy()
        self.value = np.array([np.broadcast_to(f[0].value, shape) for f in pressures.basis]).transpose(1, 2, 0).copy()
        quadratic = np.array([np.broadcast_to(f[0].value, shape) for f in self.basis.basis]).transpose(1, 2, 0)
        self.node, nodes = self.basis.element_dofs.T, self.basis.N
        self.rows = (3 * self.node[:, :, None] + np.arange(3)).reshape(len(self.node), 30)
        self.pressure_rows = 3 * nodes + pressures.element_dofs.T
        self.count, self.moving = 3 * nodes + pressures.N, 3 * nodes
        x = self.basis.doflocs.T
        fixed = np.zeros(self.count, bool)
        fixed[:self.moving].reshape(-1, 3)[x[:, 2] < 1e-9] = True
        fixed[3 * np.where(x[:, 0] > SIDE / 2 - 1e-9)[0]] = True
        self.free = np.where(~fixed)[0]
        self.load = np.zeros(self.count)
        np.add.at(self.load, 3 * self.node + 1, 9.81 * DENSITY * np.einsum("eq,eqa->ea", self.weight, quadratic))
        self.mass = np.einsum("eq,eqa,eqb->eab", self.weight, self.value, self.value)
        self.grasp = self.blob()
        self.centre = self.grasp @ x
        self.u = np.zeros(self.count)

    def blob(self):
        """Weights of the nodes in the mean position of a grasped ball: of its 21 points along a diameter in tissue."""
        k = np.arange(-10, 11) / 10
        points = np.stack(np.meshgrid(k, k, k, indexing="ij"), -1).reshape(-1, 3)
        points = HELD + RADIUS * points[(points ** 2).sum(1) <= 1 + 1e-12]
        points = points[points[:, 2] <= SIDE + 1e-12]
        points[:, 0] = np.minimum(points[:, 0], SIDE - points[:, 0])
        return np.asarray(self.basis.probes(points.T).mean(axis=0)).ravel()

    def displacement(self, weights):
        return np.array([weights @ self.u[d:self.moving:3] for d in range(3)])

    def probe(self, at):
        half = [min(at[0], SIDE - at[0]) - 1e-9, at[1], at[2]]
        moved = self.displacement(np.asarray(self.basis.probes(np.array(half)[:, None]).todense()).ravel())
        return moved * ([-1, 1, 1] if at[0] > SIDE / 2 else [1, 1, 1])

    def assemble(self):
        """Return the residual of 2 mu (F - R) + p R and tr(R'F - I) - p / lambda, and its derivative."""
        p = np.einsum("eqa,ea->eq", self.value, self.u[self.pressure_rows])
        f = np.einsum("eai,eqaj->eqij", self.u[:self.moving].reshape(-1, 3)[self.node], self.gradient) + np.eye(3)
        left, stretch, right = np.linalg.svd(f)
        sign = np.linalg.det(left) * np.linalg.det(right)
        left[..., 2] *= sign[..., None]
        stretch[..., 2] *= sign
        r = left @ right
        elements, points = self.weight.shape
        stress = 2 * self.mu * (f - r) + p[..., None, None] * r
        out = np.zeros(self.count)
        np.add.at(out, self.rows, np.einsum("eq,eqij,eqaj->eai", self.weight, stress, self.gradient).reshape(-1, 30))
        np.add.at(out, self.pressure_rows, np.einsum("eq,eqa->ea", self.weight * (stretch.sum(-1) - 3 - p / self.lame),
                                                     self.value))
        c = np.zeros((elements, points, 9, 9))
        c[..., range(9), range(9)] = 2 * self.mu
        for i, j in ((0, 1), (0, 2), (1, 2)):  # the rotation turns with F
            twist = np.zeros((3, 3))
            twist[i, j], twist[j, i] = -0.5 ** 0.5, 0.5 ** 0.5
            mode = (left @ twist @ right).reshape(elements, points, 9)
            factor = (p - 2 * self.mu) * 2 / np.maximum(stretch[..., i] + stretch[..., j], 0.05)
            c += factor[..., None, None] * mode[..., :, None] * mode[..., None, :]
        b = np.zeros((elements, points, 9, 30))
        for i in range(3):
            for j in range(3):
                b[:, :, 3 * i + j, i::3] = self.gradient[..., j]
        k = np.zeros((elements, 34, 34))
        k[:, :30, :30] = np.einsum("eq,eqmx,eqmn,eqny->exy", self.weight, b, c, b, optimize=True)
        k[:, :30, 30:] = np.einsum("eq,eqmx,eqm,eqb->exb", self.weight, b, r.reshape(elements, points, 9), self.value,
                                   optimize=True)
        k[:, 30:, :30] = k[:, :30, 30:].transpose(0, 2, 1)
        k[:, 30:, 30:] = -self.mass / self.lame
        every = np.concatenate([self.rows, self.pressure_rows], 1)
        at = (np.repeat(every, 34, 1).ravel(), np.tile(every, (1, 34)).ravel())
        return out, sp.coo_matrix((k.ravel(), at), shape=(self.count, self.count)).tocsr()

    def solve(self, target):
        """Newton's method; the grasp's spring is added by the Woodbury formula. Return the force on the whole cube."""
        hold = np.zeros((self.count, 3))
        for d in (1, 2):
            hold[d:self.moving:3, d] = self.grasp
        hold, half = hold[self.free], SPRING / 2
        for _ in range(40):
            inner, matrix = self.assemble()
            force = half * (target - self.centre - self.displacement(self.grasp))
            residual = (self.load - inner)[self.free] + hold @ force
            found = spsolve(matrix[self.free][:, self.free], np.column_stack([hold, residual]))
            response, step = found[:, :3], found[:, 3]
            step = step - response @ np.linalg.solve(np.eye(3) / half + hold.T @ response, hold.T @ step)
            largest = np.abs(step[self.free < self.moving]).max()
            self.u[self.free] += min(1, 0.006 / largest) * step
            if largest < 1e-7:
                return 2 * force[2]
        raise SystemExit("Newton's method does not converge")


def reference(poisson, refine):
    """Return the force [N], the height of the held ball and of the probes [mm]."""
    cube = Cube(poisson, refine)
    for part in range(11):
        force = cube.solve(cube.centre + [0, 0, PULL * part / 10])
    return [force, 1e3 * cube.displacement(cube.grasp)[2]] + [1e3 * cube.probe(at)[2] for at in PROBES.values()]


def write_scene(folder, poisson):
    """Write a scan of 30 x 30 x 30 voxels of 2 mm, materials, the scene, and its tool's path."""
    header = struct.pack("<i36x8h14x2h2x8f3f", 348, 3, 30, 30, 30, 1, 1, 1, 1, 4, 16, 1, 2, 2, 2, 0, 0, 0, 0, 352, 1, 0)
    header += bytes(252 - len(header)) + struct.pack("<2h6f12f", 0, 1, *[0] * 6, *(-2, 0, 0, -1), *(0, -2, 0, -1),
                                                     *(0, 0, 2, 1))
    header += bytes(344 - len(header)) + b"n+1\0" + bytes(4)
    with open(folder + "/cube.nii", "wb") as out:
        out.write(header + np.full(30 ** 3, 100, "<i2").tobytes())
    with open(folder + "/materials.yaml", "w") as out:
        out.write("materials:\n  - {name: air, young_modulus: 10, poisson_ratio: 0, density: 1, empty: true, "
                  "range: [-1.0e+9, 0]}\n  - {name: block, young_modulus: %g, poisson_ratio: %g, density: %g, "
                  "range: [0, 1.0e+9]}\n" % (YOUNG, poisson, DENSITY))
    with open(folder + "/cube.yaml", "w") as out:
        out.write("material: {file: materials.yaml}\nmesh: {coarse_cells: [6, 6, 6], ratio: 2}\n"
                  "grasp: {radius: %g}\nmodel: {gravity: [0, 9.81, 0]}\n"
                  "fixed:\n  planes: [{point: [0, 0, 0.0001], normal: [0, 0, 1]}]\n" % RADIUS)
    with open(folder + "/path.yaml", "w") as out:
        out.write("tools:\n  - {name: t, grasp: %s, motion: [{time: 0, offset: [0, 0, 0]}, "
                  "{time: 1, offset: [0, 0, 0]}, {time: 1.6, offset: [0, 0, %g]}]}\nprobes:\n" % (HELD.tolist(), PULL))
        for name, at in PROBES.items():
            out.write("  - {name: %s, at: %s}\n" % (name, list(at)))


def simulate(program, folder, *options):
    """Return the same figures as reference(), and the number of evaluations."""
    out = folder + "/out"
    sets = [word for option in options for word in ("--set", option)]
    subprocess.run([program, "cube.yaml", "--scan", "cube.nii", "--tools", "path.yaml", "--out", out, "--steps", "82"] +
                   sets, cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    steps, tool, probes = (list(csv.DictReader(open(out + "/%s.csv" % name))) for name in ("steps", "tools", "probes"))
    moved = {row["probe"]: 1e3 * float(row["moved_z_m"]) for row in probes}
    held = 1e3 * (float(tool[-1]["held_z_m"]) - float(tool[0]["held_z_m"]))
    return [float(tool[-1]["force_z_n"]), held] + [moved[name] for name in PROBES], \
        sum(int(row["iterations"]) for row in steps)


def compare_cube(program, refine, ratios):
    print("%-20s %8s %8s %s evaluations" % ("", "force N", "held mm", " ".join("%8s" % p for p in PROBES)))
    for poisson in ratios:
        right = reference(poisson, refine)
        print("%-20s %s" % ("nu %g, Taylor-Hood" % poisson, " ".join("%8.3f" % v for v in right)), flush=True)
        for name, options in (("hexahedra, 5 mm", ["element/kind=hexahedra"]),
                              ("hexahedra, 2.5 mm", ["element/kind=hexahedra", "mesh/ratio=4"]),
                              ("tetrahedra, 5 mm", ["element/kind=linear"]),
                              ("tetrahedra, 2.5 mm", ["element/kind=linear", "mesh/ratio=4"])):
            with tempfile.TemporaryDirectory() as folder:
                write_scene(folder, poisson)
                found, evaluations = simulate(os.path.abspath(program), folder, *options)
            errors = " ".join("%+7.1f%%" % (100 * (a / b - 1)) for a, b in zip(found, right))
            print("%-20s %s %d" % (name, errors, evaluations), flush=True)


def cook(poisson, cells, mu=0.4225):
    """Return the displacement [mm] of the membrane with shear modulus mu [N/mm^2], 1 N on its end, per 1 mm."""
    mesh = skfem.MeshTri.init_tensor(*[np.linspace(0, 1, cells + 1)] * 2)
    x, y = mesh.p[0] ** 1.5, 0.5 * (1 - np.cos(np.pi * mesh.p[1]))  # finer at the clamped corners
    mesh = skfem.MeshTri(np.array([48 * x, 44 * x + y * (44 - 28 * x)]), mesh.t)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP2()), intorder=4)
    pressures = basis.with_element(skfem.ElementTriP1())
    k = skfem.BilinearForm(lambda u, v, w: 2 * mu * ddot(sym_grad(u), sym_grad(v))).assemble(basis)
    b = skfem.BilinearForm(lambda u, q, w: div(u) * q).assemble(basis, pressures)
    m = skfem.BilinearForm(lambda p, q, w: p * q).assemble(pressures)
    end = mesh.facets_satisfying(lambda at: at[0] > 48 - 1e-6)
    facets = skfem.FacetBasis(mesh, skfem.ElementVector(skfem.ElementTriP2()), facets=end)
    load = skfem.LinearForm(lambda v, w: v[1] / 16).assemble(facets)
    matrix = sp.bmat([[k, b.T], [b, -m * (1 - 2 * poisson) / (2 * mu * poisson)]]).tocsr()
    held = basis.get_dofs(lambda at: at[0] < 1e-9).all()
    u = skfem.solve(*skfem.condense(matrix, np.concatenate([load, np.zeros(pressures.N)]), D=held))
    middle = np.where((abs(basis.doflocs[0] - 48) < 1e-6) & (abs(basis.doflocs[1] - 52) < 1e-6))[0]
    return u[middle[1]]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", choices=("cube", "cook"))
    parser.add_argument("program", nargs="?")
    parser.add_argument("--refine", type=int, default=1)
    parser.add_argument("--poisson", type=float, nargs="+")
    args = parser.parse_args()
    if args.case == "cook":
        for poisson in args.poisson or (0.3, 0.4999):
            print("nu %g, 16 / 32 / 64 cells: %s mm" % (poisson, " / ".join("%.3f" % cook(poisson, n)
                                                                            for n in (16, 32, 64))), flush=True)
    elif args.program:
        compare_cube(args.program, args.refine, args.poisson or (0.45, 0.499, 0.4999))
    else:
        parser.error("cube needs the program pliant_deform")


if __name__ == "__main__":
    main()
