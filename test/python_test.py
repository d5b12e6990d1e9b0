#!/usr/bin/env python3
"""Test pliant.py against the library: results, errors, bitwise equality, and several simulations at once."""
import contextlib
import copy
import io
import os
import pathlib
import pickle
import re
import subprocess
import sys
import tempfile
import threading
import time
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, "..", "src", folder) for folder in ("python", "examples")]
import numpy as np
import pliant

SMALL = {"mesh/coarse_cells": [5, 4, 4], "mesh/ratio": 1, "solver/threads": 1, "solver/iterations": 4,
         "solver/refresh_interval": 0}
SCAN = "phantom:48x36x36"
LIVER = np.array([-0.08, -0.06, 0.09])


def pull(sim, steps=3):
    tool = sim.tool("forceps")
    tool.move(LIVER)
    tool.grasp(LIVER)
    for step in range(steps):
        tool.move(LIVER + [0, -0.003 * (step + 1), 0])
        sim.step()
    return tool


class Python(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.model = pliant.Model(scan=SCAN, options=SMALL)
        cls.cuts = pliant.Model(scan=SCAN, options=dict(SMALL, **{"cut/kind": "sever"}))

    def test_a_pulled_tissue_follows_and_pulls_back(self):
        sim = pliant.Sim(model=self.model)
        self.assertTrue(np.array_equal(sim.nodes, sim.rest))
        tool = pull(sim)
        self.assertTrue(tool.holding)
        self.assertGreater(-tool.force[1], 0.01)  # it pulls the tissue to the front
        state, moved = tool.state, np.linalg.norm(sim.nodes - sim.rest, axis=1)
        # the force of a spring
        np.testing.assert_allclose(tool.force, state["stiffness"] * (state["tip"] - state["held_point"]), rtol=1e-6,
                                   atol=1e-9)
        self.assertGreater(moved.max(), 0.003)
        self.assertTrue((moved[sim.fixed] == 0).all())
        self.assertLess(sim.error, 1e-3)
        self.assertEqual(sim.statistics["step"], 3)
        lever = tool.state["held_point"] - tool.state["tip"]
        np.testing.assert_allclose(sim.wrench("forceps"), np.concatenate([tool.force, np.cross(lever, tool.force)]))
        tool.release()
        self.assertFalse(tool.holding)

    def test_arrays_belong_together_and_stay(self):
        sim = pliant.Sim(model=self.model)
        tets, rest, before = sim.tets, sim.rest, sim.nodes
        self.assertEqual(tets.max() + 1, len(rest))
        edges = rest[tets[:, 1:]] - rest[tets[:, :1]]
        volume = np.linalg.det(edges) / 6
        self.assertGreater(volume.min(), 0)
        self.assertTrue((sim.triangles < len(rest)).all())
        self.assertEqual(len(sim.materials), len(tets))
        self.assertIn("organ", " ".join(self.model.materials))
        self.assertGreater(sim.masses.sum(), 5)  # an abdomen, in kilograms
        pull(sim)
        self.assertTrue(np.array_equal(before, rest))  # a copy
        self.assertGreater(np.abs(sim.scalar("von_mises")).max(), 1)
        with self.assertRaisesRegex(ValueError, "von_mises"):
            sim.scalar("temperature")

    def test_the_volume_at_rest_is_the_scan_and_moves_with_the_tissue(self):
        sim = pliant.Sim(model=self.model)
        scan, rest = self.model.scan, sim.volume()
        i, j, k = np.round((LIVER - scan.origin) / scan.spacing).astype(int)
        self.assertTrue(85 < scan.intensities[k, j, i] < 140)  # liver: launch/materials/phantom.yaml
        self.assertEqual(rest.values.shape, (36, 36, 48))
        tissue = rest.values != rest.background
        self.assertGreater(tissue.mean(), 0.2)
        self.assertTrue((rest.values[tissue] == scan.values[tissue]).all())
        pull(sim)
        self.assertGreater((sim.volume().values != rest.values).sum(), 100)
        self.assertEqual(rest.intensities.dtype, np.float32)

    def test_displacements_and_meshes_are_those_of_the_simulation(self):
        sim = pliant.Sim(model=self.model)
        pull(sim)
        back, forth = sim.displacement(), sim.displacement("tissue")
        volume = sim.volume()
        np.testing.assert_allclose(back.origin, volume.origin, atol=1e-12)
        self.assertEqual(back.mask.shape, volume.values.shape)
        self.assertEqual(back.vectors.shape, volume.values.shape + (3,))
        tissue = back.mask == 1
        # The scan at the positions of the vectors, rounded to voxels, is nearly the deformed volume.
        k, j, i = (grid[tissue] for grid in np.meshgrid(*(np.arange(n) for n in tissue.shape), indexing="ij"))
        index = np.rint(np.stack([i, j, k], 1) + back.vectors[tissue] @ back.direction / back.spacing).astype(int)
        index = np.clip(index, 0, np.array(tissue.shape[::-1]) - 1)
        apart = np.abs(sim.model.scan.values[index[:, 2], index[:, 1], index[:, 0]].astype(float) -
                       volume.values[tissue])
        self.assertLess(np.median(apart), 10)
        self.assertGreater(np.linalg.norm(forth.vectors, axis=-1).max(), 0.005)
        with self.assertRaises(ValueError):
            sim.displacement("itk")
        with tempfile.TemporaryDirectory() as folder:
            back.save(os.path.join(folder, "u.nii.gz"))
            for name in ("mesh.vtu", "surface.vtp", "surface.ply", "deformed.nii.gz"):
                self.assertIsNone(sim.save(os.path.join(folder, name), unit="mm"))
            self.assertEqual(sorted(os.listdir(folder)), ["deformed.nii.gz", "mesh.vtu", "surface.ply", "surface.vtp",
                                                          "u.nii.gz", "u_mask.nii.gz"])
            header = pathlib.Path(folder, "mesh.vtu").read_bytes()[:3000].decode(errors="replace")
            self.assertIn('NumberOfPoints="%d"' % len(sim.nodes), header)
            self.assertIn("millimetres", header)
            for path, unit, error in (("mesh.stl", "m", pliant.Error), ("mesh.vtu", "inch", ValueError),
                                      ("none/mesh.vtu", "m", pliant.Error)):
                with self.assertRaises(error):
                    sim.save(os.path.join(folder, path), unit=unit)

    def test_an_organ_is_drawn_alone_where_the_scene_says_so(self):
        scene, seen = os.path.join(HERE, "..", "launch", "scenes", "biopsy.yaml"), []
        for hide in (False, True):
            volume = pliant.Sim(scene, scan=SCAN, options=dict(SMALL, **{"warp/hide_empty": hide})).volume()
            seen.append((volume.values != volume.background).sum())
        self.assertTrue(0 < seen[1] < 0.8 * seen[0], seen)

    def test_the_same_bits_again_and_in_other_threads(self):
        sims = [pliant.Sim(model=self.model) for _ in range(3)]
        pull(sims[0])
        threads = [threading.Thread(target=pull, args=(sim,)) for sim in sims[1:]]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for sim in sims[1:]:
            self.assertTrue(np.array_equal(sim.nodes, sims[0].nodes))
        sims[0].reset()
        pull(sims[0])
        self.assertTrue(np.array_equal(sims[0].nodes, sims[1].nodes))

    def test_python_goes_on_during_a_step(self):
        sim, counts, done = pliant.Sim(model=self.model), [0], []
        tool = pull(sim)

        def count():
            while not done:
                counts[0] += 1
                time.sleep(1e-4)
        thread, interval = threading.Thread(target=count), sys.getswitchinterval()
        thread.start()
        sys.setswitchinterval(60)  # threads switch only where one releases the lock
        try:
            for step in range(1000):
                before = counts[0]
                tool.move(LIVER - [0, 0.002 * (step % 2), 0])  # a step at rest takes a microsecond only
                sim.step()
                if counts[0] > before:
                    break
            self.assertGreater(counts[0], before)
        finally:
            sys.setswitchinterval(interval)
            done.append(True)
            thread.join()

    def test_what_is_saved_is_gone_back_to(self):
        sim = pliant.Sim(model=self.cuts)
        pull(sim)
        sim.cut([LIVER + [-0.05, -0.07, 0], LIVER + [0.05, -0.07, 0]], [0, 0.06, 0])
        saved, seen = sim.save(), []
        for _ in range(2):
            forceps = sim.tool("forceps")
            for step in range(3):
                forceps.move(LIVER + [0.002 * step, -0.01, 0])
                sim.step()
            seen.append((sim.nodes, forceps.force, sim.revision, len(sim.tets)))
            sim.undo_cut()
            sim.reset()
            sim.restore(saved)
        for first, again in zip(*seen):
            self.assertTrue(np.array_equal(first, again))
        other = sim.copy()
        self.assertTrue(np.array_equal(other.nodes, saved.nodes))
        other.tool("forceps").release()
        self.assertTrue(sim.tool("forceps").holding)

    def test_a_cut_appends_and_can_be_undone(self):
        sim = pliant.Sim(model=self.cuts)
        before, tets = sim.revision, len(sim.tets)
        cut = sim.cut([LIVER + [-0.05, -0.07, 0], LIVER + [0.05, -0.07, 0]], [0, 0.06, 0])
        self.assertGreater(cut.area, 1e-3)
        self.assertGreater(cut.links, 10)
        self.assertNotEqual(sim.revision, before)
        self.assertGreater(len(sim.tets), tets)
        self.assertEqual(len(sim.nodes), len(sim.rest))
        whole = sim.volume()
        pull(sim)
        self.assertTrue((sim.volume().values != whole.values).any())
        sim.undo_cut()
        self.assertEqual(len(sim.tets), tets)
        knife = sim.tool("knife")
        knife.blade("scalpel")
        knife.move([0, 0, 0.5])
        knife.cutting()
        self.assertTrue(knife.state["cutting"])

    def test_a_camera_sees_the_tissue_move(self):
        sim = pliant.Sim(model=self.model)
        K, size = [[150, 0, 79.5], [0, 150, 59.5], [0, 0, 1]], (160, 120)
        T = pliant.look_at(LIVER + [0, -0.25, 0], LIVER)
        before, film = sim.render(K, T, size), sim.radiograph(LIVER, size=(64, 48), pixel=0.008)
        tool = pull(sim)
        after = sim.render(K, T, size)
        self.assertEqual(after.rgb.shape, (120, 160, 3))
        seen = np.isfinite(before.depth) & np.isfinite(after.depth)
        self.assertGreater(seen.mean(), 0.5)
        nearer = np.where(seen, before.depth - after.depth, 0)
        middle = nearer[50:70, 70:90].mean()  # the liver is pulled towards the camera
        self.assertGreater(middle, 0.0005)
        self.assertLess(middle, 0.012)
        self.assertGreater(middle, 2 * nearer.mean())
        names = self.model.materials
        self.assertTrue(set(before.label[seen]) <= set(range(1, len(names) + 1)))
        bone = sim.render(K, T, size, shown=["bone"])
        self.assertEqual(set(bone.label[np.isfinite(bone.depth)]) - {0}, {names.index("bone") + 1})
        # behind the tissue that covers it
        self.assertGreater(np.nanmedian(bone.depth), np.nanmedian(before.depth) + 0.02)
        self.assertEqual(film.shape, (48, 64))
        self.assertTrue(2 < film.max() < 12)  # 0.3 m of water: 6
        self.assertTrue((sim.radiograph(LIVER, size=(64, 48), pixel=0.008) != film).any())
        with self.assertRaisesRegex(pliant.Error, "rotation"):
            sim.render(K, 2 * T, size)
        with self.assertRaises(ValueError):
            sim.render(np.eye(2), T, size)

    def test_a_shape_presses_and_is_felt(self):
        model = pliant.Model(scan=SCAN,
                             options=dict(SMALL, **{"mesh/coarse_cells": [10, 8, 8], "solver/iterations": 30}),
                             shapes=True)
        sim = pliant.Sim(model=model)
        for other in ({"shapes": True}, {"scene": "other.yaml"}, {"options": SMALL}):
            with self.assertRaisesRegex(ValueError, "pass them to Model"):
                pliant.Sim(model=model, **other)
        self.assertEqual(len(sim.contacts), 0)
        other, probe = sim.tool("other"), sim.tool("probe")
        probe.shape("probe")
        skin, inwards = np.array([-0.027, -0.125, -0.025]), [-0.5 ** 0.5, 0, 0, 0.5 ** 0.5]  # the rod points along y
        for step in range(20):
            probe.move(skin + [0, 0.001 * step, 0], inwards)
            sim.step()
        told, all_told = probe.contacts, sim.contacts
        self.assertGreater(len(told), 0)
        self.assertEqual((len(told), len(other.contacts)), (len(all_told), 0))
        self.assertTrue((told.tools == told.tools[0]).all() and (told.parts == 0).all() and not told.tissue.any())
        np.testing.assert_allclose(np.linalg.norm(told.normals, axis=1), 1, atol=1e-12)
        self.assertTrue((told.areas > 0).all() and (told.normals[:, 1] > 0).all()
                        and (np.abs(told.depths) < 1e-4).all())
        self.assertEqual(len(told), sim.statistics["contacts"])
        self.assertAlmostEqual(max(told.depths.max(), 0), sim.statistics["penetration"], delta=1e-9)
        self.assertGreater(probe.force[1], 0.05)  # into the tissue
        np.testing.assert_allclose(probe.force, told.forces.sum(axis=0), rtol=1e-12, atol=1e-15)
        torque = np.cross(told.points - probe.proxy.tip, told.forces).sum(axis=0)
        np.testing.assert_allclose(probe.wrench, np.concatenate([probe.force, torque]), rtol=1e-9, atol=1e-15)
        nodal = sim.scalar("contact_force")
        self.assertGreater(nodal.max(), 0.01)
        self.assertTrue((nodal[np.linalg.norm(sim.rest - skin, axis=1) > 0.1] == 0).all())
        # The wrench includes grasp and contact.
        probe.grasp(LIVER)
        probe.drive("force", [0.1, 0, 0])
        sim.step()
        held, told = probe.state, probe.contacts
        self.assertGreater(len(told), 0)
        np.testing.assert_allclose(probe.force, told.forces.sum(axis=0) + [0.1, 0, 0], rtol=1e-12)
        torque = (np.cross(told.points - held["proxy_tip"], told.forces).sum(axis=0) +
                  np.cross(held["held_point"] - held["proxy_tip"], [0.1, 0, 0]))
        np.testing.assert_allclose(probe.wrench[3:], torque, rtol=1e-9)
        probe.release()
        probe.shape(None)
        sim.step()
        self.assertEqual(len(sim.contacts), 0)
        self.assertTrue((probe.wrench == 0).all())
        with self.assertRaisesRegex(pliant.Error, "no instrument 'spoon'"):
            probe.shape("spoon")
        with self.assertRaisesRegex(pliant.Error, "finite"):
            probe.jaw(np.nan)

    def test_a_proxy_stays_behind_at_the_force_limit(self):
        limit = 0.02  # [N]
        sim = pliant.Sim(scan=SCAN, options=dict(SMALL, **{"mesh/coarse_cells": [10, 8, 8], "solver/iterations": 30,
                                                           "contact/max_force": limit}), shapes=True)
        probe, bare = sim.tool("probe"), sim.tool("bare")
        probe.shape("probe")
        # the rod points along y
        skin, inwards = np.array([-0.027, -0.125, -0.025]), np.array([-0.5 ** 0.5, 0, 0, 0.5 ** 0.5])
        bare.move(skin + [0, -0.05, 0])
        probe.move(skin + [0, -0.01, 0], inwards)
        sim.step()
        self.assertEqual((sim.statistics["legs"], sim.statistics["ended"], sim.statistics["ended_text"]),
                         (1, 0, "every proxy is at its tool"))
        self.assertFalse(probe.saturated)
        np.testing.assert_array_equal(probe.proxy_error, np.zeros(3))
        for step in range(20):
            tip = skin + [0, 0.001 * step, 0]
            probe.move(tip, inwards)
            sim.step()
        told = sim.statistics
        self.assertTrue(probe.saturated)
        self.assertGreater(probe.proxy_error[1], 0.002)
        np.testing.assert_allclose(probe.proxy.tip, tip - probe.proxy_error, rtol=0, atol=1e-15)
        np.testing.assert_allclose(probe.proxy.rotation, inwards, rtol=0, atol=0.05)
        self.assertAlmostEqual(told["proxy_error"], np.linalg.norm(probe.proxy_error), delta=1e-15)
        self.assertIn("presses with contact/max_force", told["ended_text"])
        self.assertLess(np.linalg.norm(probe.force), 1.05 * limit)
        self.assertGreater(np.linalg.norm(probe.force), 0.9 * limit)
        self.assertTrue(0 <= told["advanced"] <= 1 and told["legs"] >= 1)
        # a tool without a shape is its own proxy
        np.testing.assert_array_equal(bare.proxy.tip, skin + [0, -0.05, 0])
        self.assertFalse(bare.saturated or bare.proxy_error.any())

    def test_a_jaw_opens_into_the_tissue(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "jaw.yaml")
            with open(path, "w") as file:
                file.write("joint: [0, 0, -0.1]\naxis: [1, 0, 0]\n"
                           "parts: [{kind: sphere, moves: jaw_minus, from: [0, 0, 0], radius: 0.004}]\n")
            sim = pliant.Sim(scan=SCAN,
                             options=dict(SMALL, **{"mesh/coarse_cells": [10, 8, 8], "solver/iterations": 30}),
                             shapes=True)
            jaw = sim.tool("jaw")
            jaw.shape(path, offset=(0, 0.001, 0))
            other = os.path.join(folder, "jaw.yml")
            os.rename(path, other)
            jaw.shape(pathlib.Path(other), offset=(0, 0.001, 0))
            before = os.getcwd()
            os.chdir(folder)
            try:
                jaw.shape("jaw.yml", offset=(0, 0.001, 0))
            finally:
                os.chdir(before)
        # half of the angle turns the ball towards +y; it is 0.1 m from its joint, so it moves by up to 17 mm
        for angle in (0, 0.1, 0.35):
            jaw.move([-0.027, -0.14, -0.025])
            jaw.jaw(angle)
            sim.step()
            self.assertEqual(len(jaw.contacts) > 0, angle > 0.1)
        self.assertGreater(jaw.force[1], 0.02)
        self.assertFalse(jaw.holding)

    def test_an_environment_to_learn_in(self):
        import gym_environment
        rewards = []
        for seed in (1, 1, 2):
            world = gym_environment.Retraction(model=self.model, max_steps=20)
            seen, _ = world.reset(seed=seed)
            self.assertEqual(seen.shape, (9,))
            for _ in range(5):
                seen, reward, reached, late, told = world.step((seen[3:6] - seen[0:3]) / gym_environment.STEP)
            rewards.append((reward, told["distance"]))
        self.assertEqual(rewards[0], rewards[1])
        self.assertNotEqual(rewards[0], rewards[2])
        self.assertEqual(world.render().shape, (36, 48, 3))
        self.assertGreater(world.render().std(), 10)

    def test_a_tour(self):
        with tempfile.TemporaryDirectory() as folder:
            paths = os.path.join(HERE, "..", "src", "python") + os.pathsep + os.environ.get("PYTHONPATH", "")
            told = subprocess.run([sys.executable, os.path.join(HERE, "..", "src", "examples", "tour.py"),
                                   "phantom:60x44x46", folder],
                                  env=dict(os.environ, PYTHONPATH=paths), stdout=subprocess.PIPE,
                                  universal_newlines=True, timeout=300)
            self.assertEqual(told.returncode, 0)
            for words in ("pulled by 20 mm", "cut [1-9]", "the nodes as they were: True", "10 mm along .* N"):
                self.assertRegex(told.stdout, words)
            for name in ("rest", "pulled", "cut", "rest_slice", "pulled_slice", "cut_slice", "radiograph"):
                with open(os.path.join(folder, name + ".png"), "rb") as file:
                    self.assertEqual(file.read(8), b"\x89PNG\r\n\x1a\n")

    def test_every_function_of_a_closed_simulation_raises(self):
        sim = pliant.Sim(model=self.cuts)
        tool = pull(sim)
        nodes, volume, contacts, state = sim.nodes, sim.volume(), sim.contacts, tool.state
        sim.render(np.eye(3) * [100, 100, 1], pliant.look_at(LIVER + [0, -0.2, 0], LIVER), (8, 8))
        kept = [array.copy() for array in (nodes, volume.values, state["tip"])]
        other = pliant.Sim(model=self.cuts)
        sim.close()
        sim.close()
        self.assertIs(sim.model, self.cuts)
        calls = {"limits": (4, 1e-3), "restore": (other,), "scalar": ("von_mises",),
                 "cut": ([LIVER, LIVER + 0.01], [0, 0.05, 0]), "move": (LIVER,), "drive": ("spring",),
                 "spring": (100.0,), "radius": (0.01,), "blade": ("scalpel",), "shape": ("probe",), "jaw": (0.1,),
                 "radiograph": (LIVER,),
                 "render": (np.eye(3) * [100, 100, 1], pliant.look_at(LIVER + [0, -0.2, 0], LIVER))}
        tested = 0
        for of, names in ((sim, vars(pliant.Sim)), (tool, vars(pliant.Tool))):
            for name in names:
                if name.startswith("_") or name in ("close", "model", "styles", "drives"):
                    continue
                with self.assertRaisesRegex(pliant.Error, "this simulation is closed", msg=name):
                    member = getattr(of, name)
                    member(*calls.get(name, ()))
                tested += 1
        self.assertEqual(tested, 50)
        for name, value in (("nodes", nodes), ("gravity", [0, 0, 0])):
            with self.assertRaisesRegex(pliant.Error, "this simulation is closed"):
                setattr(sim, name, value)
        for call in (lambda: other.restore(sim), lambda: copy.copy(sim), lambda: copy.deepcopy(tool)):
            with self.assertRaisesRegex(pliant.Error, "closed"):
                call()
        for array, was in zip((nodes, volume.values, state["tip"]), kept):  # copies
            self.assertTrue(np.array_equal(array, was))
        self.assertEqual(len(contacts.of(0)), 0)
        self.assertTrue(other.step())

    def test_a_simulation_that_another_thread_steps_is_closed_after_the_step(self):
        sim, seen = pliant.Sim(model=self.model), []
        pull(sim)

        def go_on():
            try:
                while True:
                    sim.step()
            except pliant.Error as error:
                seen.append(str(error))
        thread = threading.Thread(target=go_on)
        thread.start()
        for _ in range(50):
            self.assertEqual(len(sim.nodes), len(sim.rest))
        sim.close()
        thread.join(10)
        self.assertRegex(" ".join(seen), "closed")

    def test_a_state_of_another_model_is_refused(self):
        sim = pliant.Sim(model=self.cuts)
        pull(sim)
        sim.cut([LIVER + [-0.05, -0.07, 0], LIVER + [0.05, -0.07, 0]], [0, 0.06, 0])
        sim.step()
        before, severed = sim.nodes, dict(SMALL, **{"cut/kind": "sever"})
        for scan, options, named in ((SCAN, SMALL, "cut/kind differs"),
                                     (SCAN, dict(SMALL, **{"cut/kind": "subdivide"}), "cut/kind differs"),
                                     (SCAN, dict(severed, **{"solver/kind": "tled"}), "solver/kind differs"),
                                     (SCAN, dict(severed, **{"model/method": "averaged", "mesh/ratio": 2}),
                                      "mesh/ratio differs.*model/method differs|model/method differs.*mesh/ratio "
                                      "differs"),
                                     ("phantom:48x38x36", severed, "of the same options"),
                                     (SCAN, severed, "of the same options")):
            other = pliant.Sim(scan=scan, options=options)
            if "cut/kind" in options:
                other.cut([LIVER + [-0.05, -0.07, 0], LIVER + [0.05, -0.07, 0]], [0, 0.06, 0])
            other.step()
            for one, state in ((sim, other.save()), (other, sim)):
                with self.assertRaisesRegex(pliant.Error, "of another model.*(%s)" % named):
                    one.restore(state)
            other.step()
            other.volume()
        self.assertTrue(np.array_equal(sim.nodes, before))
        sim.step()
        sim.volume()
        for wrong in (None, 3, "saved", self.cuts):
            with self.assertRaises(TypeError):
                sim.restore(wrong)

    def test_tools_of_a_restored_state_keep_their_names(self):
        sims = [pliant.Sim(model=self.model) for _ in range(2)]
        for sim, names in zip(sims, (("left", "right"), ("right", "left"))):
            for n, name in enumerate(names):
                sim.tool(name).move([0.1 * n, 0, 0])
        left, late = sims[0].tool("left"), sims[0].tool("late")
        sims[0].restore(sims[1])
        self.assertEqual([left.state["name"], left.state["tip"][0]], ["left", 0.1])
        with self.assertRaisesRegex(pliant.Error, "no tool late"):
            late.move(LIVER)
        sims[0].tool("other").move(LIVER)
        with self.assertRaisesRegex(pliant.Error, "no tool late"):
            late.force
        sims[0].tool("late")
        late.move(LIVER)
        self.assertEqual(late.state["name"], "late")

    def test_copies_are_simulations_and_nothing_is_pickled(self):
        sim = pliant.Sim(model=self.cuts)
        tool = pull(sim)
        sim.cut([LIVER + [-0.05, -0.07, 0], LIVER + [0.05, -0.07, 0]], [0, 0.06, 0])
        both = copy.deepcopy({"sim": sim, "tool": tool})
        copies = [copy.copy(sim), copy.deepcopy(sim), both["sim"]]
        for each in copies:
            self.assertIs(each.model, sim.model)
            self.assertTrue(np.array_equal(each.nodes, sim.nodes))
        before = sim.nodes
        both["tool"].move(LIVER + [0, -0.02, 0])
        both["sim"].step()
        self.assertFalse(np.array_equal(both["sim"].nodes, before))
        self.assertTrue(np.array_equal(sim.nodes, before))
        self.assertTrue(np.array_equal(copies[0].nodes, before))
        self.assertFalse(np.array_equal(copy.copy(tool).state["tip"], both["tool"].state["tip"]))
        sim.close()
        copies[0].step()
        self.assertIs(copy.deepcopy(self.model), self.model)
        for each in (copies[0], copies[0].tool("forceps"), self.model):
            with self.assertRaisesRegex(pliant.Error, "cannot be pickled"):
                pickle.dumps(each)
        with self.assertRaises(pliant.Error) as raised:
            sim.step()
        again = pickle.loads(pickle.dumps(raised.exception))
        self.assertEqual([str(again), again.status], [str(raised.exception), -1])
        self.assertTrue(np.array_equal(pickle.loads(pickle.dumps(copies[0].volume())).values,
                                       copies[0].volume().values))

    def test_a_failed_grasp_leaves_a_tool_without_a_pose(self):
        sim = pliant.Sim(model=self.model)
        tool = sim.tool()
        for point in ([0, -0.36, 0.063], [np.nan, 0, 0], [60, 60, 60]):
            with self.assertRaises(pliant.Error):
                tool.grasp(point)
            self.assertFalse(tool.state["present"])
        tool.grasp(LIVER)
        tool.move(LIVER)
        sim.step()
        self.assertLess(np.abs(sim.nodes - sim.rest).max(), 1e-9)
        self.assertLess(np.abs(tool.force).max(), 1e-6)
        tool.release()
        tool.move(LIVER + 0.001)
        with self.assertRaises(pliant.Error):
            tool.grasp([0, -0.36, 0.063])
        np.testing.assert_array_equal(tool.state["tip"], LIVER + 0.001)  # a tool with a pose keeps it

    def test_values_that_are_out_of_range_are_named(self):
        sim = pliant.Sim(model=self.model)
        tool = pull(sim)
        before = tool.state
        for rotation in ([0, 0, 0, 0], [1e-200] * 4, [1e200] * 4, [0, 0, np.nan, 1]):
            with self.assertRaisesRegex(pliant.Error, "rotation|finite"):
                tool.move(LIVER, rotation)
        with self.assertRaisesRegex(ValueError, "'glue'.*spring, rigid, force"):
            tool.drive("glue")
        with self.assertRaisesRegex(pliant.Error, "finite force"):
            tool.drive("force")
        with self.assertRaisesRegex(ValueError, "1 to 16384 pixels"):
            sim.radiograph(LIVER, size=(0, 10))
        camera = np.eye(3) * [100, 100, 1], pliant.look_at(LIVER + [0, -0.2, 0], LIVER), (8, 8)
        with self.assertRaisesRegex(ValueError, "'num_colours'.*threshold"):
            sim.render(*camera, num_colours=1000)
        with self.assertRaisesRegex(ValueError, "1 to 16 rows"):
            sim.render(*camera, colours=np.zeros((17, 4)))
        with self.assertRaisesRegex(TypeError, "expected a Model, not str"):
            pliant.Sim(model="scene.yaml")
        with self.assertRaises(ZeroDivisionError):
            pliant.Model(scan=SCAN, options=SMALL, progress=lambda fraction, stage: 1 / 0)
        after = tool.state
        for name in before:
            np.testing.assert_array_equal(after[name], before[name])

    def test_random_calls_raise_and_never_crash(self):
        told = subprocess.run([sys.executable, os.path.join(HERE, "python_calls.py"), "1", "1500"],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              universal_newlines=True, timeout=300)
        self.assertEqual(told.returncode, 0, told.stdout[-4000:])
        self.assertRegex(told.stdout, r"1500 calls, [1-9]\d+ raised, [1-9]\d+ returned")

    def test_what_is_wrong_is_said(self):
        for call, text in ((lambda: pliant.Model(scan="no/such/file.nii"), "no/such/file.nii"),
                           (lambda: pliant.Model(scan=SCAN, options={"solver/speed": 3}), "solver/speed"),
                           (lambda: pliant.Model(scan=SCAN, options={"solver/iterations": 0}), "solver/iterations"),
                           (lambda: pliant.Model(scene="none.yaml"), "none.yaml")):
            with self.assertRaisesRegex(pliant.Error, text):
                call()
        sim = pliant.Sim(model=self.model)
        with self.assertRaisesRegex(pliant.Error, "finite"):
            sim.gravity = [0, 0, np.nan]
        with self.assertRaises(pliant.Error):
            sim.tool().grasp([5, 5, 5])
        with self.assertRaises(ValueError):
            sim.nodes = np.zeros((3, 3))
        with self.assertRaises(pliant.Error):
            pliant.Model(scan=SCAN, options=SMALL, progress=lambda fraction, stage: False)
        self.assertTrue(sim.step())

    @unittest.skipUnless(os.environ.get("PLIANT_PACKAGES"), "there is no ROS in this build")
    def test_it_is_found_beside_the_messages(self):
        paths = os.environ["PLIANT_PACKAGES"] + os.pathsep + os.environ.get("PYTHONPATH", "")
        told = subprocess.run([sys.executable, "-c", "import pliant, pliant.msg; print(pliant.version(), "
                               "pliant.msg.MeshState.__name__)"],
                              env=dict(os.environ, PYTHONPATH=paths, PLIANT_LIBRARY=""), stdout=subprocess.PIPE,
                              universal_newlines=True)
        self.assertEqual(told.stdout.split(), [pliant.version(), "MeshState"])

    @unittest.skipUnless(os.environ.get("PLIANT_PACKAGES"), "there is no ROS in this build")
    def test_messages_need_neither_numpy_nor_the_library(self):
        paths = os.environ["PLIANT_PACKAGES"] + os.pathsep + os.environ.get("PYTHONPATH", "")
        told = subprocess.run([sys.executable, "-c", "import sys; sys.modules['numpy'] = None; import pliant; from "
                               "pliant import msg, srv; from pliant.msg import SimState; "
                               "print(SimState.__name__, msg.Step.__name__, 'pliant.simulation' in sys.modules); "
                               "pliant.Sim"],
                              env=dict(os.environ, PYTHONPATH=paths, PLIANT_LIBRARY=""), stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, universal_newlines=True)
        self.assertEqual(told.stdout.split(), ["SimState", "Step", "False"])
        self.assertIn("numpy", told.stderr)

    def test_examples_of_the_documents_run(self):
        source = pathlib.Path(HERE).parent
        blocks = [block for name in ("README.md", "src/python/README.md")
                  for block in re.findall(r"```python\n(.*?)```", (source / name).read_text(), re.S)]
        self.assertGreater(len(blocks), 3)
        names = {}
        for block in blocks:
            small = "%r, scan=%r" % (str(source / "launch/scenes/demo.yaml"), "phantom:80x58x60")
            block = block.replace(', scan="phantom"', "").replace('"launch/scenes/demo.yaml"', small)
            with self.subTest(block=block), contextlib.redirect_stdout(io.StringIO()):
                exec(compile(block, "example", "exec"), names)
        self.assertGreater(names["cut"].area, 0)
        self.assertGreater(np.linalg.norm(names["forceps"].force), 0)

    def test_options_are_those_of_the_library(self):
        self.assertEqual(pliant.options()["solver/iterations"]["default"], "6")
        self.assertRegex(pliant.version(), r"^\d+\.\d+")


if __name__ == "__main__":
    unittest.main()
