#!/usr/bin/env python3
"""Create a message of Pliant and compute a step of a simulation."""
import pliant
from pliant.msg import ToolInput

tool = ToolInput(name="forceps", jaw=0.25)
sim = pliant.Sim(scan="phantom:40x29x30")
sim.step()
print("Pliant %s, %s with jaws at %g, %d nodes" % (pliant.version(), tool.name, tool.jaw, len(sim.nodes)))
