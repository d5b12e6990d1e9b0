"""References of large_strains_test: quadratic elements (hexahedra.py), independent of Pliant.

usage: python3 large_strains.py cook|twist [corotational] [neo_hookean] [elements ...]
    cook: Cook's membrane in plane strain, shear modulus 0.4225 N/mm^2, nu 0.3, a dead load of 1 N per mm of thickness
        on its end: upward displacement of the end's middle. Elements: along each side; default: 8 16 24
    twist: a bar of 20 x 20 x 60 mm, 10 kPa, nu 0.45, whose one end is fixed and the other one turned by 90 degrees
        about the bar's axis: torque, and axial force on the turned end. Elements: across the bar; default: 4 6 8
"""
import sys

import numpy as np

from hexahedra import LAWS, Mesh, lame


def newton(mesh, x, fixed, load, law, moduli):
    """Solve for the free unknowns; change x. Return the forces of the elements on the nodes."""
    for _ in range(50):
        force, stiffness = mesh.elastic(x, law, *moduli)
        residual = np.where(fixed, 0, load - force)
        if np.linalg.norm(residual) < 1e-9 * np.linalg.norm(force): return force
        x += mesh.solve(stiffness, fixed, residual)
    raise SystemExit("Newton's method does not converge")


def cook(law, cells, parts=4):
    """Return the displacement [m]."""
    part = np.linspace(0, 1, cells + 1)
    along, across, thickness = 0.048 * part ** 1.5, 0.5 * (1 - np.cos(np.pi * part)), 0.004  # finer at the corners

    def moved(at):
        x, y = at[:, 0], at[:, 1]
        return np.stack([x, 44 / 48 * x + y * (0.044 - 28 / 48 * x), at[:, 2]], 1)
    mesh = Mesh([along, across, [0, thickness]], moved)
    fixed = np.stack([mesh.rest[:, 0] < 1e-9, mesh.rest[:, 0] < 1e-9, mesh.rest[:, 2] > -1], -1)
    load = np.zeros_like(mesh.rest)
    at_end = mesh.rest[mesh.element[:, 18:]]  # their last face
    end = np.all(at_end[:, :, 0] > 0.048 - 1e-9, axis=1)
    simpson = np.array([1, 4, 1]) / 6
    height = at_end[end, 6, 1] - at_end[end, 0, 1]
    np.add.at(load[:, 1], mesh.element[end, 18:], 1e3 * thickness / 0.016 * height[:, None] *
              np.outer(simpson, simpson).ravel())
    x, moduli = mesh.rest.copy(), lame(2 * 1.3 * 0.4225e6, 0.3)
    for part in range(1, parts + 1):
        newton(mesh, x, fixed, load * part / parts, law, moduli)
    middle = np.argmin(np.linalg.norm(mesh.rest - [0.048, 0.052, 0], axis=1))
    return (x - mesh.rest)[middle, 1]


def twist(law, cells, parts=6):
    """Return torque [N m] and axial force [N] on the turned end."""
    side, length = 0.02, 0.06
    mesh = Mesh([np.linspace(-side / 2, side / 2, cells + 1)] * 2 + [np.linspace(0, length, 3 * cells + 1)])
    turned = mesh.rest[:, 2] > length - 1e-9
    fixed = np.repeat(((mesh.rest[:, 2] < 1e-9) | turned)[:, None], 3, 1)
    x, moduli = mesh.rest.copy(), lame(10e3, 0.45)
    for _ in range(parts):
        angle = np.pi / 2 / parts * mesh.rest[:, 2] / length
        c, s = np.cos(angle), np.sin(angle)
        x = np.stack([c * x[:, 0] - s * x[:, 1], s * x[:, 0] + c * x[:, 1], x[:, 2]], 1)
        force = newton(mesh, x, fixed, np.zeros_like(x), law, moduli)[turned]
    at = x[turned]
    return np.sum(at[:, 0] * force[:, 1] - at[:, 1] * force[:, 0]), np.sum(force[:, 2])


def main():
    words = sys.argv[1:]
    elements = [int(w) for w in words if w.isdigit()]
    for law in [LAWS[w] for w in words if w in LAWS] or LAWS.values():
        for cells in elements or ((8, 16, 24) if "cook" in words else (4, 6, 8)):
            if "cook" in words:
                print(f"{law.__name__}, {cells} x {cells} elements: {1e3 * cook(law, cells):.3f} mm", flush=True)
            else:
                torque, force = twist(law, cells)
                print(f"{law.__name__}, {cells} elements across: {1e3 * torque:.4f} mN m, {1e3 * force:.3f} mN",
                      flush=True)


if __name__ == "__main__":
    main()
