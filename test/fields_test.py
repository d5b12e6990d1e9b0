#!/usr/bin/env python3
"""Read the displacement fields and meshes of pliant_deform with other programs: SimpleITK, meshio and VTK. One test
goes from a segmentation of 3D Slicer to the resampled scan.

    fields_test.py PLIANT_DEFORM PLIANT_PHANTOM

Exit code 77 (skipped) without SimpleITK, meshio or numpy: pip install SimpleITK meshio. The test of .vtp also needs
vtk."""
import gzip
import pathlib
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree

try:
    import meshio
    import numpy as np
    import SimpleITK as sitk
except ImportError as missing:
    print("skipped: %s; pip install SimpleITK meshio" % missing)
    sys.exit(77)
try:
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy
except ImportError:
    vtk = None

DEFORM, PHANTOM = sys.argv[1], sys.argv[2]
SOURCE = pathlib.Path(__file__).resolve().parent.parent
NO_TISSUE, TISSUE, CUT = 0, 1, 2
SIZE = "96x70x72"

# Pull the front of the liver by 2 cm. A blade cuts the belly near it.
PULL = """
tools:
  - {name: grasper, drive: rigid, grasp: [-0.054, -0.063, 0.063],
     motion: [{time: 0.0, offset: [0, 0, 0]}, {time: 0.3, offset: [0, -0.02, 0]}]}
"""
CUT_TOO = """  - name: knife
    blade: {from: [0, 0, -0.08], to: [0, 0, 0.08]}
    poses:
      - {time: 0.0, position: [-0.06, -0.14, 0.02], rotation: [0, 0, 0, 1]}
      - {time: 0.2, position: [-0.06, -0.06, 0.02], rotation: [0, 0, 0, 1]}
      - {time: 0.3, position: [-0.06, -0.16, 0.02], rotation: [0, 0, 0, 1]}
    cut: [{from: 0.0, to: 0.2}]
"""
SCENE = """
mesh: {coarse_cells: [18, 14, 16], ratio: 1}
model: {method: fine, gravity: [-9.81, 0, 0]}
cut: {kind: %s}
element: {kind: %s}
"""


def read(path):
    image = sitk.ReadImage(str(path))
    return image, sitk.GetArrayFromImage(image)


def write_segmentation(path, like, layers):
    """Write a .seg.nrrd as 3D Slicer does: a list of layers, each a list of (name, mask), cropped to the box of all
    masks."""
    held = np.argwhere(np.any([mask for layer in layers for _, mask in layer], axis=0))
    low, high = held.min(axis=0), held.max(axis=0) + 1
    box = tuple(slice(*ends) for ends in zip(low, high))
    voxels = np.zeros(tuple(high - low) + (len(layers),), np.uint8)
    axes = np.array(like.GetDirection()).reshape(3, 3) * like.GetSpacing()
    vectors = ["(%s)" % ",".join("%.17g" % value for value in axes[:, d]) for d in range(3)]
    header = ["NRRD0004", "type: unsigned char", "dimension: 4", "space: left-posterior-superior",
              "sizes: %d %s" % (len(layers), " ".join(str(size) for size in (high - low)[::-1])),
              "space directions: none " + " ".join(vectors), "kinds: list domain domain domain", "encoding: gzip",
              "space origin: (%s)" % ",".join("%.17g" % value
                                              for value in like.TransformIndexToPhysicalPoint(
                                                  [int(n) for n in low[::-1]])),
              "Segmentation_MasterRepresentation:=Binary labelmap",
              "Segmentation_ReferenceImageExtentOffset:=" + " ".join(str(n) for n in low[::-1])]
    number = 0
    for layer, segments in enumerate(layers):
        for value, (name, mask) in enumerate(segments, 1):
            voxels[..., layer][mask[box]] = value
            entries = {"ID": "Segment_%d" % (number + 1), "LabelValue": value, "Layer": layer, "Name": name,
                       "Color": "0.5 0.5 0.5"}
            header += ["Segment%d_%s:=%s" % (number, key, entry) for key, entry in entries.items()]
            number += 1
    path.write_bytes(("\n".join(header) + "\n\n").encode() + gzip.compress(voxels.tobytes()))


