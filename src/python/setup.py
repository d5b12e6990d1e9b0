"""pip install src/python: build libpliant.so with cmake, and install it in a package with the modules.

The system's packages must be installed: launch/install (pliant_install core). Two environment variables change the
build:

    CMAKE_ARGS="-DPLIANT_CUDA=OFF"    options for cmake
    PLIANT_LIBRARY=/path/libpliant.so existing library; nothing is compiled
"""
import atexit
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import tempfile

from setuptools import Distribution, setup
from setuptools.command.build import build
from setuptools.command.egg_info import egg_info

try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:  # setuptools before 70
    from wheel.bdist_wheel import bdist_wheel

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parent.parent
MODULES = {"package.py": "__init__.py", "pliant.py": "simulation.py",
           **{name: name for name in ("pliant_library.py", "pliant_results.py", "pliant_tool.py")}}


def version():
    return re.search(r'define PLIANT_VERSION "([^"]+)"', (SOURCE / "include/pliant/version.h").read_text()).group(1)


def temporary_folder():
    """Create a folder outside the source, which is removed at the end."""
    folder = tempfile.mkdtemp(prefix="pliant_build_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def build_library(folder):
    """Compile the library alone. Return its path."""
    if not shutil.which("cmake"):
        raise SystemExit("cmake is missing; on Debian and Ubuntu: (. %s/launch/install && pliant_install core)" %
                         SOURCE)
    options = ["-DPLIANT_ROS=OFF", "-DPLIANT_RVIZ=OFF", "-DPLIANT_TESTS=OFF",
               *shlex.split(os.environ.get("CMAKE_ARGS", ""))]
    if shutil.which("ninja"):
        options += ["-G", "Ninja"]
    subprocess.run(["cmake", "-S", str(SOURCE), "-B", str(folder), *options], check=True)
    subprocess.run(["cmake", "--build", str(folder), "--target", "pliant", "--parallel", str(os.cpu_count() or 1)],
                   check=True)
    return next(path for path in folder.rglob("libpliant.so*") if not path.is_symlink())


class Build(build):
    def initialize_options(self):
        super().initialize_options()
        self.build_base = temporary_folder()

    def run(self):
        super().run()
        package = pathlib.Path(self.build_lib) / "pliant"
        package.mkdir(parents=True, exist_ok=True)
        for source, target in MODULES.items():
            shutil.copyfile(HERE / source, package / target)
        given = os.environ.get("PLIANT_LIBRARY")
        library = (pathlib.Path(given).resolve() if given
                   else build_library(pathlib.Path(self.build_temp).resolve() / "cmake"))
        shutil.copyfile(library, package / "libpliant.so")


class Info(egg_info):
    def initialize_options(self):
        super().initialize_options()
        self.egg_base = temporary_folder()


class Wheel(bdist_wheel):
    """A wheel for any Python 3 on this platform, because ctypes loads the library."""

    def get_tag(self):
        return "py3", "none", super().get_tag()[2]


class WithLibrary(Distribution):
    def has_ext_modules(self):
        return True


setup(version=version(), cmdclass={"build": Build, "egg_info": Info, "bdist_wheel": Wheel}, distclass=WithLibrary)
