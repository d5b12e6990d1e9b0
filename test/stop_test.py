#!/usr/bin/env python3
"""Programs end within one second after SIGINT or SIGTERM, while they read, build, step or write. On a busy machine
the time for which others compute is not counted.

    stop_test.py FOLDER      folder of pliant_deform, pliant_report, pliant_fit and pliant_segment
"""
import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import stopped

FOLDER = os.path.realpath(sys.argv.pop(1)) if len(sys.argv) > 1 else ""
STOPPED = 130
# the factorization takes many seconds
LARGE = ["--set", "mesh/coarse_cells=24 20 20", "--set", "mesh/ratio=2", "--set", "solver/preconditioner=direct"]
SMALL = ["--set", "mesh/coarse_cells=6 5 6", "--set", "mesh/ratio=1"]


def waits_for_signals(process):
    """Return whether the program has begun: it blocks SIGTERM."""
    with open("/proc/%d/status" % process) as file:
        blocked = [int(line.split()[1], 16) for line in file if line.startswith("SigBlk")]
    return bool(blocked) and bool(blocked[0] >> (signal.SIGTERM - 1) & 1)


class Stop(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.out = temporary.name

    def stop(self, number, delay, words):
        """Send a signal after a delay [s] to the running program, and check that it ends in time."""
        with open(os.path.join(self.out, "printed"), "w+") as printed:
            process = subprocess.Popen([os.path.join(FOLDER, words[0])] + words[1:], stdout=printed, stderr=printed)
            try:
                while process.poll() is None and not waits_for_signals(process.pid):
                    time.sleep(0.01)
                time.sleep(delay)
                printed.seek(0)
                self.assertIsNone(process.poll(), printed.read())
                code, seconds = stopped.stop(process, number)
                self.assertEqual(code, STOPPED)
                self.assertLess(seconds, 1)
            finally:
                process.kill()
                process.wait()

    def test_while_a_large_model_is_built(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            self.stop(number, 1.5, ["pliant_deform", "--scan", "phantom:120x90x80", "--out", self.out] + LARGE)

    def test_while_a_scan_is_made(self):
        self.stop(signal.SIGTERM, 0.3, ["pliant_deform", "--scan", "phantom:700x600x500", "--out", self.out])

    def test_between_steps(self):
        self.stop(signal.SIGTERM, 1.5, ["pliant_deform", "--scan", "phantom:40x28x34", "--steps", "100000000",
                                        "--no-volume", "--out", self.out] + SMALL)

    def test_a_report(self):
        self.stop(signal.SIGTERM, 1.5, ["pliant_report", "--scan", "phantom:60x44x46", "--no-pictures", "--out",
                                        self.out])
        self.stop(signal.SIGINT, 1.5, ["pliant_report", "--stability", "--case", "long_run", "--steps", "1000000",
                                       "--no-pictures", "--out", self.out])

    def test_a_fit(self):
        markers = os.path.join(self.out, "markers.csv")
        with open(markers, "w") as file:
            file.writelines("1,%g,%g,%g,0.001,0.002,0.003\n" % (-0.08 + 0.001 * n, -0.06, 0.09) for n in range(12))
        self.stop(signal.SIGTERM, 1.5, ["pliant_fit", "--scan", "phantom:120x90x80", "--markers", markers,
                                        "--materials", "soft_tissue", "--out", self.out] + LARGE)

    def test_a_segmentation(self):
        self.stop(signal.SIGTERM, 1, ["pliant_segment", "--scan", "phantom:400x300x300", "--out", self.out])


if __name__ == "__main__":
    unittest.main()
