"""Access libpliant.so by ctypes. The library reports the layout of its structs (src/sim/build/struct_layout.h)."""
import atexit
import ctypes
import logging
import os
import struct

import numpy as np


class Error(RuntimeError):
    """An error of the library; the message contains the remedy. status: pliant_status, below 0."""

    def __init__(self, status, message):
        super().__init__(message)
        self.status = status

    def __reduce__(self):
        return type(self), (self.status, str(self))


ARGUMENT = -1  # PLIANT_ERROR_ARGUMENT


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


library = _open_library()
_pointer, _int, _double, _text, _size = ctypes.c_void_p, ctypes.c_int, ctypes.c_double, ctypes.c_char_p, ctypes.c_size_t


class Progress(ctypes.Structure):
    function_type = ctypes.CFUNCTYPE(ctypes.c_bool, _double, _text, _pointer)
    _fields_ = [("function", _pointer), ("user", _pointer)]


class _Field(ctypes.Structure):
    _fields_ = [("of", _text), ("name", _text), ("kind", ctypes.c_char), ("offset", _size), ("count", _size)]


def declare(result, name, *arguments):
    function = getattr(library, "pliant_" + name)
    function.restype, function.argtypes = result, arguments
    return function


def call(name, *arguments):
    """Call a function that returns pliant_status. Return a positive status (done, with a limitation); raise Error
    for a negative one."""
    status = getattr(library, "pliant_" + name)(*arguments)
    if status < 0:
        raise Error(status, library.pliant_last_error().decode(errors="replace"))
    return status


for _result, _name, *_arguments in (
        (_text, "version"), (_text, "last_error"), (_pointer, "layout_fields", _pointer), (_size, "layout_size", _text),
        (None, "set_log", _pointer, _pointer),
        (None, "scene_defaults", _pointer), (_int, "scene_read", _text, _pointer),
        (_int, "scene_set", _pointer, _text, _text),
        (_int, "scene_check", _pointer), (_pointer, "scene_options", _pointer),
        (_int, "inputs_read", _pointer, _text, _pointer, _pointer, _pointer),
        (_int, "model_build", _pointer, _pointer, _pointer, _pointer, Progress, _pointer),
        (None, "model_free", _pointer),
        (_pointer, "model_get_scan", _pointer), (_pointer, "model_get_drawn", _pointer),
        (_pointer, "model_get_materials", _pointer), (_pointer, "model_get_scene", _pointer),
        (None, "material_table_free", _pointer), (None, "labels_free", _pointer), (None, "volume_free", _pointer),
        (_int, "data_create", _pointer, _pointer), (None, "data_free", _pointer),
        (_int, "data_reset", _pointer, _pointer),
        (_int, "data_copy", _pointer, _pointer, _pointer), (_int, "data_move", _pointer, _pointer, _pointer),
        (_int, "step", _pointer, _pointer), (_pointer, "data_get_body", _pointer),
        (_pointer, "data_get_positions", _pointer, _pointer),
        (_pointer, "data_get_statistics", _pointer), (_text, "data_get_backend", _pointer),
        (_text, "step_end_text", ctypes.c_int32), (None, "data_get_gravity", _pointer, _pointer),
        (_int, "data_set_gravity", _pointer, _pointer), (_int, "data_set_positions", _pointer, _pointer, _pointer),
        (_int, "data_set_limits", _pointer, _int, _double), (_int, "data_get_inverted", _pointer),
        (_int, "data_get_scalar", _pointer, _pointer, _int, _pointer),
        (ctypes.c_int32, "data_get_contacts", _pointer, ctypes.c_int32, _pointer),
        (_int, "data_cut", _pointer, _pointer, ctypes.c_int32, _pointer, _pointer, _pointer),
        (_int, "data_undo_cut", _pointer, _pointer),
        (_int, "tool_add", _pointer, _pointer, _text, _pointer), (_int, "tool_get", _pointer, _int, _pointer),
        (_int, "tool_set_pose", _pointer, _int, _pointer, _pointer),
        (_int, "tool_grasp", _pointer, _pointer, _int, _pointer),
        (None, "tool_release", _pointer, _int), (None, "tool_remove_pose", _pointer, _int),
        (_int, "tool_set_drive", _pointer, _int, _int, _pointer),
        (_int, "tool_set_spring", _pointer, _int, _double, _double), (_int, "tool_set_radius", _pointer, _int, _double),
        (_int, "tool_set_mass", _pointer, _int, _double), (_int, "blade_find", _text, _pointer, _pointer),
        (_int, "tool_set_blade", _pointer, _int, _pointer, _pointer),
        (_int, "tool_set_cutting", _pointer, _int, ctypes.c_bool),
        (_int, "tool_shape_find", _text, _pointer), (_int, "tool_shape_read", _text, _pointer),
        (None, "tool_shape_free", _pointer),
        (None, "tool_shape_move", _pointer, _pointer), (_int, "tool_set_shape", _pointer, _int, _pointer),
        (_int, "tool_set_jaw", _pointer, _int, _double),
        (None, "scene_for_shapes", _pointer), (_double, "tool_clearance", _pointer, _pointer, _int),
        (_int, "warp_target", _pointer, _pointer, ctypes.c_int32, _double, _size, _pointer),
        (_int, "warp_create", _pointer, _pointer, _pointer, _int, _pointer), (None, "warp_free", _pointer),
        (_int, "warp_set_body", _pointer, _pointer), (_int, "warp_update", _pointer, _pointer),
        (_pointer, "warp_volume", _pointer),
        (None, "camera_of_view", ctypes.c_int32, ctypes.c_int32, _double, _pointer),
        (_int, "camera_look_at", _pointer, _pointer, _pointer, _pointer),
        (_int, "c_arm_camera", _pointer, _pointer), (_int, "style_defaults", _pointer, _pointer),
        (_int, "view_create", _pointer, _pointer, _pointer), (None, "view_free", _pointer),
        (_int, "view_set", _pointer, _pointer, _pointer, _pointer),
        (_int, "view_render", _pointer, _pointer, _pointer, _pointer),
        (_int, "view_radiograph", _pointer, _pointer, _double, _pointer),
        (_int, "volume_write", _text, _pointer),
        (_int, "mesh_save", _text, _pointer, _pointer, _pointer, _pointer, _double),
        (None, "data_get_contact_forces", _pointer, _pointer),
        (_int, "displacement_create", _pointer, _pointer, _pointer, _int, _pointer, _pointer),
        (_int, "displacement_write", _text, _pointer), (None, "displacement_free", _pointer),
        (_pointer, "body_retain", _pointer), (None, "body_release", _pointer)):
    declare(_result, _name, *_arguments)


