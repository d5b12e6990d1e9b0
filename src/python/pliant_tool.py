"""Tools of a simulation, and the lock under which its library objects are used and freed."""
import functools
import os
import threading

import numpy as np

if __package__:  # installed in the same package as the ROS messages
    from . import pliant_library as _c
    from .pliant_results import Proxy
else:
    import pliant_library as _c
    from pliant_results import Proxy

Error = _c.Error


class Held:
    """Library objects of a simulation. They are freed once: by close(), or when the Sim is garbage-collected."""

    def __init__(self, model, data):
        self.model, self.data, self.lock = model, data, threading.RLock()
        self.view = self.warp = self.body = None  # body: retained, used by the warp

    def free(self):
        with self.lock:
            if self.data is None:
                return
            _c.library.pliant_view_free(self.view)
            _c.library.pliant_warp_free(self.warp)
            _c.library.pliant_body_release(self.body)
            _c.library.pliant_data_free(self.data)
            self.view = self.warp = self.body = self.data = None


def _while_open(function):
    """Wrap a function of Sim or Tool: hold the simulation's lock, and raise Error after close()."""
    @functools.wraps(function)
    def locked(self, *arguments, **named):
        held = self._held
        with held.lock:
            if held.data is None:
                raise Error(_c.ARGUMENT, "this simulation is closed: create another one, Sim(model=...)")
            return function(self, *arguments, **named)
    return locked


def all_while_open(of):
    """Wrap every public function and property of a class in _while_open, except close and model."""
    for name, member in list(vars(of).items()):
        if name.startswith("_") or name in ("close", "model"):
            continue
        if isinstance(member, property):
            setattr(of, name, property(_while_open(member.fget), _while_open(member.fset) if member.fset else None,
                                       None, member.__doc__))
        elif callable(member):
            setattr(of, name, _while_open(member))
    return of


