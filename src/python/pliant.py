"""Pliant from Python: a scan as tissue that is pulled, held and cut.

    import pliant
    sim = pliant.Sim("scene.yaml", scan="ct.nii.gz")     # or pliant.Sim(options={"solver/iterations": 8}): the built-in phantom
    forceps = sim.tool("forceps")
    forceps.grasp(point)                                 # at rest, LPS [m]
    forceps.move(point + [0, -0.01, 0])
    sim.step()
    sim.nodes, forceps.force, sim.error, sim.volume().values

Lengths are metres, forces newtons, axes the patient's (LPS). Arrays are copies: they stay as they are when the simulation goes on. Steps let
other threads run; several simulations may share one Model, each used by one thread at a time. Needs numpy and libpliant.so, which is looked
for in $PLIANT_LIBRARY, beside this file and where it is installed, and on the system's path.
"""
import ctypes
import logging
import os
import struct
import weakref

import numpy as np

__all__ = ["Error", "Model", "Sim", "Tool", "Volume", "Cut", "Picture", "look_at", "options", "version"]


class Error(RuntimeError):
    """What the library refuses; the message says what would be right. status: pliant_status, below 0."""

    def __init__(self, status, message):
        super().__init__(message)
        self.status = status


# ---- the library

def _open_library():
    here = os.path.dirname(os.path.abspath(__file__))
    names = [os.environ["PLIANT_LIBRARY"]] if os.environ.get("PLIANT_LIBRARY") else []
    for up in ("", "..", "../..", "../../..", "../../../.."):
        names += [os.path.join(here, up, "libpliant.so"), os.path.join(here, up, "lib", "libpliant.so")]
    for name in [os.path.normpath(n) for n in names if os.path.exists(n)] + ["libpliant.so.0"]:
        try:
            return ctypes.CDLL(name)
        except OSError as error:
            reason = error
    raise ImportError("libpliant.so: %s; set PLIANT_LIBRARY to where it lies" % reason)


_library = _open_library()
_pointer, _int, _double, _text, _size = ctypes.c_void_p, ctypes.c_int, ctypes.c_double, ctypes.c_char_p, ctypes.c_size_t


class _Progress(ctypes.Structure):
    function_type = ctypes.CFUNCTYPE(ctypes.c_bool, _double, _text, _pointer)
    _fields_ = [("function", _pointer), ("user", _pointer)]


class _Field(ctypes.Structure):
    _fields_ = [("of", _text), ("name", _text), ("kind", ctypes.c_char), ("offset", _size), ("count", _size)]


def _declare(result, name, *arguments):
    function = getattr(_library, "pliant_" + name)
    function.restype, function.argtypes = result, arguments
    return function


def _call(name, *arguments):
    """A function that returns pliant_status. Above 0: done, with a caveat."""
    status = getattr(_library, "pliant_" + name)(*arguments)
    if status < 0:
        raise Error(status, _library.pliant_last_error().decode(errors="replace"))
    return status


