"""Python interface of Pliant: simulate a scan as tissue that can be pulled, grasped and cut.

    import pliant
    # For the built-in phantom: pliant.Sim(options={"solver/iterations": 8})
    sim = pliant.Sim("scene.yaml", scan="ct.nii.gz")
    forceps = sim.tool("forceps")
    forceps.grasp(point)                                 # at rest, LPS [m]
    forceps.move(point + [0, -0.01, 0])
    sim.step()
    sim.nodes, forceps.force, sim.error, sim.volume().values

Lengths are in metres, forces in newtons, axes are the patient's (LPS). Arrays are copies, which later steps do not
change. Other Python threads run during a step, and several simulations may share one Model. A thread that uses a
simulation during another thread's step waits for its end.

Needs numpy and libpliant.so, which is searched in $PLIANT_LIBRARY, next to this file, in the installation folder,
and on the system's path.
"""
import ctypes
import os
import weakref

import numpy as np

if __package__:  # installed in the same package as the ROS messages
    from . import pliant_library as _c
    from .pliant_results import (Contacts, Cut, Displacement, Picture, Proxy, Volume, camera_of, look_at, volume_at,
                                 whole)
    from .pliant_tool import Error, Held, Tool, all_while_open
else:
    import pliant_library as _c
    from pliant_results import (Contacts, Cut, Displacement, Picture, Proxy, Volume, camera_of, look_at, volume_at,
                                whole)
    from pliant_tool import Error, Held, Tool, all_while_open

__all__ = ["Error", "Model", "Sim", "Tool", "Volume", "Displacement", "Cut", "Contacts", "Proxy", "Picture", "look_at",
           "options", "version"]


def version():
    return _c.library.pliant_version().decode()


class _OptionInfo(ctypes.Structure):
    _fields_ = ([(name, ctypes.c_char_p) for name in ("group", "name", "kind", "default", "range", "unit", "text")] +
                [("low", ctypes.c_double), ("high", ctypes.c_double)])


def options():
    """Return every option of a scene: {"solver/iterations": {"kind", "default", "range", "unit", "text"}}."""
    count = ctypes.c_size_t()
    table = ctypes.cast(_c.library.pliant_scene_options(ctypes.byref(count)), ctypes.POINTER(_OptionInfo))
    return {"%s/%s" % (info.group.decode(), info.name.decode()):
            {key: getattr(info, key).decode() for key in ("kind", "default", "range", "unit", "text")}
            for info in table[:count.value]}


def _option_text(value):
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple, np.ndarray)):
        return " ".join(_option_text(v) for v in value)
    return repr(float(value)) if isinstance(value, (float, np.floating)) else str(value)


# ---- constant data