def _read_layout():
    count = _size()
    fields = ctypes.cast(library.pliant_layout_fields(ctypes.byref(count)), ctypes.POINTER(_Field))
    layout = {}
    for field in fields[:count.value]:
        layout.setdefault(field.of.decode(), {})[field.name.decode()] = (field.kind.decode(), field.offset, field.count)
    return layout


layout = _read_layout()
_dtypes = {"d": np.float64, "f": np.float32, "i": np.int32, "h": np.int16, "B": np.uint8}


class Struct:
    """A struct of the library: allocated here, or at a given address while that is valid."""

    def __init__(self, of, address=None):
        self.fields, self.size = layout.get(of, {}), library.pliant_layout_size(of.encode())
        self.buffer = ctypes.create_string_buffer(self.size) if address is None else None
        self.address = address if address is not None else ctypes.addressof(self.buffer)

    def __getitem__(self, name):
        kind, offset, count = self.fields[name]
        if kind == "s":
            return ctypes.string_at(self.address + offset).decode(errors="replace")
        values = struct.unpack("@%d%s" % (count, kind),
                               ctypes.string_at(self.address + offset, count * struct.calcsize("@" + kind)))
        return values[0] if count == 1 else np.array(values)

    def __setitem__(self, name, value):
        kind, offset, count = self.fields[name]
        values = np.ravel(value).tolist()
        if len(values) != count:
            raise ValueError("%s: expected %d numbers, not %d" % (name, count, len(values)))
        ctypes.memmove(self.address + offset, struct.pack("@%d%s" % (count, kind), *values),
                       count * struct.calcsize("@" + kind))


def array(address, kind, *shape):
    """Copy an array of the library."""
    dtype = np.dtype(_dtypes[kind])
    if not address or 0 in shape:
        return np.zeros(shape, dtype)
    return np.frombuffer(ctypes.string_at(address, dtype.itemsize * int(np.prod(shape))), dtype).reshape(shape).copy()


def records(of, count):
    """Allocate structs of the library as a numpy array whose fields have their names."""
    fields = layout[of]
    kinds = {"d": "f8", "i": "i4", "?": "?"}
    return np.zeros(count,
                    {"names": list(fields),
                     "formats": [(kinds[kind], (n,)) if n > 1 else kinds[kind] for kind, _, n in fields.values()],
                     "offsets": [offset for _, offset, _ in fields.values()],
                     "itemsize": library.pliant_layout_size(of.encode())})


def numbers(values, *shape):
    """Convert numbers for the library, and return them with their address."""
    out = np.ascontiguousarray(values, np.float64)
    if out.shape != shape:
        raise ValueError("expected numbers of shape %s, not %s" % (shape, out.shape))
    return out, out.ctypes.data


_levels = (logging.DEBUG, logging.INFO, logging.WARNING, logging.ERROR)
_log_type = ctypes.CFUNCTYPE(None, _int, _text, _pointer)
_log = _log_type(lambda level, message, user: logging.getLogger("pliant").log(
    _levels[level], message.decode(errors="replace")))
# the library keeps this pointer, so the callback must stay alive
library.pliant_set_log(ctypes.cast(_log, _pointer), None)
atexit.register(library.pliant_set_log, None, None)  # no logging into an interpreter that has exited
