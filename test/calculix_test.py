#!/usr/bin/env python3
"""Compute the reference of ContactSolver.SpherePressedAndMovedAsideAsCalculiX (test/pipeline/contact_solver_test.cpp)
with CalculiX (ccx).

A block of 40 x 40 x 20 mm stands on the ground (E = 1 N/mm^2, nu = 0.3, C3D8I). A spherical cap with a radius of 1 m
moves 0.1 mm down into it, with friction 0.3, and then 0.02 mm sideways. Its centre sticks and its border slips. Larger
increments than a tenth do not converge. The results are the forces on the block's foot. Arguments: elements along the
block (8), faces of the cap along one of these (4). The cap's chords lie above the sphere, so the forces grow with the
number of faces. With 8 elements:

    faces         1      2       3      4
    down [N]      2.321  2.486   2.508  2.515
    sideways [N]         0.3102         0.3127

With a tenth of the stiffness against slip, the sideways force is 0.2907 N with two faces.
Exit status 77: ccx is not installed."""
import math
import os
import shutil
import subprocess
import sys
import tempfile

EDGE, HEIGHT, RADIUS, FRICTION = 40.0, 20.0, 1000.0, 0.3  # [mm]
STIFFNESS = 50.0  # [N/mm^3] penalty stiffness of contact and of sticking
DOWN, ASIDE = 0.1, 0.02
ELEMENTS, FINER, KNOWN = 8, 4, (2.5214, 0.31263)  # [N] the values that contact_solver_test uses


def bricks(n, layers, first, place):
    """Return nodes {number: position} and elements {number: nodes} of n x n x layers bricks."""
    number = {}
    nodes, elements = {}, {}
    for k in range(layers + 1):
        for j in range(n + 1):
            for i in range(n + 1):
                number[i, j, k] = first + len(number)
                nodes[number[i, j, k]] = place(i, j, k)
    for k in range(layers):
        for j in range(n):
            for i in range(n):
                around = ((0, 0), (1, 0), (1, 1), (0, 1))
                elements[first + len(elements)] = [number[i + a, j + b, k + c] for c in (0, 1) for a, b in around]
    return nodes, elements, number


def deck(n, finer):
    h, fine = EDGE / n, EDGE / n / finer
    block, soft, of_block = bricks(n, n // 2, 1, lambda i, j, k: (i * h, j * h, k * h))
    cap, stiff, of_cap = bricks(finer * n, 1, 100001, lambda i, j, k: (
        i * fine, j * fine, HEIGHT + 5.0 if k else HEIGHT + RADIUS -
        math.sqrt(RADIUS ** 2 - (i * fine - EDGE / 2) ** 2 - (j * fine - EDGE / 2) ** 2)))
    top = [e for e, nodes in soft.items() if nodes[4] >= of_block[0, 0, n // 2]]
    out = (["*NODE, NSET=ALL"] + ["%d, %.9g, %.9g, %.9g" % ((number,) + place)
                                  for number, place in list(block.items()) + list(cap.items())])
    for name, kind, elements in (("BLOCK", "C3D8I", soft), ("CAP", "C3D8", stiff)):
        out += (["*ELEMENT, TYPE=%s, ELSET=%s" % (kind, name)] + ["%d, %s" % (e, ", ".join(map(str, nodes)))
                                                                  for e, nodes in elements.items()])
    for name, numbers in (("FOOT", [of_block[i, j, 0] for i in range(n + 1) for j in range(n + 1)]),
                          ("MOVED", list(cap))):
        out += ["*NSET, NSET=" + name] + ["%d," % number for number in numbers]
    out += ["*SURFACE, NAME=TISSUE"] + ["%d, S2" % e for e in top]
    out += ["*SURFACE, NAME=TOOL"] + ["%d, S1" % e for e in stiff]
    out += ["*MATERIAL, NAME=SOFT", "*ELASTIC", "1., 0.3", "*SOLID SECTION, ELSET=BLOCK, MATERIAL=SOFT",
            "*MATERIAL, NAME=HARD", "*ELASTIC", "1000., 0.3", "*SOLID SECTION, ELSET=CAP, MATERIAL=HARD",
            "*SURFACE INTERACTION, NAME=TOUCH", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", "%g" % STIFFNESS,
            "*FRICTION", "%g, %g" % (FRICTION, STIFFNESS), "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE",
            "TISSUE, TOOL",
            "*BOUNDARY", "FOOT, 1, 3"]
    for increment, aside in ((0.25, 0.0), (0.1, ASIDE)):
        out += ["*STEP, INC=1000", "*STATIC", "%g, 1., 1e-5, %g" % (increment, increment), "*BOUNDARY",
                "MOVED, 1, 1, %g" % aside, "MOVED, 2, 2, 0.", "MOVED, 3, 3, %g" % -DOWN,
                "*NODE PRINT, NSET=FOOT, TOTALS=ONLY, FREQUENCY=1000", "RF", "*END STEP"]
    return "\n".join(out) + "\n"


def forces(n, finer, folder):
    """Return the forces after the downward and the sideways motion [N]."""
    with open(os.path.join(folder, "deck.inp"), "w") as file:
        file.write(deck(n, finer))
    said = subprocess.run(["ccx", "deck"], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          universal_newlines=True, env=dict(os.environ, OMP_NUM_THREADS="1"))
    with open(os.path.join(folder, "deck.dat")) as file:
        totals = [list(map(float, line.split())) for line in file if len(line.split()) == 3
                  and line.split()[0][-1].isdigit()]
    if len(totals) != 2:
        raise SystemExit("ccx does not converge:\n" + said.stdout[-2000:])
    return totals[0][2], -totals[1][0]


def main():
    if not shutil.which("ccx"):
        print("skipped: ccx is not installed (apt-get install calculix-ccx)")
        return 77
    n, finer = [int(each) for each in sys.argv[1:]] or (ELEMENTS, FINER)
    with tempfile.TemporaryDirectory() as folder:
        found = forces(n, finer, folder)
    print("%d elements along, a cap of %d faces on each: pressed %.5g N, aside %.5g N" % ((n, finer) + found))
    # One face has an error of 8 %, and four faces a sixteenth of that.
    return (0 if sys.argv[1:] or all(abs(force - known) < 0.005 * known for force, known in zip(found, KNOWN))
            else "%g and %g N expected" % KNOWN)


if __name__ == "__main__":
    sys.exit(main())