class Model:
    """A scan and the data computed from it and a scene. Constant; any number of simulations may share it.

    scene: path of a YAML file, or None
    scan: "phantom", "phantom:80x58x60", or a path
    options: {"group/name": value}; they override the file
    progress: called with (fraction, stage); return False to cancel
    shapes: tools with a shape will touch the tissue; element/kind auto then becomes linear, so that contact
    prevents tunneling"""

    def __init__(self, scene=None, scan="phantom", options=None, progress=None, shapes=False):
        self._scene = _c.Struct("pliant_scene")
        _c.library.pliant_scene_defaults(self._scene.address)
        if scene is not None:
            _c.call("scene_read", os.fsencode(scene), self._scene.address)
        for name, value in (options or {}).items():
            _c.call("scene_set", self._scene.address, name.encode(), _option_text(value).encode())
        if shapes:
            _c.library.pliant_scene_for_shapes(self._scene.address)
        _c.call("scene_check", self._scene.address)
        self._scan, labels, materials = (_c.Struct(of)
                                         for of in ("pliant_volume", "pliant_labels", "pliant_material_table"))
        raised, model = [], ctypes.c_void_p()

        def ask(fraction, stage, user):
            try:
                return progress(fraction, stage.decode()) is not False
            except BaseException as error:  # exceptions cannot pass through C
                raised.append(error)
                return False
        report = _c.Progress.function_type(ask) if progress else None
        try:
            _c.call("inputs_read", self._scene.address, os.fsencode(scan), self._scan.address, labels.address,
                    materials.address)
            _c.call("model_build", self._scene.address, self._scan.address, labels.address, materials.address,
                  _c.Progress(ctypes.cast(report, ctypes.c_void_p) if report else None, None), ctypes.byref(model))
        except BaseException:
            _c.library.pliant_volume_free(self._scan.address)
            if raised:
                raise raised[0]
            raise
        finally:
            _c.library.pliant_material_table_free(materials.address)
            _c.library.pliant_labels_free(labels.address)
        self._built = [model.value]
        weakref.finalize(self, _free_model, self._built, self._scan)

    @property
    def _model(self):
        if not self._built:
            raise Error(_c.ARGUMENT, "this model is closed: the interpreter ends")
        return self._built[0]

    def __copy__(self):
        return self

    def __deepcopy__(self, memo):
        return self

    def __reduce__(self):
        raise Error(_c.ARGUMENT,
                    "a Model cannot be pickled: pass its scene, scan and options, and build it again there")

    @property
    def materials(self):
        """Names of the materials; Sim.materials contains indices into this list."""
        table = _c.Struct("pliant_material_table", _c.library.pliant_model_get_materials(self._model))
        size = _c.library.pliant_layout_size(b"pliant_material")
        return [_c.Struct("pliant_material", table["materials"] + size * m)["name"]
                for m in range(table["num_materials"])]

    @property
    def scan(self):
        """The scan of the model."""
        return volume_at(_c.library.pliant_model_get_scan(self._model))


def _free_model(built, scan):
    _c.library.pliant_model_free(built.pop())
    _c.library.pliant_volume_free(scan.address)


# ---- simulation state

