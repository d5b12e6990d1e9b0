#!/usr/bin/env python3
"""How do I train an agent on simulated tissue?    gym_environment.py [EPISODES]

A gymnasium environment for tissue retraction. A forceps holds a point of the liver's surface, and must move it to a
goal with little force.
Observation: grasped point and goal relative to the grasp position [m], force [N]. Action: tip motion per step, -1 .. 1
for each axis.
The reward is common for tissue manipulation: minus the distance to the goal, minus a price for the force, and 1 at
the goal.
"""
import sys

import numpy as np
import pliant

try:
    import gymnasium
    Base, Box = gymnasium.Env, gymnasium.spaces.Box
except ImportError:  # without gymnasium, the class still has reset and step
    Base, Box = object, None

GRASP = np.array([-0.06, -0.07, 0.1])  # front of the phantom's liver, LPS [m]
STEP, REACHED, FARTHEST, FORCE_PRICE = 0.002, 0.002, 0.02, 0.01  # [m], [m], [m], 1 / N


class Retraction(Base):
    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}
    render_mode = "rgb_array"

    def __init__(self, scene=None, scan="phantom:80x58x60", options=None, model=None, max_steps=100):
        self.model = model or pliant.Model(scene, scan, options)  # several environments may share one model
        self.sim, self.max_steps = pliant.Sim(model=self.model), max_steps
        self.tool = self.sim.tool("forceps")
        if Box:
            self.action_space = Box(-1, 1, (3,), np.float32)
            self.observation_space = Box(-np.inf, np.inf, (9,), np.float32)

    def reset(self, *, seed=None, options=None):
        if Box:
            super().reset(seed=seed)
            self.random = self.np_random
        elif seed is not None or not hasattr(self, "random"):
            self.random = np.random.default_rng(seed)
        self.sim.reset()
        self.tool.move(GRASP)
        self.tool.grasp(GRASP)
        toward = self.random.normal(size=3)
        self.goal = GRASP + FARTHEST * self.random.uniform(0.3, 1) * toward / np.linalg.norm(toward)
        self.tip, self.steps = GRASP.copy(), 0
        return self._observe(), {}

    def step(self, action):
        tip = self.tip + STEP * np.clip(action, -1, 1)
        far = np.linalg.norm(tip - GRASP)
        self.tip = GRASP + (tip - GRASP) * min(1, 2 * FARTHEST / max(far, 1e-9))
        self.tool.move(self.tip)
        converged = self.sim.step()
        self.steps += 1
        state = self.tool.state
        distance = np.linalg.norm(state["held_point"] - self.goal)
        reached = bool(distance < REACHED)
        reward = -distance / FARTHEST - FORCE_PRICE * np.linalg.norm(state["force"]) + reached
        info = {"distance": distance, "force": state["force"], "error": self.sim.error, "converged": converged}
        return self._observe(), float(reward), reached, self.steps >= self.max_steps, info

    def render(self):
        """Return a slice of the deformed scan through the grasped point, grey from -200 to 300 Hounsfield units."""
        volume = self.sim.volume()
        index = volume.direction.T @ (self.tool.state["held_point"] - volume.origin) / volume.spacing
        k = int(np.clip(round(index[2]), 0, volume.values.shape[0] - 1))
        grey = np.clip((volume.slope * volume.values[k] + volume.intercept + 200) / 500, 0, 1)
        return np.repeat((255 * grey).astype(np.uint8)[:, :, None], 3, axis=2)

    def _observe(self):
        state = self.tool.state
        return np.concatenate([state["held_point"] - GRASP, self.goal - GRASP, state["force"]]).astype(np.float32)


if __name__ == "__main__":
    world = Retraction()
    for episode in range(int(sys.argv[1]) if len(sys.argv) > 1 else 2):
        observation, _ = world.reset(seed=episode)
        total, done = 0.0, False
        while not done:  # a straight path to the goal as a baseline for a policy
            observation, reward, terminated, truncated, info = world.step((observation[3:6] - observation[0:3]) / STEP)
            total, done = total + reward, terminated or truncated
        print("episode %d: %s after %d steps, %.1f mm from the goal, %.2f N, reward %.2f" % (
            episode, "reached" if terminated else "not reached", world.steps, 1e3 * info["distance"],
            np.linalg.norm(info["force"]), total))
