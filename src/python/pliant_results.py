"""Results of a simulation, and its cameras. Arrays are copies."""
import operator
import os
import typing
import weakref

import numpy as np

if __package__:  # installed in the same package as the ROS messages
    from . import pliant_library as _c
else:
    import pliant_library as _c


class Volume:
    """A copy of a volume. values[k, j, i] are stored values; voxel (i, j, k) lies at origin + direction @ (spacing *
    (i, j, k))."""

    def __init__(self, values, origin, spacing, direction, slope=1.0, intercept=0.0, background=0.0):
        self.values, self.origin, self.spacing, self.direction = values, origin, spacing, direction
        self.slope, self.intercept, self.background = slope, intercept, background

    @property
    def intensities(self):
        """Values with slope and intercept applied; Hounsfield units for CT."""
        return self.slope * self.values.astype(np.float32) + self.intercept


def volume_at(address):
    record = _c.Struct("pliant_volume", address)
    values = _c.array(record["voxels"], {1: "B", 2: "h", 3: "f"}[record["encoding"]],
                      *(int(n) for n in record["geometry.size"][::-1]))
    direction = record["geometry.direction"].reshape(3, 3)
    return Volume(values, record["geometry.origin"], record["geometry.spacing"], direction, record["slope"],
                  record["intercept"], record["background"])


class Displacement:
    """A copy of a displacement field. vectors[k, j, i] LPS [m] belongs to voxel (i, j, k), whose position is as in
    Volume. mask[k, j, i]: 0 no tissue (the vector of the nearest tissue is used), 1 tissue, 2 near a cut, where
    interpolation mixes both sides of the cut."""

    def __init__(self, field):
        self._field = field
        size = [int(n) for n in field["geometry.size"][::-1]]
        self.vectors, self.mask = _c.array(field["vectors"], "f", *size, 3), _c.array(field["mask"], "B", *size)
        self.origin, self.spacing = field["geometry.origin"], field["geometry.spacing"]
        self.direction = field["geometry.direction"].reshape(3, 3)
        weakref.finalize(self, _free_displacement, field)

    def save(self, path):
        """Write the field [mm] in the format of ITK and 3D Slicer (.nii.gz, .nii, .nrrd, .mha), and the mask to the
        same name with _mask."""
        _c.call("displacement_write", os.fsencode(path), self._field.address)


def _free_displacement(field):
    _c.library.pliant_displacement_free(field.address)


class Cut:
    """Result of a cut: area at rest [m^2], number of links between voxels, number of tissue pieces after the cut."""

    def __init__(self, report):
        self.area, self.links, self.touched, self.pieces = (report["area"], report["num_links"], report["touched"],
                                                            report["pieces"])


class Contacts:
    """Contact points, one entry of each array per point (n):
    points (n, 3) LPS [m]; normals (n, 3) unit vectors into the tissue; forces (n, 3) on the tissue [N];
    areas (n) at rest [m^2], 0 for points that only keep triangle corners out of a proxy's core;
    depths (n) penetration depth, negative after a separation [m];
    tools (n) index, -1: no tool; parts (n) part of the tool's shape; tissue (n) True for contact between tissue and
    tissue."""

    def __init__(self, record):
        self._record = record
        self.points, self.normals, self.forces, self.areas, self.depths, self.tools, self.parts, self.tissue = (
            record[name].copy() for name in ("place", "normal", "force", "area", "depth", "tool", "part", "tissue"))

    def __len__(self):
        return len(self._record)

    def of(self, tool):
        """Contacts of one tool, by its index."""
        return Contacts(self._record[self.tools == tool])


class Proxy(typing.NamedTuple):
    """Pose of a simulated tool: tip (3) [m], rotation quaternion x y z w, jaw [rad]."""
    tip: np.ndarray
    rotation: np.ndarray
    jaw: float


class Picture:
    """A camera image: rgb (height, width, 3) uint8; depth along z [m], NaN without tissue; label (height, width): 1
    + index in Model.materials, 0 without tissue."""

    def __init__(self, height, width):
        self.rgb, self.depth = np.zeros((height, width, 3), np.uint8), np.zeros((height, width), np.float32)
        self.label = np.zeros((height, width), np.uint8)


def look_at(point, at, up=(0, 0, 1)):
    """Return the pose T of a camera at a point that looks at another point [m]; up: direction that is up in its
    image."""
    camera = _c.Struct("pliant_camera")
    numbers = [_c.numbers(v, 3) for v in (point, at, up)]
    _c.call("camera_look_at", camera.address, *(address for _, address in numbers))
    return np.vstack([camera["pose"].reshape(3, 4), (0, 0, 0, 1)])


def whole(size):
    """Check the width and height of a picture [pixels]."""
    width, height = (operator.index(n) for n in size)
    if not (0 < width <= 16384 and 0 < height <= 16384):
        raise ValueError("size %s: expected a width and a height of 1 to 16384 pixels" % (size,))
    return width, height


def camera_of(K, T, size, near, far):
    camera = _c.Struct("pliant_camera")
    K, T = np.asarray(K, np.float64), np.asarray(T, np.float64)
    if K.shape != (3, 3) or T.shape not in ((3, 4), (4, 4)):
        raise ValueError("expected K of shape (3, 3) and T of (4, 4), not %s and %s" % (K.shape, T.shape))
    camera["width"], camera["height"] = size
    for name, value in (("fx", K[0, 0]), ("fy", K[1, 1]), ("cx", K[0, 2]), ("cy", K[1, 2]), ("pose", T[:3]),
                        ("near", near), ("far", far)):
        camera[name] = value
    return camera
