"""Reference forces of bench_force's cylinder and jaw: three-dimensional finite elements, independent of Pliant.

A rigid capsule lies on a block of 120 x 120 x 60 mm, whose bottom is fixed, and is pressed into it. A quarter of the
block is solved. Elements are quadratic (hexahedra.py), and smaller near the tool. Points on the surface get a penalty
force, with Coulomb friction by return mapping (Wriggers, Computational Contact Mechanics, 5.2).

usage: python3 pressed_block.py sphere|cylinder|jaw [neo_hookean] [friction=0.3] [-v] [element ...]
    Elements: sizes of the smallest elements over the tool's radius. Compare the sphere with indentation.py.
"""
import sys

import numpy as np

from hexahedra import LAWS, Mesh, lame, line

YOUNG, POISSON, EDGE, HEIGHT = 10e3, 0.45, 0.12, 0.06
SAMPLES = 5  # points along an edge of an element's face
# of each tool: radius, half of the axis, depths, increment of the depth [m]; default sizes of elements
TOOLS = {"sphere": (0.02, 0, (0.002, 0.004, 0.008), 1e-3, (0.2,)),
         "cylinder": (0.01, 0.03, (0.002, 0.004, 0.008), 5e-4, (0.4, 0.25)),
         "jaw": (0.0014, 0.01, (0.001, 0.002), 1e-4, (0.6, 0.4))}


def graded(length, fine, smallest, growth=2):
    """Return planes from 0 to length: equal distances within the intervals of `fine`, and growing ones outside."""
    (low, high), step = fine, smallest
    inner = np.linspace(low, high, int(np.ceil((high - low) / smallest - 1e-9)) + 1)

    def outside(far):
        if far <= 0: return np.array([])
        count = max(1, round(np.log(1 + far / step * (growth - 1) / growth) / np.log(growth)))
        at = np.cumsum(growth ** np.arange(1, count + 1))
        return far * at / at[-1]
    return np.concatenate([low - outside(low)[::-1], inner, high + outside(length - high)])


class Contact:
    """Points on the upper faces of a mesh, and what they keep between increments."""

    def __init__(self, mesh):
        self.penalty, self.face = None, mesh.element[mesh.top][:, 2::3]
        at, weight = (np.arange(SAMPLES) + 0.5) / SAMPLES * 2 - 1, (2 / SAMPLES) ** 2
        self.value = np.array([np.outer(line(a)[0], line(b)[0]).ravel() for a in at for b in at])
        du = np.array([np.outer(line(a)[1], line(b)[0]).ravel() for a in at for b in at])
        dv = np.array([np.outer(line(a)[0], line(b)[1]).ravel() for a in at for b in at])
        rest = mesh.rest[self.face]
        self.area = weight * np.linalg.norm(np.cross(np.einsum("sn,eni->esi", du, rest),
                                                     np.einsum("sn,eni->esi", dv, rest)), axis=-1)
        self.before, self.traction = np.einsum("sn,eni->esi", self.value, rest), np.zeros(self.area.shape + (3,))
        self.depth = 0.0

    def evaluate(self, x, tool, friction):
        """Return the forces on the nodes, the force on the tool, the stiffness of the faces, and the tractions."""
        radius, half, depth = tool
        here = np.einsum("sn,eni->esi", self.value, x[self.face])
        axis = np.stack([np.clip(here[..., 0], -half, half), 0 * here[..., 0],
                         np.full(here.shape[:2], HEIGHT + radius - depth)], -1)
        away = here - axis
        length = np.linalg.norm(away, axis=-1)
        normal, on = away / length[..., None], length < radius
        push = np.where(on, self.penalty * (radius - length), 0)
        ident = np.eye(3)
        along = np.zeros_like(normal)  # direction in which the surface of the tool is straight
        along[np.abs(here[..., 0]) < half, 0] = 1
        outer = lambda a, b: a[..., :, None] * b[..., None, :]
        plane = ident - outer(normal, normal)
        moduli = np.where(on[..., None, None], self.penalty * outer(normal, normal), 0) - \
            (push / length)[..., None, None] * (plane - outer(along, along))
        traction = np.zeros_like(here)
        if friction > 0:
            moved = here - self.before - np.array([0, 0, self.depth - depth])
            trial = np.einsum("esij,esj->esi", plane, self.traction - self.penalty * moved)
            size, limit = np.linalg.norm(trial, axis=-1), friction * push
            slips = size > limit
            unit = trial / np.maximum(size, 1e-30)[..., None]
            traction = np.where(slips[..., None], limit[..., None] * unit, trial) * on[..., None]
            ratio = np.where(slips, limit / np.maximum(size, 1e-30), 1)
            moduli += (on * ratio * self.penalty)[..., None, None] * (
                plane - np.where(slips, 1, 0)[..., None, None] * outer(unit, unit))
            moduli += np.where(on & slips, friction * self.penalty, 0)[..., None, None] * outer(unit, normal)
        force = (push[..., None] * normal + traction) * self.area[..., None]
        out = np.zeros_like(x)
        np.add.at(out, self.face, np.einsum("esi,sn->eni", force, self.value))
        stiffness = np.einsum("es,esij,sn,sm->enimj", self.area, moduli, self.value, self.value, optimize=True)
        return out, force.sum((0, 1)), stiffness, (here, traction)

    def keep(self, state, depth):
        self.before, self.traction = state
        self.depth = depth


