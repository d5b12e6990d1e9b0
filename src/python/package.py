"""Pliant's ROS package: messages (pliant.msg) and services (pliant.srv), which have no further dependencies.
The names of pliant.simulation, such as pliant.Sim, are imported on first use, together with numpy and the library."""
import importlib


def __getattr__(name):
    if (name in ("msg", "srv", "simulation") or name.startswith("pliant_") or
            name.startswith("__") and name != "__all__"):
        raise AttributeError(name)
    return getattr(importlib.import_module(__name__ + ".simulation"), name)


def __dir__():
    return sorted(list(globals()) + dir(importlib.import_module(__name__ + ".simulation")))
