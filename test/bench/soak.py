#!/usr/bin/env python3
"""Simulate many hours of a scripted operation without pauses: pull, push, cut, and sometimes reload the scan. Memory
and the 99th percentile of a step's time must stay constant.

    PLIANT_LIBRARY=build/src/libpliant.so [taskset -c 1 chrt -r 1] python3 test/bench/soak.py [HOURS=8] [SECONDS]

SECONDS is a time limit.

The program prints for every two simulated minutes: steps, CPU time of a step (median, p99, maximum), memory of the
library and of the process. At the end it prints the same for every hour, and the p99 of wall time and of
evaluations. Other programs do not change the number of evaluations. The test fails if the last fifth exceeds the
second fifth by more than 2 % in memory, or by more than 20 % in p99 of CPU time."""
import gc
import os
import sys
import time

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "../../src/python"))
import pliant  # noqa: E402

# [s]: step, duration of a round, rounds until the scan is reloaded, duration of a row, an hour
STEP, ROUND, RELOAD, ROW, HOUR = 0.02, 10.0, 20, 120, 3600
MEASURES = ("CPU time [ms]", "wall time [ms]", "evaluations")
OPTIONS = {"mesh/coarse_cells": "7 5 6", "mesh/ratio": 2, "model/method": "averaged", "solver/threads": 1,
           "cut/kind": "sever", "cut/resistance": 0,
           "solver/step": STEP, "element/kind": "linear", "grasp/stiffness": 500}


class Operation:
    """Rounds of the same kind at varying points: four strokes of pulling and pushing, a cut, the same again, and a
    reset."""

    def __init__(self):
        self.random, self.rounds = np.random.default_rng(1), 0
        self.load()

    def load(self):
        self.sim = pliant.Sim(scan="phantom:48x32x40", options=OPTIONS)
        self.forceps = self.sim.tool("forceps")
        rest, free = self.sim.rest, ~self.sim.fixed
        front = rest[:, 1] < np.quantile(rest[free][:, 1], 0.25)
        self.places = rest[free & front]

    def round(self, told):
        """Run one round. Put the values of MEASURES of each step into the columns of told."""
        if self.rounds % RELOAD == RELOAD - 1:
            self.sim.close()
            gc.collect()  # the object and its tools refer to each other
            self.load()
        self.rounds += 1
        self.sim.reset()
        steps = int(ROUND / STEP)
        for at in range(steps):
            part, phase = at * 8 // steps, (at * 8 % steps) / steps
            if at * 8 % steps < 8:
                self.begin(part)
            if self.forceps.holding:
                way = 0.02 * np.sin(2 * np.pi * phase) * (1 if part % 2 else -1)
                self.forceps.move(self.held + [0.3 * way, way, 0.2 * way])
            cpu, wall = time.thread_time(), time.perf_counter()
            self.sim.step()
            told[:, at] = (1e3 * (time.thread_time() - cpu), 1e3 * (time.perf_counter() - wall),
                           self.sim.statistics["iterations"])

    def begin(self, part):
        self.forceps.release()
        if part == 4:
            x, y, z = self.places[self.random.integers(len(self.places))]
            self.sim.cut([[x, y - 0.05, z - 0.02], [x, y - 0.05, z + 0.02]], [0, 0.08, 0])
        place = self.places[self.random.integers(len(self.places))]
        try:
            self.forceps.grasp(place)
        except pliant.Error:
            return  # the tissue there was cut away
        self.held = np.array(self.forceps.state["tip"])


def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def hourly(told, memory):
    """Return one line of the table."""
    return [np.quantile(of_one, q) for of_one in told for q in (0.5, 0.99)] + [min(memory), max(memory)]


def main():
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 8
    patience = float(sys.argv[2]) if len(sys.argv) > 2 else float("inf")
    operation, rows, table, begin = Operation(), [], [], time.time()
    steps, in_row, in_hour = int(ROUND / STEP), int(ROW / STEP), int(HOUR / STEP)
    told = np.zeros((len(MEASURES), in_hour))  # measurements of this hour; allocated once, because memory is monitored
    while len(rows) * ROW < hours * HOUR and time.time() - begin < patience:
        first = len(rows) * in_row % in_hour
        for step in range(first, first + in_row, steps):
            operation.round(told[:, step:step + steps])
        milliseconds = told[0, first:first + in_row]
        rows.append([np.quantile(milliseconds, 0.99), resident() / 1e6])
        print("%6.2f h %8d steps: median %.3f ms, p99 %.3f, worst %.3f; %.1f MB held, %.1f MB in memory; "
              "inverted %d" %
              (len(rows) * ROW / HOUR, in_row, np.median(milliseconds), rows[-1][0], milliseconds.max(),
               operation.sim.statistics["bytes"] / 1e6, rows[-1][1], operation.sim.inverted), flush=True)
        if len(rows) * ROW % HOUR == 0:
            table.append(hourly(told, [memory for _, memory in rows[-HOUR // ROW:]]))
    print("| hour | " + " | ".join("%s median | p99" % name for name in MEASURES) + " | memory least [MB] | most |\n|" +
          9 * "---|")
    for hour, line in enumerate(table, 1):
        print("| %d | %.3f | %.3f | %.3f | %.3f | %.0f | %.0f | %.1f | %.1f |" % tuple([hour] + line))
    fifth = max(1, len(rows) // 5)
    early, late = np.array(rows[fifth:2 * fifth] or rows), np.array(rows[-fifth:])
    p99, memory = np.median(late[:, 0]) / np.median(early[:, 0]), np.median(late[:, 1]) / np.median(early[:, 1])
    print("%.1f simulated hours in %.0f s: p99 x %.3f, memory x %.3f" %
          (len(rows) * ROW / HOUR, time.time() - begin, p99, memory))
    return 0 if p99 < 1.2 and memory < 1.02 else 1


if __name__ == "__main__":
    sys.exit(main())