def resample(scan, field, like):
    """Resample the scan through a displacement field with ITK."""
    transform = sitk.DisplacementFieldTransform(sitk.Cast(field, sitk.sitkVectorFloat64))
    return sitk.GetArrayFromImage(sitk.Resample(sitk.Cast(scan, sitk.sitkFloat64), like, transform, sitk.sitkLinear,
                                                -1000.0, sitk.sitkFloat64))


def change_per_voxel(values):
    """Return the sum over the axes of the largest difference to a neighbour."""
    change = np.zeros(values.shape)
    for axis in range(3):
        step = np.abs(np.diff(values, axis=axis))
        ends = np.concatenate([np.zeros_like(np.take(step, [0], axis)), step, np.zeros_like(np.take(step, [0], axis))],
                              axis)
        count = values.shape[axis]
        change += np.maximum(np.take(ends, range(count), axis), np.take(ends, range(1, count + 1), axis))
    return change


def volume_of(points, cells):
    """Return the volume of tetrahedra, and of hexahedra as five tetrahedra each."""
    parts = {"tetra": [(0, 1, 2, 3)], "hexahedron": [(0, 1, 3, 4), (1, 2, 3, 6), (1, 4, 5, 6), (3, 4, 6, 7),
                                                     (1, 3, 4, 6)]}
    total = 0.0
    for block in cells:
        for part in parts[block.type]:
            x = points[block.data[:, part]]
            total += np.linalg.det(x[:, 1:] - x[:, :1]).sum() / 6
    return total


