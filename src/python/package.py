"""Pliant's ROS package: messages (pliant.msg) and services (pliant.srv), which need nothing else; and everything of pliant.simulation, which is
imported, with numpy and the library, once something of it is asked for: pliant.Sim(...)."""
import importlib


def __getattr__(name):
    if name in ("msg", "srv", "simulation", "pliant_library") or name.startswith("__") and name != "__all__":
        raise AttributeError(name)
    return getattr(importlib.import_module(__name__ + ".simulation"), name)


def __dir__():
    return sorted(list(globals()) + dir(importlib.import_module(__name__ + ".simulation")))
