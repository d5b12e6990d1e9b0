#!/usr/bin/env python3
"""Compliance of a grasped ball in an infinite lattice of hexahedra, divided by the exact value.

The ball carries a uniform force. In an infinite elastic solid, the mean displacement of its points follows from
Kelvin's solution: (5 - 6 nu) / (20 pi mu (1 - nu) r) per unit force. The lattice takes the same force by trilinear
weights, or by the weights of each cube's tetrahedra. The table shows the mean and the range over random centres.
It needs numpy.

  grasp_compliance.py [--poisson 0.45]
"""
import argparse
import itertools

import numpy as np

SIDE, POINTS, CENTRES, MIX = 48, 9, 16, 0.25
CORNERS = np.array([[v & 1, v >> 1 & 1, v >> 2 & 1] for v in range(8)])
PARITY = ((0, 3, 5, 6), (1, 2, 4, 7))


def stiffness(mu, lame):
    """Return K of a cube of edge 1 as in src/fem/element/NUMERICS.md; the last 9 of 33 modes are condensed."""
    gauss = 0.5 + np.array([-1, 1]) / 12 ** 0.5
    shear, dilation, mean = np.zeros((33, 33)), np.zeros((33, 33)), np.zeros(33)
    for at in itertools.product(gauss, gauss, gauss):
        f = np.where(CORNERS, at, 1 - np.array(at))
        sign = 2 * CORNERS - 1
        gradients = [sign[:, d] * f[:, (d + 1) % 3] * f[:, (d + 2) % 3] for d in range(3)]
        gradients = np.vstack([np.transpose(gradients), np.diag(2 * (2 * np.array(at) - 1))])
        strain = np.zeros((3, 3, 33))
        for node, component in itertools.product(range(11), range(3)):
            strain[component, :, 3 * node + component] += gradients[node] / 2
            strain[:, component, 3 * node + component] += gradients[node] / 2
        trace = np.einsum("iim->m", strain)
        shear += (2 * mu * np.einsum("ijm,ijn->mn", strain, strain) - 2 / 3 * mu * np.outer(trace, trace)) / 8
        dilation += np.outer(trace, trace) / 8
        mean += trace / 8
    bulk = lame + 2 / 3 * mu
    full = shear + bulk * dilation
    modes = full[:24, :24] - full[:24, 24:] @ np.linalg.solve(full[24:, 24:], full[24:, :24])
    return (1 - MIX) * (shear + bulk * np.outer(mean, mean))[:24, :24] + MIX * modes


def response(k):
    """Return the mean of the three diagonal entries of Green's function, in the Fourier space of the lattice."""
    wave = np.meshgrid(*[2 * np.pi * np.fft.fftfreq(SIDE)] * 3, indexing="ij")
    matrix = np.zeros((SIDE, SIDE, SIDE, 3, 3), complex)
    for a, b in itertools.product(range(8), range(8)):
        phase = sum(w * d for w, d in zip(wave, CORNERS[b] - CORNERS[a]))
        matrix += np.exp(1j * phase)[..., None, None] * k[3 * a:3 * a + 3, 3 * b:3 * b + 3]
    matrix[0, 0, 0] = np.eye(3)
    out = np.trace(np.linalg.inv(matrix), axis1=3, axis2=4).real / 3
    out[0, 0, 0] = 0
    return out


def weights(radius, centre, trilinear):
    line = np.linspace(-1, 1, POINTS)
    points = np.array(list(itertools.product(line, line, line)))
    points = centre + SIDE // 2 + radius * points[(points ** 2).sum(1) <= 1 + 1e-9]
    out = np.zeros((SIDE, SIDE, SIDE))
    for cell, at in zip(np.floor(points).astype(int), points % 1):
        corners, share = range(8), np.prod(np.where(CORNERS, at, 1 - at), axis=1)
        if not trilinear:
            parity = cell.sum() % 2
            corners = PARITY[parity]
            for tip in PARITY[1 - parity]:
                if np.where(CORNERS[tip], 1 - at, at).sum() < 1:
                    corners = (tip, tip ^ 1, tip ^ 2, tip ^ 4)
            share = np.linalg.solve(np.vstack([CORNERS[list(corners)].T, np.ones(4)]), [*at, 1])
        for corner, part in zip(corners, share):
            out[tuple(cell + CORNERS[corner])] += part / len(points)
    return np.abs(np.fft.fftn(out)) ** 2 / SIDE ** 3


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poisson", type=float, default=0.45)
    nu = parser.parse_args().poisson
    green = response(stiffness(1, 2 * nu / (1 - 2 * nu)))
    random = np.random.default_rng(1)

    def exact(radius):
        return (5 - 6 * nu) / (20 * np.pi * (1 - nu) * radius)

    # the periodic lattice differs from the infinite one by a constant; a large ball shows it
    constant = np.mean([(weights(6, random.random(3), True) * green).sum() for _ in range(4)]) - exact(6)
    print("radius / cell   trilinear             tetrahedra")
    for radius in (0.5, 0.75, 1, 1.2, 1.5, 2, 3):
        found = []
        for _ in range(CENTRES):
            centre = random.random(3) + random.integers(0, 2, 3)
            found.append([((weights(radius, centre, t) * green).sum() - constant) / exact(radius)
                          for t in (True, False)])
        found = np.array(found)
        print("%-15g" % radius + "   ".join("%.2f (%.2f to %.2f)" % (v.mean(), v.min(), v.max()) for v in found.T),
              flush=True)


if __name__ == "__main__":
    main()