for _result, _name, *_arguments in (
        (_text, "version"), (_text, "last_error"), (_pointer, "layout_fields", _pointer), (_size, "layout_size", _text),
        (None, "set_log", _pointer, _pointer),
        (None, "scene_defaults", _pointer), (_int, "scene_read", _text, _pointer), (_int, "scene_set", _pointer, _text, _text),
        (_int, "scene_check", _pointer), (_pointer, "scene_options", _pointer),
        (_int, "inputs_read", _pointer, _text, _pointer, _pointer, _pointer),
        (_int, "model_build", _pointer, _pointer, _pointer, _pointer, _Progress, _pointer), (None, "model_free", _pointer),
        (_pointer, "model_get_scan", _pointer), (_pointer, "model_get_drawn", _pointer), (_pointer, "model_get_materials", _pointer), (_pointer, "model_get_scene", _pointer),
        (None, "material_table_free", _pointer), (None, "labels_free", _pointer), (None, "volume_free", _pointer),
        (_int, "data_create", _pointer, _pointer), (None, "data_free", _pointer), (_int, "data_reset", _pointer, _pointer),
        (_int, "data_copy", _pointer, _pointer, _pointer), (_int, "data_take", _pointer, _pointer, _pointer),
        (_int, "step", _pointer, _pointer), (_pointer, "data_get_body", _pointer), (_pointer, "data_get_positions", _pointer, _pointer),
        (_pointer, "data_get_statistics", _pointer), (_text, "data_get_backend", _pointer), (None, "data_get_gravity", _pointer, _pointer),
        (_int, "data_set_gravity", _pointer, _pointer), (_int, "data_set_positions", _pointer, _pointer, _pointer),
        (_int, "data_set_limits", _pointer, _int, _double), (_int, "data_get_inverted", _pointer),
        (_int, "data_scalar", _pointer, _pointer, _pointer, _int, _pointer),
        (_int, "data_cut", _pointer, _pointer, ctypes.c_int32, _pointer, _pointer, _pointer), (_int, "data_undo_cut", _pointer, _pointer),
        (_int, "tool_add", _pointer, _pointer, _text, _pointer), (_int, "tool_get", _pointer, _int, _pointer),
        (_int, "tool_set_pose", _pointer, _int, _pointer, _pointer), (_int, "tool_grasp", _pointer, _pointer, _int, _pointer),
        (None, "tool_release", _pointer, _int), (None, "tool_lost", _pointer, _int), (_int, "tool_set_drive", _pointer, _int, _int, _pointer),
        (_int, "tool_set_spring", _pointer, _int, _double, _double), (_int, "tool_set_radius", _pointer, _int, _double),
        (_int, "tool_set_mass", _pointer, _int, _double), (_int, "blade_find", _text, _pointer, _pointer),
        (_int, "tool_set_blade", _pointer, _int, _pointer, _pointer), (_int, "tool_set_cutting", _pointer, _int, ctypes.c_bool),
        (_double, "tool_clearance", _pointer, _pointer, _int),
        (_int, "warp_target", _pointer, _pointer, ctypes.c_int32, _double, _size, _pointer),
        (_int, "warp_create", _pointer, _pointer, _pointer, _int, _pointer), (None, "warp_free", _pointer),
        (_int, "warp_set_body", _pointer, _pointer), (_int, "warp_update", _pointer, _pointer), (_pointer, "warp_volume", _pointer),
        (None, "camera_of_view", ctypes.c_int32, ctypes.c_int32, _double, _pointer), (_int, "camera_look_at", _pointer, _pointer, _pointer, _pointer),
        (_int, "c_arm_camera", _pointer, _pointer), (_int, "style_defaults", _pointer, _pointer),
        (_int, "view_create", _pointer, _pointer, _pointer), (None, "view_free", _pointer),
        (_int, "view_set", _pointer, _pointer, _pointer, _pointer), (_int, "view_render", _pointer, _pointer, _pointer, _pointer),
        (_int, "view_radiograph", _pointer, _pointer, _double, _pointer),
        (_pointer, "body_retain", _pointer), (None, "body_release", _pointer)):
    _declare(_result, _name, *_arguments)


def _read_layout():
    count = _size()
    fields = ctypes.cast(_library.pliant_layout_fields(ctypes.byref(count)), ctypes.POINTER(_Field))
    layout = {}
    for field in fields[:count.value]:
        layout.setdefault(field.of.decode(), {})[field.name.decode()] = (field.kind.decode(), field.offset, field.count)
    return layout


_layout = _read_layout()
_dtypes = {"d": np.float64, "f": np.float32, "i": np.int32, "h": np.int16, "B": np.uint8}


class _Struct:
    """A struct of the library: room of its own, or what lies at an address for as long as that holds."""

    def __init__(self, of, address=None):
        self.fields, self.size = _layout.get(of, {}), _library.pliant_layout_size(of.encode())
        self.room = ctypes.create_string_buffer(self.size) if address is None else None
        self.address = address if address is not None else ctypes.addressof(self.room)

    def __getitem__(self, name):
        kind, offset, count = self.fields[name]
        if kind == "s":
            return ctypes.string_at(self.address + offset).decode(errors="replace")
        values = struct.unpack("@%d%s" % (count, kind), ctypes.string_at(self.address + offset, count * struct.calcsize("@" + kind)))
        return values[0] if count == 1 else np.array(values)

    def __setitem__(self, name, value):
        kind, offset, count = self.fields[name]
        values = np.ravel(value).tolist()
        if len(values) != count:
            raise ValueError("%s: expected %d numbers, not %d" % (name, count, len(values)))
        ctypes.memmove(self.address + offset, struct.pack("@%d%s" % (count, kind), *values), count * struct.calcsize("@" + kind))