@all_while_open
class Sim:
    """A simulation of a model, or of a scene and a scan as for Model. Raises ValueError if a model is combined with
    arguments of Model.

    copy.copy and copy.deepcopy are equal to copy(): the copies share the Model. A simulation cannot be pickled."""

    def __init__(self, scene=None, scan="phantom", options=None, model=None, progress=None, shapes=False):
        if model is not None and (scene is not None or options or shapes):
            raise ValueError("the model sets scene, options and shapes: pass them to Model(...)")
        if model is not None and not isinstance(model, Model):
            raise TypeError("model: expected a Model, not %s" % type(model).__name__)
        if model is None:
            model = Model(scene, scan, options, progress, shapes)
        data = ctypes.c_void_p()
        _c.call("data_create", model._model, ctypes.byref(data))
        self._own(model, data.value, {})

    def _own(self, model, data, tools):  # tools: index by name
        self._held, self._tools = Held(model, data), tools
        weakref.finalize(self, self._held.free)

    @property
    def _data(self):
        return self._held.data

    @property
    def model(self):
        return self._held.model

    def close(self):
        """Free the memory after the end of another thread's step. Later use of the simulation or its tools raises
        Error."""
        self._held.free()

    def __copy__(self):
        return self.copy()

    def __deepcopy__(self, memo):
        return self.copy()

    def __reduce__(self):
        raise Error(_c.ARGUMENT, "a Sim cannot be pickled: copy() makes another one in this process; pass on the scene "
                    "and the scan to another process")

    # STEPS
    def step(self):
        """Compute one step of the scene (solver/step). Return whether it has converged."""
        return _c.call("step", self.model._model, self._data) == 0

    def reset(self):
        """Return to rest and remove all cuts; tools keep their poses and grasp nothing."""
        _c.call("data_reset", self.model._model, self._data)

    def copy(self):
        """Return a second simulation with the same state."""
        data, other = ctypes.c_void_p(), Sim.__new__(Sim)
        _c.call("data_copy", self.model._model, self._data, ctypes.byref(data))
        other._own(self.model, data.value, dict(self._tools))
        return other

    def save(self, path=None, unit="m"):
        """Without a path: return the state for restore(). The simulation then continues like a restored one, so that
        the same steps give bitwise identical results each time.
        With a path: write a file by its extension. .vtu: the mesh; .vtp, .ply: the surface (include/pliant/save.h
        lists the arrays); .nii.gz, .nii, .nrrd, .mha: the deformed volume on the scan's grid. unit: of lengths in
        mesh files, m or mm."""
        if path is not None:
            return self._write(os.fsencode(path), unit)
        saved = self.copy()
        self.restore(saved)
        return saved

    def _write(self, path, unit):
        if unit not in ("m", "mm"):
            raise ValueError("unit %r: use 'm' or 'mm'" % (unit,))
        if path.lower().endswith((b".nii", b".nii.gz", b".nrrd", b".mha")):
            self.volume()
            _c.call("volume_write", path, _c.library.pliant_warp_volume(self._held.warp))
            return
        forces = np.zeros((self._body()["fine.num_nodes"], 3))
        _c.library.pliant_data_get_contact_forces(self._data, forces.ctypes.data)
        _c.call("mesh_save", path, self.model._model, _c.library.pliant_data_get_body(self._data),
                _c.library.pliant_data_get_positions(self._data, None), forces.ctypes.data,
                1e-3 if unit == "mm" else 1.0)

    def restore(self, saved):
        """Become a copy of another simulation of the same Model, including its tools. Raises Error for another
        Model, even one of the same scene."""
        if not isinstance(saved, Sim):
            raise TypeError("restore: expected what save() returned, not %s" % type(saved).__name__)
        with saved._held.lock:
            if saved._data is None:
                raise Error(_c.ARGUMENT, "restore: the saved simulation is closed")
            _c.call("data_move", self.model._model, self._data, saved._data)
            self._tools = dict(saved._tools)

    def limits(self, iterations, tolerance):
        _c.call("data_set_limits", self._data, iterations, tolerance)

    @property
    def gravity(self):
        out, address = _c.numbers(np.zeros(3), 3)
        _c.library.pliant_data_get_gravity(self._data, address)
        return out

    @gravity.setter
    def gravity(self, value):
        array, address = _c.numbers(value, 3)
        _c.call("data_set_gravity", self._data, address)

    # STATE
    def _body(self):
        return _c.Struct("pliant_body", _c.library.pliant_data_get_body(self._data))

    def _of_body(self, name, kind, count, *shape):
        body = self._body()
        return _c.array(body[name], kind, body[count], *shape)

    @property
    def nodes(self):
        """(nodes, 3) current positions of the fine mesh's nodes [m]."""
        return _c.array(_c.library.pliant_data_get_positions(self._data, None), "d", self._body()["fine.num_nodes"], 3)

    @nodes.setter
    def nodes(self, value):
        array, address = _c.numbers(value, self._body()["fine.num_nodes"], 3)
        _c.call("data_set_positions", self.model._model, self._data, address)

    @property
    def rest(self):
        """(nodes, 3) rest positions in the scan [m]."""
        return self._of_body("fine.rest", "d", "fine.num_nodes", 3)

    @property
    def tets(self):
        """(tetrahedra, 4) node indices; a cut appends tetrahedra and keeps the existing numbers."""
        return self._of_body("fine.tets", "i", "fine.num_tets", 4)

    @property
    def triangles(self):
        """(triangles, 3) node indices of the surface, oriented outwards."""
        return self._of_body("triangles", "i", "num_triangles", 3)

    @property
    def materials(self):
        """(tetrahedra) most frequent material of each, an index in Model.materials."""
        body = self._body()
        size = _c.library.pliant_layout_size(b"pliant_tet_material")
        offset = _c.layout["pliant_tet_material"]["material"][1]
        count = body["fine.num_tets"]
        raw = np.frombuffer(ctypes.string_at(body["fine_material"], size * count), np.uint8).reshape(count, size)
        return raw[:, offset:offset + 2].copy().view(np.uint16)[:, 0]

    @property
    def fixed(self):
        """(nodes) True for fixed nodes."""
        return self._of_body("fine_fixed", "B", "fine.num_nodes") != 0

    @property
    def masses(self):
        """(nodes) [kg]"""
        return self._of_body("node_mass", "d", "fine.num_nodes")

    @property
    def revision(self):
        """Number of the topology, which changes with every cut, undo and reset of a cut."""
        return self._body()["revision"]

    @property
    def statistics(self):
        """Statistics of the last step, by the names of pliant_statistics. ended is a number; ended_text is the
        reason why the step ended early."""
        record = _c.Struct("pliant_statistics", _c.library.pliant_data_get_statistics(self._data))
        return dict({name: record[name] for name in record.fields},
                    ended_text=_c.library.pliant_step_end_text(record["ended"]).decode())

    @property
    def error(self):
        """Estimated maximum distance of a node from the converged solution of the step [m]."""
        return self.statistics["error"]

    @property
    def inverted(self):
        """Number of inverted tetrahedra."""
        return _c.library.pliant_data_get_inverted(self._data)

    @property
    def backend(self):
        return _c.library.pliant_data_get_backend(self._data).decode()

    def scalar(self, name):
        """(nodes) "von_mises", "strain_energy", ...: values of output/scalar."""
        names = options()["output/scalar"]["range"].split(" | ")
        if name not in names[1:]:
            raise ValueError("scalar %r: one of %s" % (name, ", ".join(names[1:])))
        out = np.zeros(self._body()["fine.num_nodes"], np.float32)
        _c.call("data_get_scalar", self.model._model, self._data, names.index(name), out.ctypes.data)
        return out

    def volume(self):
        """Return the deformed scan on the scan's grid. It is computed on request, and then only where it has
        changed."""
        body, held = _c.library.pliant_data_get_body(self._data), self._held
        if not held.warp:
            scan = _c.library.pliant_model_get_drawn(self.model._model)
            target, warp = _c.Struct("pliant_geometry"), ctypes.c_void_p()
            _c.call("warp_target", scan, None, 0, 0.0, 2 ** 62, target.address)
            threads = self.model._scene["solver.threads"] or os.cpu_count()
            _c.call("warp_create", scan, body + _c.layout["pliant_body"]["fine"][1], target.address, threads,
                    ctypes.byref(warp))
            try:
                _c.call("warp_set_body", warp, body)
            except Error:
                _c.library.pliant_warp_free(warp)
                raise
            held.warp, held.body = warp.value, _c.library.pliant_body_retain(body)
        if held.body != body:
            _c.call("warp_set_body", held.warp, body)
            _c.library.pliant_body_release(held.body)
            held.body = _c.library.pliant_body_retain(body)
        _c.call("warp_update", held.warp, _c.library.pliant_data_get_positions(self._data, None))
        return volume_at(_c.library.pliant_warp_volume(held.warp))

    _senses = ("resample", "tissue")

    def displacement(self, sense="resample"):
        """Return the displacement of every voxel on the scan's grid, as a Displacement.
        resample: ITK's convention, from a voxel of volume() to the rest position of its tissue; a transform with it
        resamples the scan into volume().
        tissue: from a voxel of the scan to the current position of its tissue."""
        if sense not in self._senses:
            raise ValueError("sense %r: one of %s" % (sense, ", ".join(self._senses)))
        field = _c.Struct("pliant_displacement")
        scan = _c.library.pliant_model_get_scan(self.model._model)  # the struct begins with its geometry
        _c.call("displacement_create", self.model._model, _c.library.pliant_data_get_body(self._data),
                _c.library.pliant_data_get_positions(self._data, None), self._senses.index(sense), scan, field.address)
        return Displacement(field)

    # PICTURES
    styles = ("threshold", "beneath", "ambient", "diffuse", "specular", "background")

    def _view(self):
        held = self._held
        if not held.view:
            view = ctypes.c_void_p()
            _c.call("view_create", self.model._model, None, ctypes.byref(view))
            held.view = view.value
        _c.call("view_set", held.view, _c.library.pliant_data_get_body(self._data),
                _c.library.pliant_data_get_positions(self._data, None), None)
        return held.view

    def render(self, K, T, size=(640, 480), near=0.0, far=0.0, **style):
        """Render the current tissue.

        K: (3, 3) intrinsics [pixels]
        T: (4, 4) from the camera's axes (x right, y down, z forward) to LPS [m], as from look_at
        size: width, height
        near, far: along z [m]; tissue at `near` is cut and shows the scan
        style: threshold=HU, shown=[names of materials] (only their surface), colours=[(value, r, g, b), ...],
        beneath, ambient, diffuse, specular, background"""
        width, height = whole(size)
        camera, image = camera_of(K, T, (width, height), near, far), _c.Struct("pliant_image")
        picture, of = Picture(height, width), _c.Struct("pliant_style")
        _c.call("style_defaults", _c.library.pliant_model_get_scan(self.model._model), of.address)
        if "shown" in style:
            names, wanted = self.model.materials, style.pop("shown")
            of["by_label"] = True
            of["shown"] = [int(0 < n <= len(names) and names[n - 1] in wanted) for n in range(256)]
        if "colours" in style:
            colours = np.asarray(style.pop("colours"), np.float64)
            if colours.ndim != 2 or colours.shape[1] != 4 or not 0 < len(colours) <= 16:
                raise ValueError("colours: expected 1 to 16 rows of (value, r, g, b), not an array of shape %s" %
                                 (colours.shape,))
            of["num_colours"] = len(colours)
            of["colours"] = np.concatenate([colours.ravel(), np.zeros(64 - colours.size)])
        for name, value in style.items():
            if name not in self.styles:
                raise ValueError("style %r: one of shown, colours, %s" % (name, ", ".join(self.styles)))
            of[name] = value
        image["rgb"], image["depth"], image["label"] = (array.ctypes.data
                                                        for array in (picture.rgb, picture.depth, picture.label))
        _c.call("view_render", self._view(), camera.address, of.address, image.address)
        return picture

    def radiograph(self, isocentre, primary=0.0, secondary=0.0, size=(512, 512), pixel=0.001, source_to_isocentre=0.8,
                   source_to_detector=1.2,
                   water=20.59):
        """Return the (height, width) line integrals of attenuation that a C-arm around a point [m] projects; its
        detector measures exp(-integral).
        primary, secondary: DICOM's positioner angles (LAO, cranial) [rad]; pixel: edge of a detector pixel [m];
        water: attenuation of water [1/m], by default at 60 keV."""
        width, height = whole(size)
        arm, camera = _c.Struct("pliant_c_arm"), _c.Struct("pliant_camera")
        for name, value in (("isocentre", isocentre), ("source_to_isocentre", source_to_isocentre),
                            ("source_to_detector", source_to_detector),
                            ("primary_angle", primary), ("secondary_angle", secondary), ("width", width),
                            ("height", height), ("pixel", pixel)):
            arm[name] = value
        _c.call("c_arm_camera", arm.address, camera.address)
        out = np.zeros((height, width), np.float32)
        _c.call("view_radiograph", self._view(), camera.address, water, out.ctypes.data)
        return out

    # CUTS (scenes with cut/kind)
    def cut(self, points, depth):
        """Cut the deformed tissue immediately along a line of points (n, 3), down to the vector depth [m]."""
        line, line_address = _c.numbers(points, len(points), 3)
        down, down_address = _c.numbers(depth, 3)
        report = _c.Struct("pliant_cut_report")
        _c.call("data_cut", self.model._model, self._data, len(line), line_address, down_address, report.address)
        return Cut(report)

    def undo_cut(self):
        _c.call("data_undo_cut", self.model._model, self._data)

    # TOOLS
    def tool(self, name="tool"):
        """Return the tool of this name, which is added if it is new."""
        if name not in self._tools:
            index = ctypes.c_int()
            _c.call("tool_add", self.model._model, self._data, name.encode(), ctypes.byref(index))
            self._tools[name] = index.value
        return Tool(self, name)

    @property
    def contacts(self):
        """Contacts of the last step, with tools, obstacles and tissue."""
        capacity = _c.library.pliant_data_get_contacts(self._data, 0, None)
        record = _c.records("pliant_contact", capacity)
        _c.library.pliant_data_get_contacts(self._data, capacity, record.ctypes.data)
        return Contacts(record)

    def wrench(self, name="tool"):
        """(6) force [N] and torque about its tip [N m] of a tool on the tissue."""
        return self.tool(name).wrench