def press(tool, law, friction, size):
    """Print the force at each depth. `size`: smallest elements over the radius."""
    radius, half, depths, increment, _ = TOOLS[tool]
    wide = radius * min(1, np.sqrt(2 * max(depths) / radius)) * (1 if max(depths) < radius else 1.3)
    smallest = size * radius
    mesh = Mesh([graded(EDGE / 2, (max(half - wide, 0), half + wide), smallest),
                 graded(EDGE / 2, (0, wide), smallest), HEIGHT - graded(HEIGHT, (0, 0.5 * wide), smallest)[::-1]])
    print(f"{tool}, {law.__name__}, friction {friction:g}, elements of {1e3 * smallest:.3g} mm, {len(mesh.rest)} nodes",
          flush=True)
    contact, stiff = Contact(mesh), 1e3 * YOUNG / radius  # penalty [Pa/m]
    fixed = np.stack([(mesh.rest[:, d] < 1e-9) | (mesh.rest[:, 2] < 1e-9) for d in range(3)], -1)
    mu, lam = lame(YOUNG, POISSON)
    x, last, depth = mesh.rest.copy(), mesh.rest.copy(), 0.0
    faces = np.ix_(mesh.top, range(2, 27, 3), range(3), range(2, 27, 3), range(3))

    def evaluate(at, with_stiffness=True):
        inside, stiffness = mesh.elastic(at, law, mu, lam, with_stiffness)
        outside, force, pressed, state = contact.evaluate(at, (radius, half, depth), friction)
        if with_stiffness: stiffness[faces] += pressed
        residual = np.where(fixed, 0, outside - inside)
        return residual, np.linalg.norm(residual) / max(np.linalg.norm(outside), 1e-9), stiffness, force, state

    for target in depths:
        for depth in np.linspace(depth, target, int(np.ceil((target - depth) / increment - 1e-6)) + 1)[1:]:
            x, last = 2 * x - last, x.copy()
            for contact.penalty, tolerance in ((0.03 * stiff, 1e-2), (stiff, 1e-5 if depth == target else 1e-3)):
                for iteration in range(60):
                    residual, error, stiffness, force, state = evaluate(x)
                    if "-v" in sys.argv: print(f"    {1e3 * depth:.2f} mm, {iteration}: {error:.1e}", flush=True)
                    if error < tolerance: break
                    step = mesh.solve(stiffness, fixed, residual, friction == 0)
                    step *= min(1, 2 * increment / np.abs(step).max())
                    part, first = 1.0, np.sum(residual * step)
                    for _ in range(5):  # line search for less work (Matthies and Strang, IJNME 14:1613, 1979)
                        left = np.sum(evaluate(x + part * step, False)[0] * step)
                        if left > -0.8 * first: break
                        part *= max(0.1, first / (first - left))
                    x = x + part * step
                else:
                    raise SystemExit(f"not converged at a depth of {depth} m")
            contact.keep(state, depth)
        print(f"  {1e3 * depth:g} mm: {-4 * force[2]:.4f} N", flush=True)


def main():
    words = sys.argv[1:]
    law = LAWS["neo_hookean" if "neo_hookean" in words else "corotational"]
    friction = float(next((w.split("=")[1] for w in words if w.startswith("friction=")), 0))
    for tool in TOOLS:
        if tool in words:
            for size in [float(w) for w in words if w[0].isdigit()] or TOOLS[tool][-1]:
                press(tool, law, friction, size)


if __name__ == "__main__":
    main()