def _array(address, kind, *shape):
    """A copy of an array of the library."""
    dtype = np.dtype(_dtypes[kind])
    if not address or 0 in shape:
        return np.zeros(shape, dtype)
    return np.frombuffer(ctypes.string_at(address, dtype.itemsize * int(np.prod(shape))), dtype).reshape(shape).copy()


def _numbers(values, *shape):
    """Numbers as the library takes them, and their address."""
    array = np.ascontiguousarray(values, np.float64)
    if array.shape != shape:
        raise ValueError("expected numbers of shape %s, not %s" % (shape, array.shape))
    return array, array.ctypes.data


_levels = (logging.DEBUG, logging.INFO, logging.WARNING, logging.ERROR)
_log_type = ctypes.CFUNCTYPE(None, _int, _text, _pointer)
_log = _log_type(lambda level, message, user: logging.getLogger("pliant").log(_levels[level], message.decode(errors="replace")))
_library.pliant_set_log(ctypes.cast(_log, _pointer), None)  # kept for as long as the library is


def version():
    return _library.pliant_version().decode()


class _OptionInfo(ctypes.Structure):
    _fields_ = [(name, _text) for name in ("group", "name", "kind", "default", "range", "unit", "text")] + [("low", _double), ("high", _double)]


def options():
    """Every option of a scene: {"solver/iterations": {"kind", "default", "range", "unit", "text"}}."""
    count = _size()
    table = ctypes.cast(_library.pliant_scene_options(ctypes.byref(count)), ctypes.POINTER(_OptionInfo))
    return {"%s/%s" % (info.group.decode(), info.name.decode()): {key: getattr(info, key).decode() for key in ("kind", "default", "range", "unit", "text")}
            for info in table[:count.value]}


def _option_text(value):
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple, np.ndarray)):
        return " ".join(_option_text(v) for v in value)
    return repr(float(value)) if isinstance(value, (float, np.floating)) else str(value)


# ---- what is built once

class Model:
    """A scan and what follows from it and a scene. Constant: any number of simulations may share it.

    scene: path of a YAML file, or None; scan: "phantom", "phantom:80x58x60", or a path; options: {"group/name": value}, over those of the file;
    progress: called with (fraction, stage); returns False to cancel."""

    def __init__(self, scene=None, scan="phantom", options=None, progress=None):
        self._scene = _Struct("pliant_scene")
        _library.pliant_scene_defaults(self._scene.address)
        if scene is not None:
            _call("scene_read", os.fsencode(scene), self._scene.address)
        for name, value in (options or {}).items():
            _call("scene_set", self._scene.address, name.encode(), _option_text(value).encode())
        _call("scene_check", self._scene.address)
        self._scan, labels, materials = (_Struct(of) for of in ("pliant_volume", "pliant_labels", "pliant_material_table"))
        report = _Progress.function_type(lambda fraction, stage, user: progress(fraction, stage.decode()) is not False) if progress else None
        model = _pointer()
        try:
            _call("inputs_read", self._scene.address, os.fsencode(scan), self._scan.address, labels.address, materials.address)
            _call("model_build", self._scene.address, self._scan.address, labels.address, materials.address,
                  _Progress(ctypes.cast(report, _pointer) if report else None, None), ctypes.byref(model))
        except Error:
            _library.pliant_volume_free(self._scan.address)
            raise
        finally:
            _library.pliant_material_table_free(materials.address)
            _library.pliant_labels_free(labels.address)
        self._model = model.value
        weakref.finalize(self, _free_model, self._model, self._scan)

    @property
    def materials(self):
        """Names, by the numbers that Sim.materials tells."""
        table = _Struct("pliant_material_table", _library.pliant_model_get_materials(self._model))
        size = _library.pliant_layout_size(b"pliant_material")
        return [_Struct("pliant_material", table["materials"] + size * m)["name"] for m in range(table["num_materials"])]

    @property
    def scan(self):
        """The scan that it was built from."""
        return Volume(_library.pliant_model_get_scan(self._model))


