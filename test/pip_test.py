#!/usr/bin/env python3
"""Run `pip install src/python` in a virtual environment with the library of this build ($PLIANT_LIBRARY), and run the
tour there.

Exit code 77 (skipped) without pip, venv, setuptools, wheel or numpy. Nothing is downloaded."""
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
import zipfile

try:
    import ensurepip  # noqa: F401
    import numpy  # noqa: F401
    import setuptools
    import venv
    if int(setuptools.__version__.split(".")[0]) < 70:
        import wheel  # noqa: F401
except ImportError as missing:
    print("skipped: %s; apt-get install python3-venv python3-setuptools python3-wheel python3-numpy" % missing)
    sys.exit(77)

SOURCE = pathlib.Path(__file__).resolve().parent.parent


class Pip(unittest.TestCase):
    def test_an_installed_package_runs_the_tour(self):
        with tempfile.TemporaryDirectory() as folder:
            before = sorted(os.listdir(SOURCE / "src/python"))
            venv.create(folder + "/env", with_pip=True, system_site_packages=True)
            python = folder + "/env/bin/python"
            environment = dict(os.environ, PIP_NO_INDEX="1", PIP_DISABLE_PIP_VERSION_CHECK="1")
            subprocess.run([python, "-m", "pip", "wheel", "-q", "--no-build-isolation", "--no-deps", "-w", folder,
                            str(SOURCE / "src/python")], check=True,
                           env=environment)
            wheels = [name for name in os.listdir(folder) if name.endswith(".whl")]
            self.assertEqual(len(wheels), 1)
            self.assertRegex(wheels[0], r"^pliant-[0-9.]+-py3-none-linux_.*\.whl$")
            names = [name for name in zipfile.ZipFile(folder + "/" + wheels[0]).namelist() if not ".dist-info/" in name]
            self.assertEqual(sorted(names), ["pliant/__init__.py", "pliant/libpliant.so", "pliant/pliant_library.py",
                                             "pliant/pliant_results.py", "pliant/pliant_tool.py",
                                             "pliant/simulation.py"])
            subprocess.run([python, "-m", "pip", "install", "-q", "--no-deps", folder + "/" + wheels[0]], check=True,
                           env=environment)
            del environment["PLIANT_LIBRARY"]
            environment.pop("PYTHONPATH", None)
            code = ("import pliant, pliant.pliant_library as c; "
                    "print(pliant.__file__, c.library._name, pliant.version())")
            told = subprocess.run([python, "-c", code], check=True, env=environment, cwd=folder, stdout=subprocess.PIPE,
                                  universal_newlines=True).stdout.split()
            for path in told[:2]:
                self.assertTrue(path.startswith(folder), path)
            subprocess.run([python, str(SOURCE / "src/examples/tour.py"), "phantom:48x36x36", folder + "/tour"],
                           check=True, env=environment, cwd=folder,
                           stdout=subprocess.DEVNULL)
            self.assertTrue(os.path.exists(folder + "/tour/pulled.png"))
            self.assertEqual(sorted(os.listdir(SOURCE / "src/python")), before, "nothing is left in the source")


if __name__ == "__main__":
    unittest.main()
