#!/usr/bin/env python3
"""Call pliant.py at random: with right and wrong values, closed simulations, and states of other models. Exceptions are
allowed, crashes are not.

    python_calls.py SEED COUNT
"""
import copy
import faulthandler
import gc
import os
import pickle
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "src", "python"))
import numpy as np
import pliant

SMALL = {"mesh/coarse_cells": [5, 4, 4], "mesh/ratio": 1, "solver/threads": 1, "solver/iterations": 3}
MODELS = [dict(SMALL, **more) for more in ({}, {"cut/kind": "sever"}, {"cut/kind": "subdivide"},
                                           {"solver/kind": "tled", "cut/kind": "sever", "element/kind": "linear"},
                                           {"model/method": "averaged", "mesh/ratio": 2, "cut/kind": "sever"})]
LIVER = np.array([-0.08, -0.06, 0.09])
SKIP = {"model", "styles", "drives"}


class Calls:
    def __init__(self, seed):
        self.random = np.random.RandomState(seed)
        self.models = [pliant.Model(scan="phantom:48x36x36", options=options) for options in MODELS]
        self.sims = [pliant.Sim(model=model) for model in self.models]
        self.tools = [sim.tool("forceps") for sim in self.sims]
        self.arrays = []

    def pick(self, values):
        return values[self.random.randint(len(values))]

    def wrong(self):
        return self.pick([None, "text", b"bytes", -1, 0, 10 ** 30, np.nan, np.inf, [], [[]], {}, object(),
                          np.zeros((0, 3)), np.full(3, np.nan), np.zeros((2, 2)),
                          [1, 2], ["a", "b", "c"], 1j, lambda: 0, pliant, self.pick(self.sims), self.pick(self.tools),
                          np.zeros(3, object), slice(3)])

    def point(self):
        return LIVER + self.random.uniform(-0.05, 0.05, 3) * self.pick([0, 0.2, 1, 100])

    def right(self, name):
        """Return valid arguments of a function; about half of them are in its range."""
        sim, number = self.pick(self.sims), self.pick([0.0, 0.01, 1.0, 50.0, -1.0, 1e300, np.nan])
        camera = np.eye(3) * [20, 20, 1], pliant.look_at(LIVER + [0.01, -0.2, 0], LIVER), (8, 6)
        return {"move": (self.point(), self.pick([None, [0, 0, 0, 1], [0, 0, 0, 0], self.random.normal(size=4)])),
                "grasp": (self.pick([None, self.point()]),),
                "displacement": (self.pick(["resample", "tissue", "itk"]),),
                "drive": (self.pick(["spring", "rigid", "force", "glue"]), self.pick([None, self.point()])),
                "spring": (number, number), "radius": (number,),
                "blade": self.pick([("scalpel",), ("spoon",), (None, self.random.uniform(-0.01, 0.01, (2, 3)))]),
                "shape": (self.pick(["probe", "spoon", None, "none.yaml"]), self.point()), "jaw": (number,),
                "cutting": (self.pick([True, False]),),
                "cut": ([self.point(), self.point()], [0, 0.1, 0.01]), "restore": (sim,),
                "limits": (self.pick([1, 3, 0, -5]), number),
                "scalar": (self.pick(["von_mises", "volume_ratio", "contact_force"]),),
                "tool": (self.pick(["forceps", "knife", "a" * 60, "x\0y"]),), "wrench": ("knife",), "render": camera,
                "radiograph": (self.point(), 0.1, 0.2, (8, 6)),
                "nodes": None, "gravity": None}.get(name, ())

    def value(self, sim, name):
        if name == "gravity":
            return self.pick([[0, 0, -9.81], [0, 0, 0], [np.inf, 0, 0]])
        return sim.rest + self.random.normal(size=3) * self.pick([0, 1e-3, 1e6, np.nan])

    def call(self):
        kind = self.random.randint(20)
        if kind == 0:
            n = self.random.randint(len(self.sims))
            self.sims[n].close()
            if self.random.randint(8):
                self.sims[n] = pliant.Sim(model=self.models[n])
            return
        if kind == 1:
            n = self.random.randint(len(self.sims))
            made = self.pick([copy.copy, copy.deepcopy, pickle.dumps, lambda sim: sim.save()])(self.sims[n])
            if isinstance(made, pliant.Sim):
                self.sims[n] = made
            gc.collect()
            return
        if kind == 2:
            return self.pick([pliant.Sim, pliant.Model, pliant.Tool, pliant.Volume, pliant.Cut, pliant.Contacts,
                              pliant.Picture, pliant.look_at])(*[self.wrong() for _ in range(3)])
        of = self.pick(self.sims if kind < 11 else self.tools)
        name = self.pick([name for name in vars(type(of)) if not name.startswith("_") and name not in SKIP
                          and name != "close"])
        if isinstance(vars(type(of))[name], property):
            if name in ("nodes", "gravity") and kind % 2:
                setattr(of, name, self.value(of, name) if self.random.randint(3) else self.wrong())
                return
            out = getattr(of, name)
        else:
            arguments = list(self.right(name))
            if self.random.randint(4) == 0:
                arguments = [self.wrong() if self.random.randint(2) else each
                             for each in arguments] + [self.wrong()] * (self.random.randint(4) == 0)
            out = getattr(of, name)(*arguments)
        if isinstance(out, pliant.Tool):
            self.tools[self.random.randint(len(self.tools))] = out
        if isinstance(out, np.ndarray):
            self.arrays = self.arrays[-50:] + [(out, out.copy())]


def main(seed, count):
    faulthandler.enable()
    calls, raised = Calls(seed), 0
    for _ in range(count):
        try:
            calls.call()
        except Exception:
            raised += 1
    for array, was in calls.arrays:
        np.testing.assert_array_equal(array, was)
    for sim in calls.sims:
        try:
            assert np.isfinite(sim.nodes).all()
        except pliant.Error:
            pass
    print("%d calls, %d raised, %d returned" % (count, raised, count - raised))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