def _free_model(model, scan):
    _library.pliant_model_free(model)
    _library.pliant_volume_free(scan.address)


def _free_data(data, model, warp):  # model: kept until then
    _library.pliant_view_free(warp["view"])
    if warp["warp"]:
        _library.pliant_warp_free(warp["warp"])
        _library.pliant_body_release(warp["body"])
    _library.pliant_data_free(data)


class Volume:
    """A copy of a volume. values[k, j, i] as stored; voxel (i, j, k) lies at origin + direction @ (spacing * (i, j, k))."""

    def __init__(self, address):
        told = _Struct("pliant_volume", address)
        size = told["geometry.size"]
        self.values = _array(told["voxels"], {1: "B", 2: "h", 3: "f"}[told["encoding"]], *(int(n) for n in size[::-1]))
        self.origin, self.spacing, self.direction = told["geometry.origin"], told["geometry.spacing"], told["geometry.direction"].reshape(3, 3)
        self.slope, self.intercept, self.background = told["slope"], told["intercept"], told["background"]

    @property
    def intensities(self):
        """With slope and intercept; of a CT Hounsfield units."""
        return self.slope * self.values.astype(np.float32) + self.intercept


class Cut:
    """What a cut has severed: area at rest [m^2], links between voxels, pieces of tissue after it."""

    def __init__(self, report):
        self.area, self.links, self.touched, self.pieces = report["area"], report["num_links"], report["touched"], report["pieces"]


class Picture:
    """What a camera sees: rgb (height, width, 3) uint8, depth along z [m], NaN where nothing is, label (height, width) of the tissue: a number in
    Model.materials plus 1, 0 for none."""

    def __init__(self, height, width):
        self.rgb, self.depth = np.zeros((height, width, 3), np.uint8), np.zeros((height, width), np.float32)
        self.label = np.zeros((height, width), np.uint8)


def look_at(point, at, up=(0, 0, 1)):
    """T of a camera at a point that looks at another one [m]; up: direction that is up in its image."""
    camera = _Struct("pliant_camera")
    numbers = [_numbers(v, 3) for v in (point, at, up)]
    _call("camera_look_at", camera.address, *(address for _, address in numbers))
    return np.vstack([camera["pose"].reshape(3, 4), (0, 0, 0, 1)])


def _camera(K, T, size, near, far):
    camera = _Struct("pliant_camera")
    K, T = np.asarray(K, np.float64), np.asarray(T, np.float64)
    if K.shape != (3, 3) or T.shape not in ((3, 4), (4, 4)):
        raise ValueError("expected K of shape (3, 3) and T of (4, 4), not %s and %s" % (K.shape, T.shape))
    camera["width"], camera["height"] = size
    for name, value in (("fx", K[0, 0]), ("fy", K[1, 1]), ("cx", K[0, 2]), ("cy", K[1, 2]), ("pose", T[:3]), ("near", near), ("far", far)):
        camera[name] = value
    return camera


# ---- what moves