class Fields(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.room = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.room.name)
        (cls.folder / "none.yaml").write_text(PULL)
        for kind in ("sever", "subdivide"):
            (cls.folder / (kind + ".yaml")).write_text(PULL + CUT_TOO)
        subprocess.run([PHANTOM, "--size", SIZE, "--out", str(cls.folder / "phantom.nii.gz")], check=True,
                       stdout=subprocess.DEVNULL)
        cls.scan, cls.scan_values = read(cls.folder / "phantom.nii.gz")

    @classmethod
    def tearDownClass(cls):
        cls.room.cleanup()

    def deform(self, name, *arguments, cut="sever", element="linear", more=""):
        scene = self.folder / (name + ".yaml")
        scene.write_text(SCENE % (cut, element) + more)
        out = self.folder / name
        run = subprocess.run([DEFORM, str(scene), "--scan", str(self.folder / "phantom.nii.gz"), "--tools",
                              str(self.folder / (cut + ".yaml")),
                              "--steps", "20", "--out", str(out), *arguments],
                             stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, universal_newlines=True)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.log = run.stderr
        return out

    def check_resampling(self, out):
        deformed, wanted = read(out / "deformed.nii.gz")
        field, vectors = read(out / "u.nii.gz")
        _, mask = read(out / "u_mask.nii.gz")
        self.assertEqual(field.GetNumberOfComponentsPerPixel(), 3)
        np.testing.assert_allclose(field.GetOrigin(), deformed.GetOrigin(), atol=1e-3)
        np.testing.assert_allclose(field.GetSpacing(), deformed.GetSpacing(), rtol=1e-6)
        self.assertEqual(field.GetSize(), deformed.GetSize())
        found = resample(self.scan, field, deformed)
        inside = mask == TISSUE
        self.assertGreater(inside.sum(), 0.9 * (mask != NO_TISSUE).sum())
        self.assertGreater((np.linalg.norm(vectors[inside], axis=1) > 5).sum(), 1000,
                           "the pull moves more than a thousand voxels by 5 mm")
        # A tenth of a voxel, and rounding to whole Hounsfield units.
        allowed = 0.1 * change_per_voxel(found) + 1
        worst = np.abs(found - wanted)[inside] / allowed[inside]
        self.assertLessEqual(worst.max(), 1)
        self.assertEqual(np.ptp(wanted[mask == NO_TISSUE]), 0, "where there is no tissue, the deformed volume has one "
                         "value")
        return mask

    def test_itk_resamples_the_scan_into_the_deformed_volume(self):
        out = self.deform("whole", "--displacement", "u.nii.gz", cut="none")
        mask = self.check_resampling(out)
        self.assertFalse((mask == CUT).any())

    def test_a_mask_tells_where_a_cut_is(self):
        for kind in ("sever", "subdivide"):
            with self.subTest(kind):
                out = self.deform("cut_" + kind, "--displacement", "u.nii.gz", cut=kind)
                mask = self.check_resampling(out)
                self.assertGreater((mask == CUT).sum(), 300)
                self.assertLess((mask == CUT).sum(), 0.08 * (mask == TISSUE).sum())

    def test_the_whole_way_from_a_slicer_segmentation(self):
        """Three layers name the materials, a tool pulls the liver, and a blade cuts. ITK and meshio read the
        results."""
        scan = self.folder / "phantom.nii.gz"
        subprocess.run([PHANTOM, "--size", SIZE, "--out", str(scan), "--labels", str(self.folder / "labels.nii.gz")],
                       check=True,
                       stdout=subprocess.DEVNULL)
        labels = read(self.folder / "labels.nii.gz")[1]
        inner = np.zeros(labels.shape, bool)
        inner[4:-3, 3:-3, 2:-3] = True
        labels *= inner
        layers = [[("Liver", np.isin(labels, (4, 5))), ("spleen", labels == 8)],
                  [("TUMOUR", labels == 5), (" Vessel", np.isin(labels, (9, 10)))],
                  [("bone", np.isin(labels, (11, 12, 13))), ("kidney", np.isin(labels, (6, 7)))]]
        write_segmentation(self.folder / "a.seg.nrrd", self.scan, layers)
        out = self.deform("way", "--labels", str(self.folder / "a.seg.nrrd"), "--displacement", "u.nii.gz", "--vtk",
                          more="material: {file: %s}\n" % (SOURCE / "launch/materials/phantom.yaml"))

        self.assertRegex(self.log, r"its voxel \(0, 0, 0\) is voxel \([1-9]\d*, [1-9]\d*, [1-9]\d*\) of the scan")
        self.assertIn("the later one wins in %d voxels: TUMOUR over Liver" % (labels == 5).sum(), self.log)
        for material, segment, voxels in (("liver", "Liver", labels == 4), ("tumour", "TUMOUR", labels == 5),
                                          ("spleen", "spleen", labels == 8),
                                          ("vessel", "Vessel", np.isin(labels, (9, 10))),
                                          ("bone", "bone", np.isin(labels, (11, 12, 13))),
                                          ("kidney", "kidney", np.isin(labels, (6, 7)))):
            self.assertRegex(self.log, r'material %s: .*segment "%s" %d\b' % (material, segment, voxels.sum()))

        mask = self.check_resampling(out)
        self.assertGreater((mask == CUT).sum(), 300)

        mesh = meshio.read(out / "mesh.vtu")
        nodes = np.loadtxt(out / "nodes.csv", delimiter=",", skiprows=1)
        tets = np.loadtxt(out / "elements.csv", delimiter=",", skiprows=1, usecols=range(4), dtype=int)
        np.testing.assert_allclose(mesh.points, nodes[:, 3:6], atol=1e-8)
        for points, wanted in ((mesh.point_data["rest_position"], nodes[:, :3]), (mesh.points, nodes[:, 3:6])):
            x = wanted[tets]
            self.assertAlmostEqual(volume_of(points, mesh.cells) / (np.linalg.det(x[:, 1:] - x[:, :1]).sum() / 6), 1, 6)

    def test_nrrd_and_metaimage_hold_the_same(self):
        fields = []
        for ending in ("nii.gz", "nrrd", "mha"):
            out = self.deform("format_" + ending[:3], "--displacement", "u." + ending, cut="none")
            fields.append(read(out / ("u." + ending)))
            self.assertTrue((out / ("u_mask." + ending)).exists())
        for image, vectors in fields[1:]:
            np.testing.assert_array_equal(vectors, fields[0][1])
            np.testing.assert_allclose(image.GetOrigin(), fields[0][0].GetOrigin(), atol=1e-3)

    def test_the_two_senses_are_inverse_to_each_other(self):
        out = self.deform("senses", "--displacement", "u.nrrd", "--tissue-displacement", "v.nrrd")
        back, _ = read(out / "u.nrrd")
        forth, vectors = read(out / "v.nrrd")
        _, mask = read(out / "v_mask.nrrd")
        self.assertEqual(forth.GetSize(), self.scan.GetSize())
        self.assertTrue((mask == CUT).any())
        transform = sitk.DisplacementFieldTransform(sitk.Cast(back, sitk.sitkVectorFloat64))
        moved = np.linalg.norm(vectors, axis=-1) > 2
        apart = []
        for k, j, i in np.argwhere((mask == TISSUE) & moved)[::37]:
            at = np.array(self.scan.TransformIndexToPhysicalPoint((int(i), int(j), int(k))))
            apart.append(np.linalg.norm(np.array(transform.TransformPoint((at + vectors[k, j, i]).tolist())) - at))
        self.assertGreater(len(apart), 100)
        self.assertLess(np.percentile(apart, 95), 0.1 * min(self.scan.GetSpacing()))

    def test_meshio_reads_the_mesh(self):
        for element, kind in (("linear", "tetra"), ("hexahedra", "hexahedron")):
            with self.subTest(element):
                out = self.deform("mesh_" + element, "--vtk", "--no-volume", element=element)
                mesh = meshio.read(out / "mesh.vtu")
                nodes = np.loadtxt(out / "nodes.csv", delimiter=",", skiprows=1)
                tets = np.loadtxt(out / "elements.csv", delimiter=",", skiprows=1, usecols=range(4), dtype=int)
                np.testing.assert_allclose(mesh.points, nodes[:, 3:6], atol=1e-8)
                np.testing.assert_allclose(mesh.point_data["rest_position"], nodes[:, :3], atol=1e-8)
                np.testing.assert_allclose(mesh.point_data["displacement"], nodes[:, 3:6] - nodes[:, :3], atol=1e-7)
                rest = nodes[tets, :3]
                wanted = np.linalg.det(rest[:, 1:] - rest[:, :1]).sum() / 6
                self.assertAlmostEqual(volume_of(nodes[:, :3], mesh.cells) / wanted, 1, 6)
                self.assertIn(kind, [block.type for block in mesh.cells])
                for name, size in (("stress", 9), ("strain", 9)):
                    self.assertEqual({data.shape[1] for data in mesh.cell_data[name]}, {size})
                for name in ("material", "fragment", "piece", "von_mises", "material_fraction"):
                    self.assertEqual([len(data) for data in mesh.cell_data[name]],
                                     [len(block.data) for block in mesh.cells])
                self.assertGreater(max(data.max() for data in mesh.cell_data["fragment"]), 0)
                self.assertGreater(mesh.point_data["fixed"].sum(), 0)

    def test_meshes_come_back_through_meshio(self):
        out = self.deform("given", "--vtk", "--no-volume", cut="none")
        given = meshio.read(out / "mesh.vtu")
        names = np.loadtxt(out / "elements.csv", delimiter=",", skiprows=1, usecols=4, dtype=str)
        numbers = {name: 1 + n for n, name in enumerate(sorted(set(names)))}
        region = np.array([numbers[name] for name in names], np.int32)
        rest, tets = given.point_data["rest_position"], given.cells_dict["tetra"]
        gmsh = meshio.Mesh(1000 * rest, [("tetra", tets)], field_data={"Soft Tissue": np.array([1, 3])},
                           cell_data={key: [np.ones(len(tets), np.int32)]
                                      for key in ("gmsh:physical", "gmsh:geometrical")})
        material = meshio.Mesh(1000 * rest, [("tetra", tets)], cell_data={"material": [given.cell_data["material"][0]]})
        files = {"text.msh": lambda path: meshio.write(path, gmsh, file_format="gmsh", binary=False),
                 "binary.msh": lambda path: meshio.write(path, gmsh, file_format="gmsh", binary=True),
                 "zlib.vtu": lambda path: meshio.vtu.write(path, material, compression="zlib"),
                 "plain.vtu": lambda path: meshio.vtu.write(path, material, compression=None)}
        centres = rest[tets].mean(axis=1)
        for name, write in files.items():
            with self.subTest(name):
                write(self.folder / name)
                made = self.deform("made_" + name, "--vtk", "--no-volume", "--set",
                                   "mesh/file=%s" % (self.folder / name), "--set", "mesh/unit=0.001", "--set",
                                   "mesh/keep_air=true", cut="none", more="fixed: {boxes: [{low: [-1, -1, -1], high: "
                                   "[1, 1, -0.14]}]}\n")
                mesh = meshio.read(made / "mesh.vtu")
                found = np.loadtxt(made / "elements.csv", delimiter=",", skiprows=1, usecols=4, dtype=str)
                soft = name.endswith("msh")  # the .msh file has one region only
                wanted = np.column_stack([centres, np.full(len(tets), numbers["soft_tissue"]) if soft else region])
                made_centres = mesh.point_data["rest_position"][mesh.cells_dict["tetra"]].mean(axis=1)
                rows = np.column_stack([made_centres, [numbers[one] for one in found]])
                self.assertEqual(*(sorted(map(tuple, np.round(of, 6).tolist())) for of in (rows, wanted)))
                self.assertGreater(np.linalg.norm(mesh.point_data["displacement"], axis=1).max(), 0.005)

    def test_stress_is_that_of_the_tables(self):
        out = self.deform("stress", "--vtk", "--no-volume", "--scalars", "von_mises,principal_stress", cut="none")
        mesh = meshio.read(out / "mesh.vtu")
        table = np.genfromtxt(out / "elements.csv", delimiter=",", names=True,
                              usecols=("von_mises_pa", "principal_stress_pa"))
        stress = mesh.cell_data["stress"][0].reshape(-1, 3, 3)
        np.testing.assert_allclose(mesh.cell_data["von_mises"][0], table["von_mises_pa"], rtol=1e-3, atol=0.1)
        largest = np.linalg.eigvalsh(stress)[:, 2]
        scale = np.abs(stress).max(axis=(1, 2))
        self.assertLess((np.abs(largest - table["principal_stress_pa"]) / (scale + 0.1)).max(), 1e-3)
        deformation = 2 * mesh.cell_data["strain"][0].reshape(-1, 3, 3) + np.eye(3)  # F'F
        ratio = np.sqrt(np.linalg.det(deformation))
        points, tets = mesh.points, mesh.cells[0].data
        now, rest = points[tets], mesh.point_data["rest_position"][tets]
        wanted = np.linalg.det(now[:, 1:] - now[:, :1]) / np.linalg.det(rest[:, 1:] - rest[:, :1])
        np.testing.assert_allclose(ratio, np.abs(wanted), rtol=1e-4)

    def test_a_series_of_steps_in_millimetres(self):
        out = self.deform("series", "--vtk", "--no-volume", "--every", "10", "--unit", "mm")
        for name, ending in (("mesh", "vtu"), ("surface", "vtp")):
            listed = xml.etree.ElementTree.parse(out / (name + ".pvd")).findall(".//DataSet")
            self.assertEqual([entry.get("file") for entry in listed],
                             ["%s_0000%d.%s" % (name, step, ending) for step in (10, 20)])
            self.assertAlmostEqual(float(listed[1].get("timestep")), 2 * float(listed[0].get("timestep")))
            for entry in listed:
                self.assertTrue((out / entry.get("file")).exists())
        nodes = np.loadtxt(out / "nodes.csv", delimiter=",", skiprows=1)
        np.testing.assert_allclose(meshio.read(out / "mesh.vtu").points, 1000 * nodes[:, 3:6], atol=1e-5)
        ply = meshio.read(out / "surface.ply")
        self.assertGreater(np.ptp(ply.points[:, 0]), 300)

    @unittest.skipIf(vtk is None, "vtk is missing: pip install vtk")
    def test_vtk_reads_the_surface(self):
        out = self.deform("surface", "--vtk", "--no-volume")
        reader = vtk.vtkXMLPolyDataReader()
        reader.SetFileName(str(out / "surface.vtp"))
        reader.Update()
        surface, ply = reader.GetOutput(), meshio.read(out / "surface.ply")
        np.testing.assert_allclose(vtk_to_numpy(surface.GetPoints().GetData()), ply.points, atol=1e-7)
        cut = vtk_to_numpy(surface.GetCellData().GetArray("cut"))
        self.assertGreater(cut.sum(), 50)
        triangles = vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).reshape(-1, 3)
        np.testing.assert_array_equal(triangles, ply.cells_dict["triangle"])
        edges = vtk.vtkFeatureEdges()  # the surface has boundary edges at cuts only
        edges.SetInputData(surface)
        edges.FeatureEdgesOff()
        edges.ManifoldEdgesOff()
        edges.NonManifoldEdgesOff()
        edges.Update()
        self.assertEqual(edges.GetOutput().GetNumberOfCells(), 0)
        grid = vtk.vtkXMLUnstructuredGridReader()
        grid.SetFileName(str(out / "mesh.vtu"))
        grid.Update()
        mesh = meshio.read(out / "mesh.vtu")
        self.assertEqual(grid.GetOutput().GetNumberOfCells(), sum(len(block.data) for block in mesh.cells))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[3:], verbosity=2)
