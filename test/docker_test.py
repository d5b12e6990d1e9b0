#!/usr/bin/env python3
"""Test the files of the containers: the paths of each Dockerfile exist, the scripts are valid bash, and a command
runs in the containers' environment."""
import os
import pathlib
import re
import subprocess
import unittest

FOLDER = pathlib.Path(__file__).resolve().parent.parent / "launch/docker"


class Docker(unittest.TestCase):
    def test_dockerfiles_name_scripts_that_are_there(self):
        for flavour in ("cpu", "cuda"):
            text = (FOLDER / ("Dockerfile." + flavour)).read_text()
            paths = re.findall(r"/pliant/(launch/docker/\w+)", text)
            self.assertEqual(sorted(paths), ["launch/docker/build", "launch/docker/enter"])
            for path in paths:
                self.assertTrue(os.access(FOLDER.parent.parent / path, os.X_OK), path)
            self.assertIn("ubuntu20.04" if flavour == "cuda" else "ubuntu:20.04", text)
            self.assertTrue((FOLDER / ("Dockerfile.%s.dockerignore" % flavour)).exists())

    def test_scripts_are_of_bash_and_call_install(self):
        for name in ("build", "enter"):
            subprocess.run(["bash", "-n", str(FOLDER / name)], check=True)
        text = (FOLDER / "build").read_text()
        functions = set(re.findall(r"\b(pliant_\w+)", text))
        install = (FOLDER.parent / "install").read_text()
        self.assertTrue({"pliant_install", "pliant_configure", "pliant_compile"} <= functions)
        for function in functions:
            self.assertIn(function + "()", install)

    def test_a_command_runs_in_the_environment(self):
        told = subprocess.run([str(FOLDER / "enter"), "bash", "-c", "echo $PATH; exit 7"], stdout=subprocess.PIPE,
                              universal_newlines=True)
        self.assertEqual(told.returncode, 7)
        self.assertIn("build/devel/bin", told.stdout)

    def test_the_commands_of_the_readme_are_those_of_the_files(self):
        readme = (FOLDER / "README.md").read_text()
        for flavour in ("cpu", "cuda"):
            command = re.search(r"#   (docker build .*)", (FOLDER / ("Dockerfile." + flavour)).read_text()).group(1)
            self.assertIn(command, readme)


if __name__ == "__main__":
    unittest.main()