class Sim:
    """A simulation of a model, or of a scene and a scan as Model takes them."""

    def __init__(self, scene=None, scan="phantom", options=None, model=None, progress=None):
        self.model = model or Model(scene, scan, options, progress)
        data = _pointer()
        _call("data_create", self.model._model, ctypes.byref(data))
        self._own(data.value)

    def _own(self, data):
        self._data, self._tools, self._warp = data, {}, {"warp": None, "body": None, "view": None}
        self._free = weakref.finalize(self, _free_data, self._data, self.model, self._warp)

    def close(self):
        """Free its memory now; nothing else may be asked of it then."""
        self._free()
        self._data = None

    # STEPS
    def step(self):
        """One step of the scene (solver/step). Whether it has met the tolerance."""
        return _call("step", self.model._model, self._data) == 0

    def reset(self):
        """Back to rest, whole; tools keep their poses and hold nothing."""
        _call("data_reset", self.model._model, self._data)

    def copy(self):
        """Another simulation that goes on from here."""
        data, other = _pointer(), Sim.__new__(Sim)
        _call("data_copy", self.model._model, self._data, ctypes.byref(data))
        other.model = self.model
        other._own(data.value)
        other._tools = {name: Tool(other, tool._index) for name, tool in self._tools.items()}
        return other

    def save(self):
        """What it is now, for restore. It goes on as one that was restored, so that the same steps give the same bits each time."""
        saved = self.copy()
        self.restore(saved)
        return saved

    def restore(self, saved):
        _call("data_take", self.model._model, self._data, saved._data)
        self._tools = {name: self._tools.get(name) or Tool(self, tool._index) for name, tool in saved._tools.items()}

    def limits(self, iterations, tolerance):
        _call("data_set_limits", self._data, iterations, tolerance)

    @property
    def gravity(self):
        out, address = _numbers(np.zeros(3), 3)
        _library.pliant_data_get_gravity(self._data, address)
        return out

    @gravity.setter
    def gravity(self, value):
        array, address = _numbers(value, 3)
        _call("data_set_gravity", self._data, address)

    # STATE
    def _body(self):
        return _Struct("pliant_body", _library.pliant_data_get_body(self._data))

    def _of_body(self, name, kind, count, *shape):
        body = self._body()
        return _array(body[name], kind, body[count], *shape)

    @property
    def nodes(self):
        """(nodes, 3) where the nodes of the fine mesh are [m]."""
        return _array(_library.pliant_data_get_positions(self._data, None), "d", self._body()["fine.num_nodes"], 3)

    @nodes.setter
    def nodes(self, value):
        array, address = _numbers(value, self._body()["fine.num_nodes"], 3)
        _call("data_set_positions", self.model._model, self._data, address)

    @property
    def rest(self):
        """(nodes, 3) where they were in the scan [m]."""
        return self._of_body("fine.rest", "d", "fine.num_nodes", 3)

    @property
    def tets(self):
        """(tetrahedra, 4) nodes; a cut appends some, numbers stay."""
        return self._of_body("fine.tets", "i", "fine.num_tets", 4)

    @property
    def triangles(self):
        """(triangles, 3) surface, outwards."""
        return self._of_body("triangles", "i", "num_triangles", 3)

    @property
    def materials(self):
        """(tetrahedra) the most frequent material of each, a number in Model.materials."""
        body = self._body()
        size = _library.pliant_layout_size(b"pliant_tet_material")
        offset = _layout["pliant_tet_material"]["material"][1]
        count = body["fine.num_tets"]
        raw = np.frombuffer(ctypes.string_at(body["fine_material"], size * count), np.uint8).reshape(count, size)
        return raw[:, offset:offset + 2].copy().view(np.uint16)[:, 0]

    @property
    def fixed(self):
        """(nodes) True where a node does not move."""
        return self._of_body("fine_fixed", "B", "fine.num_nodes") != 0

    @property
    def masses(self):
        """(nodes) [kg]"""
        return self._of_body("node_mass", "d", "fine.num_nodes")

    @property
    def revision(self):
        """Of the topology: another number after every cut, undo and reset of one."""
        return self._body()["revision"]

    @property
    def statistics(self):
        """Of the last step, by the names of pliant_statistics."""
        told = _Struct("pliant_statistics", _library.pliant_data_get_statistics(self._data))
        return {name: told[name] for name in told.fields}

    @property
    def error(self):
        """How far a node still is from where the step would converge to, as it estimates it [m]."""
        return self.statistics["error"]

    @property
    def inverted(self):
        """Tetrahedra that are turned inside out."""
        return _library.pliant_data_get_inverted(self._data)

    @property
    def backend(self):
        return _library.pliant_data_get_backend(self._data).decode()

    def scalar(self, name):
        """(nodes) "von_mises", "strain_energy", ... as output/scalar names them."""
        names = options()["output/scalar"]["range"].split(" | ")
        if name not in names[1:]:
            raise ValueError("scalar %r: one of %s" % (name, ", ".join(names[1:])))
        out = np.zeros(self._body()["fine.num_nodes"], np.float32)
        _call("data_scalar", self.model._model, _library.pliant_data_get_body(self._data), _library.pliant_data_get_positions(self._data, None),
              names.index(name), out.ctypes.data)
        return out

    def volume(self):
        """The deformed scan, on the scan's own grid. Nothing is drawn until it is asked for, then only what has changed."""
        body = _library.pliant_data_get_body(self._data)
        model_scan = _library.pliant_model_get_drawn(self.model._model)
        kept = self._warp
        if not kept["warp"]:
            target, warp = _Struct("pliant_geometry"), _pointer()
            _call("warp_target", model_scan, None, 0, 0.0, 2 ** 62, target.address)
            threads = self.model._scene["solver.threads"] or os.cpu_count()
            _call("warp_create", model_scan, body + _layout["pliant_body"]["fine"][1], target.address, threads, ctypes.byref(warp))
            kept["warp"], kept["body"] = warp.value, _library.pliant_body_retain(body)
            _call("warp_set_body", warp, body)
        if kept["body"] != body:
            _call("warp_set_body", kept["warp"], body)
            _library.pliant_body_release(kept["body"])
            kept["body"] = _library.pliant_body_retain(body)
        _call("warp_update", kept["warp"], _library.pliant_data_get_positions(self._data, None))
        return Volume(_library.pliant_warp_volume(kept["warp"]))

    # PICTURES
    def _view(self):
        kept = self._warp
        if not kept["view"]:
            view = _pointer()
            _call("view_create", self.model._model, None, ctypes.byref(view))
            kept["view"] = view.value
        _call("view_set", kept["view"], _library.pliant_data_get_body(self._data), _library.pliant_data_get_positions(self._data, None), None)
        return kept["view"]

    def render(self, K, T, size=(640, 480), near=0.0, far=0.0, **style):
        """What a camera sees of the tissue as it is now.

        K: (3, 3) intrinsics [pixels]; T: (4, 4) from the camera's axes (x right, y down, z forward) to LPS [m], as look_at makes it; size: width,
        height; near, far: along z [m], tissue at near is cut there and shows the scan. style: threshold=HU, shown=[names of materials] (the
        surface of these alone), colours=[(value, r, g, b), ...], beneath, ambient, diffuse, specular, background."""
        camera, image = _camera(K, T, size, near, far), _Struct("pliant_image")
        picture, of = Picture(size[1], size[0]), _Struct("pliant_style")
        _call("style_defaults", _library.pliant_model_get_scan(self.model._model), of.address)
        if "shown" in style:
            names, wanted = self.model.materials, style.pop("shown")
            of["by_label"] = True
            of["shown"] = [int(0 < n <= len(names) and names[n - 1] in wanted) for n in range(256)]
        if "colours" in style:
            colours = np.asarray(style.pop("colours"), np.float64)
            of["num_colours"] = len(colours)
            of["colours"] = np.concatenate([colours.ravel(), np.zeros(64 - colours.size)])
        for name, value in style.items():
            of[name] = value
        image["rgb"], image["depth"], image["label"] = (array.ctypes.data for array in (picture.rgb, picture.depth, picture.label))
        _call("view_render", self._view(), camera.address, of.address, image.address)
        return picture

    def radiograph(self, isocentre, primary=0.0, secondary=0.0, size=(512, 512), pixel=0.001, source_to_isocentre=0.8, source_to_detector=1.2,
                   water=20.59):
        """(height, width) line integrals of attenuation, as a C-arm around a point [m] projects them; exp(-these) is what its detector measures.

        primary, secondary: DICOM's angles of the positioner (LAO, cranial) [rad]; pixel: edge of a detector's pixel [m]; water: attenuation of
        water [1/m], at 60 keV unless it is given."""
        arm, camera = _Struct("pliant_c_arm"), _Struct("pliant_camera")
        for name, value in (("isocentre", isocentre), ("source_to_isocentre", source_to_isocentre), ("source_to_detector", source_to_detector),
                            ("primary_angle", primary), ("secondary_angle", secondary), ("width", size[0]), ("height", size[1]), ("pixel", pixel)):
            arm[name] = value
        _call("c_arm_camera", arm.address, camera.address)
        out = np.zeros((size[1], size[0]), np.float32)
        _call("view_radiograph", self._view(), camera.address, water, out.ctypes.data)
        return out

    # CUTS (scenes with cut/kind)
    def cut(self, points, depth):
        """Cut at once along a line of points (n, 3), as deep as the vector depth goes [m], as the tissue lies now."""
        line, line_address = _numbers(points, len(points), 3)
        down, down_address = _numbers(depth, 3)
        report = _Struct("pliant_cut_report")
        _call("data_cut", self.model._model, self._data, len(line), line_address, down_address, report.address)
        return Cut(report)

    def undo_cut(self):
        _call("data_undo_cut", self.model._model, self._data)

    # TOOLS
    def tool(self, name="tool"):
        """The tool of this name, added if it is new."""
        if name not in self._tools:
            index = _int()
            _call("tool_add", self.model._model, self._data, name.encode(), ctypes.byref(index))
            self._tools[name] = Tool(self, index.value)
        return self._tools[name]

    def wrench(self, name="tool"):
        """(6) force [N] and torque about its tip [N m] of a tool on the tissue."""
        return self.tool(name).wrench


