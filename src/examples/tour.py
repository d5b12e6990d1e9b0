#!/usr/bin/env python3
"""What can I do from Python?    tour.py [SCAN] [FOLDER]

A tour of pliant.py: pull tissue, measure forces, render and cut it, restore a state, and run several simulations at
once. It prints results and writes pictures to FOLDER. SCAN: phantom, phantom:IxJxK, or a file or folder that pliant
reads.
"""
import os
import struct
import sys
import threading
import zlib

import numpy as np
import pliant

scan, folder = (sys.argv[1:] + ["phantom:80x58x60", "tour"][len(sys.argv) - 1:])[:2]
os.makedirs(folder, exist_ok=True)
# front of the phantom's liver, LPS [m]: x to the left, y to the back, z to the head
POINT = np.array([-0.06, -0.07, 0.1])


def save(name, picture):
    """Write an array as FOLDER/NAME.png, grey or in colours."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    height, width = picture.shape[:2]
    lines = np.concatenate([np.zeros((height, 1), np.uint8), picture.reshape(height, -1)], axis=1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2 if picture.ndim == 3 else 0, 0, 0, 0)
    with open(os.path.join(folder, name + ".png"), "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(lines.tobytes())) +
                   chunk(b"IEND", b""))


def look(name, sim):
    """Write a camera image of organs and bones from the front, and the axial slice through the point."""
    f = 350.0  # [pixels]
    camera = pliant.look_at(POINT + [0, -0.4, 0.1], POINT)
    save(name, sim.render([[f, 0, 159.5], [0, f, 119.5], [0, 0, 1]], camera, size=(320, 240),
                          shown=["organ", "bone"]).rgb)
    values = sim.volume().intensities  # order k, j, i: slices from the feet upwards
    save(name + "_slice", (np.clip((values[-len(values) // 5] + 200) / 500, 0, 1) * 255).astype(np.uint8))


# 1. Build a model once: scan, materials, elements. A simulation of the model contains everything that changes.
model = pliant.Model(scan=scan, options={"cut/kind": "sever", "mesh/coarse_cells": [8, 6, 6]})
sim = pliant.Sim(model=model)
print("%d nodes, %d tetrahedra of %s" % (len(sim.nodes), len(sim.tets), ", ".join(model.materials)))
look("rest", sim)

# 2. Grasp and pull. Every step solves for all nodes, and computes the force on the tool and an error estimate.
forceps = sim.tool("forceps")
forceps.grasp(POINT)
for step in range(20):
    forceps.move(POINT + [0, -0.001 * (step + 1), 0])
    sim.step()
print("pulled by 20 mm: force %s N, moved by up to %.1f mm, %.2g mm of error, von Mises stress up to %.0f Pa" % (
    forceps.force.round(2), 1e3 * np.linalg.norm(sim.nodes - sim.rest, axis=1).max(), 1e3 * sim.error,
    sim.scalar("von_mises").max()))
look("pulled", sim)
film = sim.radiograph([0, 0, 0], size=(160, 160), pixel=0.004)
save("radiograph", (255 * film / film.max()).astype(np.uint8))

# 3. Save the state, cut, and restore the state. The same steps give bitwise identical results each time.
moment = sim.save()
cut = sim.cut([POINT + [0.01, -0.06, -0.04], POINT + [0.01, -0.06, 0.04]], [0, 0.1, 0])
for step in range(20):
    sim.step()
print("cut %.1f cm^2, %d links: revision %d, force %s N" % (1e4 * cut.area, cut.links, sim.revision,
                                                            forceps.force.round(2)))
look("cut", sim)
sim.restore(moment)
print("back again: revision %d, the nodes as they were: %s" % (sim.revision, np.array_equal(sim.nodes, moment.nodes)))

# 4. Several simulations share the model. Python threads run in parallel during their steps.
def pull(direction, out):
    own = pliant.Sim(model=model)
    tool = own.tool("forceps")
    tool.grasp(POINT)
    for step in range(5):
        tool.move(POINT + 0.002 * (step + 1) * np.array(direction))
        own.step()
    out.append((direction, np.linalg.norm(tool.force)))


forces, directions = [], np.eye(3).tolist()
threads = [threading.Thread(target=pull, args=(direction, forces)) for direction in directions]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
for direction, force in sorted(forces):
    print("10 mm along %s: %.2f N" % (direction, force))
print("pictures are in %s" % folder)
