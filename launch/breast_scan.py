#!/usr/bin/python3
"""Convert the DigiBreast mesh (Deng et al. 2015, public domain; github.com/OpenJData/DigiBreast) to a scan for
scenes/breast.yaml.

    launch/breast_scan.py DigiBreast_lzma.jdat breast.nii.gz [voxel size = 2 mm]

Values: percentage of glandular tissue, -1000 outside. The chest wall is at the back (LPS y grows towards it). The
mesh is a breast between plates, 30 mm thick. The program stretches it 2.5 times across the plates, at constant
volume, to approximate the shape without plates.
"""
import base64
import gzip
import json
import lzma
import struct
import sys

import numpy as np


def array(field):
    data = lzma.decompress(base64.b64decode(field['_ArrayZipData_']))
    kinds = {'double': '<f8', 'single': '<f4', 'uint32': '<u4', 'int32': '<i4'}
    return np.frombuffer(data, kinds[field['_ArrayType_']]).reshape(field['_ArraySize_'])


def voxelize(nodes, elements, values, low, size, voxel):
    """Interpolate the nodes' mean values at the voxel centres inside each tetrahedron, by barycentric coordinates."""
    out = np.full(size, -1000, np.float32)
    for corners in elements:
        p = nodes[corners]
        first = np.maximum(np.ceil((p.min(0) - low) / voxel), 0).astype(int)
        last = np.minimum(np.floor((p.max(0) - low) / voxel), np.array(size) - 1).astype(int)
        if (last < first).any():
            continue
        grid = np.stack(np.meshgrid(*[np.arange(a, b + 1) for a, b in zip(first, last)], indexing='ij'),
                        -1).reshape(-1, 3)
        weights = (low + voxel * grid - p[0]) @ np.linalg.inv(p[1:] - p[0])
        weights = np.c_[1 - weights.sum(1), weights]
        inside = (weights >= -1e-9).all(1)
        out[tuple(grid[inside].T)] = weights[inside] @ values[corners]
    return out


def write(path, volume, low, voxel):
    """Write NIfTI-1: int16, millimetres, RAS; low is the corner in LPS."""
    header = bytearray(352)
    struct.pack_into('<i', header, 0, 348)
    struct.pack_into('<8h', header, 40, 3, *volume.shape, 1, 1, 1, 1)
    struct.pack_into('<2h', header, 70, 4, 16)
    struct.pack_into('<8f', header, 76, 1, voxel, voxel, voxel, 0, 0, 0, 0)
    struct.pack_into('<3f', header, 108, 352, 1, 0)
    struct.pack_into('<B', header, 123, 2)
    struct.pack_into('<2h', header, 252, 0, 1)
    struct.pack_into('<12f', header, 280, -voxel, 0, 0, -low[0], 0, -voxel, 0, -low[1], 0, 0, voxel, low[2])
    header[344:348] = b'n+1\0'
    with gzip.open(path, 'wb', 6) as file:
        file.write(bytes(header) + np.round(volume).astype('<i2').tobytes(order='F'))


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    voxel = float(sys.argv[3]) if len(sys.argv) > 3 else 2.0
    with open(sys.argv[1]) as file:
        mesh = json.loads(file.read(), strict=False)['DigiBreast']['ForwardMesh']
    let_go = 2.5
    nodes = array(mesh['node']) * [let_go ** -0.5, -let_go ** -0.5, let_go]  # the nipple is anterior
    elements = array(mesh['elem']).astype(int) - 1
    values = 100 * array(mesh['glandularity']['truth'])[:, 0]
    nodes = nodes - 0.5 * (nodes.min(0) + nodes.max(0))
    low = nodes.min(0) - 2 * voxel
    size = tuple(np.ceil((nodes.max(0) - low) / voxel).astype(int) + 3)
    write(sys.argv[2], voxelize(nodes, elements, values, low, size, voxel), low, voxel)


main()