class Tool:
    """Of a simulation: it has a pose, takes hold, pulls, and cuts where it has a blade."""

    drives = ("spring", "rigid", "force")

    def __init__(self, sim, index):
        self._sim, self._index = sim, index

    def _get(self):
        told = _Struct("pliant_tool_state")
        _call("tool_get", self._sim._data, self._index, told.address)
        return told

    def move(self, tip, rotation=None):
        """Its tip [m], and its axes as a quaternion x y z w."""
        place, address = _numbers(tip, 3)
        axes, axes_address = _numbers((0, 0, 0, 1) if rotation is None else rotation, 4)
        _call("tool_set_pose", self._sim._data, self._index, address, axes_address)

    def grasp(self, point=None):
        """Take hold of the tissue at the tip, or of a rest point of the scan [m], where the tip then is if it had no pose."""
        place, address = (None, None) if point is None else _numbers(point, 3)
        if place is not None and not self._get()["present"]:
            self.move(place)
        _call("tool_grasp", self._sim.model._model, self._sim._data, self._index, address)

    def release(self):
        _library.pliant_tool_release(self._sim._data, self._index)

    def remove(self):
        """It is gone: it lets go, and has no pose."""
        _library.pliant_tool_lost(self._sim._data, self._index)

    def drive(self, kind, force=None):
        """Of the present hold, after grasp: spring: a damped spring to the tip; rigid: held at the tip; force: this force on the tissue [N]."""
        array, address = (None, None) if force is None else _numbers(force, 3)
        _call("tool_set_drive", self._sim._data, self._index, self.drives.index(kind), address)

    def spring(self, stiffness, damping=0.0):
        _call("tool_set_spring", self._sim._data, self._index, stiffness, damping)

    def radius(self, metres):
        """Of the blob that the next grasp takes [m]."""
        _call("tool_set_radius", self._sim._data, self._index, metres)

    def blade(self, name=None, ends=None):
        """scalpel, scissors or hook by its name, or an edge by its ends (2, 3) in the tool's frame [m]."""
        edge, address = _numbers(np.zeros((2, 3)) if ends is None else ends, 2, 3)
        if name is not None:
            _call("blade_find", name.encode(), address, address + 24)
        _call("tool_set_blade", self._sim._data, self._index, address, address + 24)

    def cutting(self, on=True):
        """Whether its blade cuts, from the next step on."""
        _call("tool_set_cutting", self._sim._data, self._index, on)

    @property
    def state(self):
        """By the names of pliant_tool_state."""
        told = self._get()
        return {name: told[name] for name in told.fields}

    @property
    def force(self):
        """(3) on the tissue, in the last step [N]."""
        return self._get()["force"]

    @property
    def wrench(self):
        """(6) force [N], and torque about the tip [N m]."""
        told = self._get()
        return np.concatenate([told["force"], np.cross(told["held_point"] - told["tip"], told["force"])])

    @property
    def holding(self):
        return self._get()["holding"]

    @property
    def clearance(self):
        """From the tip to the tissue's surface, negative inside [m]."""
        return _library.pliant_tool_clearance(self._sim.model._model, self._sim._data, self._index)