@all_while_open
class Tool:
    """A tool of a simulation: it has a pose, grasps, pulls, and cuts if it has a blade. Raises Error if a restored
    state has no tool of its name."""

    drives = ("spring", "rigid", "force")

    def __init__(self, sim, name):
        self._sim, self._name = sim, name

    @property
    def _held(self):
        return self._sim._held

    @property
    def _index(self):
        if self._name not in self._sim._tools:
            raise Error(_c.ARGUMENT, "the restored state has no tool %s: add it with sim.tool(%r)" %
                        (self._name, self._name))
        return self._sim._tools[self._name]

    def _get(self):
        record = _c.Struct("pliant_tool_state")
        _c.call("tool_get", self._sim._data, self._index, record.address)
        return record

    def move(self, tip, rotation=None):
        """Set the tip position [m], and the orientation as a quaternion x y z w."""
        place, address = _c.numbers(tip, 3)
        axes, axes_address = _c.numbers((0, 0, 0, 1) if rotation is None else rotation, 4)
        _c.call("tool_set_pose", self._sim._data, self._index, address, axes_address)

    def grasp(self, point=None):
        """Grasp the tissue at the tip, or at a rest point of the scan [m]. A tool without a pose is placed there."""
        place, address = (None, None) if point is None else _c.numbers(point, 3)
        is_placed = place is not None and not self._get()["present"]
        if is_placed:
            self.move(place)
        try:
            _c.call("tool_grasp", self._sim.model._model, self._sim._data, self._index, address)
        except Error:
            if is_placed:
                self.remove()  # a tool that had no pose gets none
            raise

    def release(self):
        _c.library.pliant_tool_release(self._sim._data, self._index)

    def remove(self):
        """Remove the tool: it releases the tissue and has no pose."""
        _c.library.pliant_tool_remove_pose(self._sim._data, self._index)

    def drive(self, kind, force=None):
        """Set how the present grasp is driven: spring: a damped spring to the tip; rigid: the grasped point follows
        the tip; force: this force on the tissue [N]."""
        if kind not in self.drives:
            raise ValueError("drive %r: one of %s" % (kind, ", ".join(self.drives)))
        array, address = (None, None) if force is None else _c.numbers(force, 3)
        _c.call("tool_set_drive", self._sim._data, self._index, self.drives.index(kind), address)

    def spring(self, stiffness, damping=0.0):
        _c.call("tool_set_spring", self._sim._data, self._index, stiffness, damping)

    def radius(self, metres):
        """Set the radius of the blob that the next grasp holds [m]."""
        _c.call("tool_set_radius", self._sim._data, self._index, metres)

    def blade(self, name=None, ends=None):
        """Set the blade: scalpel, scissors or hook, or an edge by its ends (2, 3) in the tool's frame [m]."""
        edge, address = _c.numbers(np.zeros((2, 3)) if ends is None else ends, 2, 3)
        if name is not None:
            _c.call("blade_find", name.encode(), address, address + 24)
        _c.call("tool_set_blade", self._sim._data, self._index, address, address + 24)

    def shape(self, name=None, offset=(0, 0, 0)):
        """Set the collision shape, from the next step on: an instrument by its name or code (prograsp_forceps,
        400006, probe), or a YAML file of parts (include/pliant/contact.h); None: no contact. offset: of the shape in
        the tool's frame [m]."""
        of = _c.Struct("pliant_tool_shape")
        shift, address = _c.numbers(offset, 3)
        if name is not None:
            text = os.fsdecode(name)
            is_file = isinstance(name, os.PathLike) or os.sep in text or text.endswith((".yaml", ".yml"))
            _c.call("tool_shape_read" if is_file else "tool_shape_find", os.fsencode(text), of.address)
        _c.library.pliant_tool_shape_move(of.address, address)
        try:
            _c.call("tool_set_shape", self._sim._data, self._index, of.address)
        finally:
            _c.library.pliant_tool_shape_free(of.address)

    def jaw(self, angle):
        """Set the angle between the jaws of the shape, from the next step on [rad]; 0: closed. The jaws hold tissue
        by friction; there is no grasp constraint."""
        _c.call("tool_set_jaw", self._sim._data, self._index, angle)

    def cutting(self, on=True):
        """Set whether the blade cuts, from the next step on."""
        _c.call("tool_set_cutting", self._sim._data, self._index, on)

    @property
    def state(self):
        """State of the tool, by the names of pliant_tool_state."""
        record = self._get()
        return {name: record[name] for name in record.fields}

    @property
    def force(self):
        """(3) force on the tissue in the last step, by grasp, blade and contact [N]."""
        record = self._get()
        return record["force"] + record["contact_force"]

    @property
    def contact_force_error(self):
        """Estimated error of the contact force, as a standard deviation [N]."""
        return self._get()["contact_force_error"]

    @property
    def wrench(self):
        """(6) force [N], and torque about the proxy's tip [N m]."""
        record = self._get()
        torque = np.cross(record["held_point"] - record["proxy_tip"], record["force"]) + record["contact_torque"]
        return np.concatenate([record["force"] + record["contact_force"], torque])

    @property
    def proxy(self):
        """The simulated tool after the last step, which tissue can stop, as a Proxy. A tool without a shape is its
        own proxy."""
        record = self._get()
        return Proxy(record["proxy_tip"], record["proxy_rotation"], record["proxy_jaw"])

    @property
    def proxy_error(self):
        """(3) measured tip minus the proxy's tip [m]."""
        return self._get()["proxy_error"]

    @property
    def saturated(self):
        """Whether the coupling force is at contact/max_force, or the jaw torque at contact/grip_torque."""
        return self._get()["saturated"]

    @property
    def contacts(self):
        """Contacts of the shape, as Sim.contacts."""
        return self._sim.contacts.of(self._index)

    @property
    def holding(self):
        return self._get()["holding"]

    @property
    def clearance(self):
        """Signed distance from the tip to the surface that contact uses, negative inside the tissue [m]."""
        return _c.library.pliant_tool_clearance(self._sim.model._model, self._sim._data, self._index)
