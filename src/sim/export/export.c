/* Write meshes in file formats of other programs. */
#include "pliant/save.h"

#include "base/fail.h"
#include "base/vtk_file.h"
#include "fem/element/tensors.h"
#include "base/memory.h"
#include "topology/surface_points.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

/* A mesh and the file to write. */
typedef struct saved {
    const char *path;
    const pliant_model *model;
    const pliant_body *body;
    const double *positions, *contact_forces; /* the second Nullable */
    double unit;
    char comment[8192]; /* unit, axes, and the names of the materials */
} saved;

static void describe(saved *what)
{
    const pliant_material_table *table = &what->model->materials;
    const size_t capacity = sizeof what->comment;
    size_t at =
        (size_t)snprintf(what->comment, capacity,
                         "Pliant. Lengths: %s. Axes: LPS. Materials:", what->unit == 1 ? "metres" : "millimetres");
    for (uint32_t m = 0; m < table->num_materials && at < capacity; m++)
        at += (size_t)snprintf(what->comment + at, capacity - at, " %u %s%s", (unsigned)m, table->materials[m].name,
                               m + 1 < table->num_materials ? "," : ".");
    /* "--" is not allowed in an XML comment */
    for (char *two = what->comment; (two = strstr(two, "--"));) two[1] = ' ';
    for (char *byte = what->comment; *byte; byte++)
        if (*byte == '<' || *byte == '>' || *byte == '&') *byte = ' ';
}

/* --- .vtu --- */

/* Arrays for a file of the mesh. */
typedef struct mesh_arrays {
    double *place, *rest;      /* (nodes x 3) */
    float *displacement, *force; /* (nodes x 3) */
    int32_t (*hexahedron)[8];  /* (tetrahedra) pliant_tet_hexahedra */
    int32_t *connectivity, *offset; /* (4 to 8 per cell), (cells) */
    uint8_t *type;             /* (cells) of VTK */
    int32_t *fragment, *piece; /* (cells) */
    uint16_t *material;        /* (cells) */
    float *fraction, *von_mises; /* (cells) */
    float *stress, *strain;    /* (tetrahedra x 9), later (cells x 9) */
    size_t cells, corners;
} mesh_arrays;

static bool allocate(const pliant_mesh *mesh, mesh_arrays *out)
{
    const size_t nodes = (size_t)mesh->num_nodes, tets = (size_t)mesh->num_tets;
    return (out->place = pliant_calloc(nodes, 3 * sizeof *out->place)) &&
           (out->rest = pliant_calloc(nodes, 3 * sizeof *out->rest)) &&
           (out->displacement = pliant_calloc(nodes, 3 * sizeof *out->displacement)) &&
           (out->force = pliant_calloc(nodes, 3 * sizeof *out->force)) &&
           (out->hexahedron = pliant_calloc(tets, sizeof *out->hexahedron)) &&
           (out->connectivity = pliant_calloc(tets, 4 * sizeof *out->connectivity)) &&
           (out->offset = pliant_calloc(tets, sizeof *out->offset)) && (out->type = pliant_calloc(tets, 1)) &&
           (out->fragment = pliant_calloc(tets, sizeof *out->fragment)) &&
           (out->piece = pliant_calloc(tets, sizeof *out->piece)) &&
           (out->material = pliant_calloc(tets, sizeof *out->material)) &&
           (out->fraction = pliant_calloc(tets, sizeof *out->fraction)) &&
           (out->von_mises = pliant_calloc(tets, sizeof *out->von_mises)) &&
           (out->stress = pliant_calloc(tets, 9 * sizeof *out->stress)) &&
           (out->strain = pliant_calloc(tets, 9 * sizeof *out->strain));
}

static void free_arrays(mesh_arrays *arrays)
{
    PLIANT_FREE(arrays->place, arrays->rest, arrays->displacement, arrays->force, arrays->hexahedron,
                arrays->connectivity, arrays->offset, arrays->type, arrays->fragment, arrays->piece, arrays->material,
                arrays->fraction, arrays->von_mises, arrays->stress, arrays->strain);
}

static void fill_nodes(const saved *what, mesh_arrays *out)
{
    const pliant_mesh *mesh = &what->body->fine;
    for (size_t n = 0; n < 3 * (size_t)mesh->num_nodes; n++) {
        out->place[n] = what->positions[n] / what->unit;
        out->rest[n] = mesh->rest[n] / what->unit;
        out->displacement[n] = (float)((what->positions[n] - mesh->rest[n]) / what->unit);
        if (what->contact_forces) out->force[n] = (float)what->contact_forces[n];
    }
}

/* of_node: (nodes) buffer, zeroed */
static void find_pieces(const pliant_body *body, int32_t *of_node, int32_t *piece)
{
    const pliant_pieces *pieces = body->pieces;
    for (int32_t p = 0; pieces && p < pieces->count; p++)
        for (int32_t n = pieces->start[p]; n < pieces->start[p + 1]; n++) of_node[pieces->node[n]] = p + 1;
    for (int32_t t = 0; t < body->fine.num_tets; t++) piece[t] = of_node[body->fine.tets[4 * (size_t)t]];
}

/* Number the fragments of each tetrahedron at load from 0. count: (tetrahedra) buffer, zeroed */
static void find_fragments(const pliant_body *body, int32_t *count, int32_t *fragment)
{
    for (int32_t t = 0; body->tet_parent && t < body->fine.num_tets; t++) fragment[t] = count[body->tet_parent[t]]++;
}

static float von_mises(const float s[9])
{
    const double mean = ((double)s[0] + s[4] + s[8]) / 3, a = s[0] - mean, b = s[4] - mean, c = s[8] - mean;
    return (float)sqrt(1.5 *
                       (a * a + b * b + c * c + 2 * ((double)s[1] * s[1] + (double)s[2] * s[2] + (double)s[5] * s[5])));
}

/* Convert tetrahedra to cells. A hexahedron is one cell with the values of its first tetrahedron. */
static void fill_cells(const pliant_body *body, mesh_arrays *out)
{
    const uint8_t vtk_tetra = 10, vtk_hexahedron = 12;
    size_t cell = 0, corner = 0;
    for (int32_t t = 0; t < body->fine.num_tets; t++) {
        const int32_t *hexahedron = out->hexahedron[t];
        if (hexahedron[0] == PLIANT_IN_HEXAHEDRON) continue;
        const bool tet = hexahedron[0] == PLIANT_IS_TETRAHEDRON;
        memcpy(out->connectivity + corner, tet ? body->fine.tets + 4 * (size_t)t : hexahedron,
               (tet ? 4 : 8) * sizeof *hexahedron);
        corner += tet ? 4 : 8;
        out->offset[cell] = (int32_t)corner;
        out->type[cell] = tet ? vtk_tetra : vtk_hexahedron;
        out->fragment[cell] = out->fragment[t];
        out->piece[cell] = out->piece[t];
        out->material[cell] = body->fine_material[t].material;
        out->fraction[cell] = (float)body->fine_material[t].tissue;
        memmove(out->stress + 9 * cell, out->stress + 9 * (size_t)t, 9 * sizeof *out->stress);
        memmove(out->strain + 9 * cell, out->strain + 9 * (size_t)t, 9 * sizeof *out->strain);
        out->von_mises[cell] = von_mises(out->stress + 9 * cell);
        cell++;
    }
    out->cells = cell;
    out->corners = corner;
}

static pliant_status fill_arrays(const saved *what, mesh_arrays *out)
{
    const pliant_body *body = what->body;
    int32_t *count = pliant_calloc((size_t)body->fine.num_tets + (size_t)body->fine.num_nodes, sizeof *count);
    pliant_status status = count && allocate(&body->fine, out) ? PLIANT_OK : pliant_fail_memory("the file of the mesh");
    if (status == PLIANT_OK) status = pliant_tet_tensors(what->model, body, what->positions, out->stress, out->strain);
    if (status == PLIANT_OK) status = pliant_tet_hexahedra(what->model, body, out->hexahedron);
    if (status == PLIANT_OK) {
        fill_nodes(what, out);
        find_pieces(body, count + body->fine.num_tets, out->piece);
        find_fragments(body, count, out->fragment);
        fill_cells(body, out);
    }
    pliant_free(count);
    return status;
}

static pliant_status save_mesh(const saved *what)
{
    mesh_arrays a = {0};
    pliant_status status = fill_arrays(what, &a);
    const size_t nodes = (size_t)what->body->fine.num_nodes;
    const vtk_array arrays[] = {{VTK_POINTS, "Points", VTK_FLOAT64, 3, nodes, a.place},
                                {VTK_CELLS, "connectivity", VTK_INT32, 1, a.corners, a.connectivity},
                                {VTK_CELLS, "offsets", VTK_INT32, 1, a.cells, a.offset},
                                {VTK_CELLS, "types", VTK_UINT8, 1, a.cells, a.type},
                                {VTK_POINT_DATA, "rest_position", VTK_FLOAT64, 3, nodes, a.rest},
                                {VTK_POINT_DATA, "displacement", VTK_FLOAT32, 3, nodes, a.displacement},
                                {VTK_POINT_DATA, "fixed", VTK_UINT8, 1, nodes, what->body->fine_fixed},
                                {VTK_CELL_DATA, "material", VTK_UINT16, 1, a.cells, a.material},
                                {VTK_CELL_DATA, "material_fraction", VTK_FLOAT32, 1, a.cells, a.fraction},
                                {VTK_CELL_DATA, "fragment", VTK_INT32, 1, a.cells, a.fragment},
                                {VTK_CELL_DATA, "piece", VTK_INT32, 1, a.cells, a.piece},
                                {VTK_CELL_DATA, "stress", VTK_FLOAT32, 9, a.cells, a.stress},
                                {VTK_CELL_DATA, "von_mises", VTK_FLOAT32, 1, a.cells, a.von_mises},
                                {VTK_CELL_DATA, "strain", VTK_FLOAT32, 9, a.cells, a.strain},
                                /* last, because it may be missing */
                                {VTK_POINT_DATA, "contact_force", VTK_FLOAT32, 3, nodes, a.force}};
    const int num_arrays = (int)(sizeof arrays / sizeof *arrays) - !what->contact_forces;
    if (status == PLIANT_OK)
        status = pliant_vtk_write(what->path, false, what->comment, nodes, a.cells, arrays, num_arrays);
    free_arrays(&a);
    return status;
}

/* --- .vtp and .ply --- */

/* Arrays for a file of the surface. */
typedef struct surface_arrays {
    double *place, *rest;        /* (rows x 3) */
    float *displacement, *force; /* (rows x 3) */
    uint16_t *material;          /* (rows) */
    int32_t *corner, *offset;    /* (triangles x 3), (triangles) */
    uint8_t *cut;                /* (triangles) */
} surface_arrays;

static bool fill_surface(const saved *what, const pliant_surface *surface, const surface_points *points,
                         surface_arrays *out)
{
    const size_t rows = (size_t)points->num_rows, triangles = (size_t)surface->num_triangles;
    const bool good = (out->place = pliant_calloc(rows, 3 * sizeof *out->place)) &&
                      (out->rest = pliant_calloc(rows, 3 * sizeof *out->rest)) &&
                      (out->displacement = pliant_calloc(rows, 3 * sizeof *out->displacement)) &&
                      (out->force = pliant_calloc(rows, 3 * sizeof *out->force)) &&
                      (out->material = pliant_calloc(rows, sizeof *out->material)) &&
                      (out->corner = pliant_calloc(triangles, 3 * sizeof *out->corner)) &&
                      (out->offset = pliant_calloc(triangles, sizeof *out->offset)) &&
                      (out->cut = pliant_calloc(triangles, 1));
    for (size_t n = 0; good && n < points->count; n++) {
        if (points->row[n] < 0) continue;
        const size_t row = (size_t)points->row[n];
        out->material[row] = points->material[n];
        for (size_t d = 0; d < 3; d++) {
            const double place = points->at[3 * n + d], rest = points->rest[3 * n + d];
            out->place[3 * row + d] = place / what->unit;
            out->rest[3 * row + d] = rest / what->unit;
            out->displacement[3 * row + d] = (float)((place - rest) / what->unit);
            if (points->value) out->force[3 * row + d] = (float)points->value[3 * n + d];
        }
    }
    for (size_t t = 0; good && t < triangles; t++) {
        for (size_t v = 0; v < 3; v++) out->corner[3 * t + v] = points->row[surface->triangle[3 * t + v]];
        out->offset[t] = 3 * (int32_t)(t + 1);
        out->cut[t] = (int32_t)t >= surface->first_cut;
    }
    return good;
}

/* Copy contact forces to the surface's points, one component after the other. */
static pliant_status find_surface_points(const saved *what, const pliant_surface *surface, surface_points *out)
{
    const size_t nodes = (size_t)what->body->fine.num_nodes;
    float *force = what->contact_forces ? pliant_calloc(nodes, 3 * sizeof *force) : NULL;
    if (what->contact_forces && !force) return pliant_fail_memory("the file of the surface");
    for (size_t n = 0; force && n < nodes; n++)
        for (size_t d = 0; d < 3; d++) force[d * nodes + n] = (float)what->contact_forces[3 * n + d];
    pliant_status status = pliant_surface_points_find(surface, what->positions, force ? 3 : 0, force, out);
    pliant_free(force);
    return status;
}

static pliant_status save_surface(const saved *what, const pliant_surface *surface)
{
    surface_points points = {0};
    surface_arrays a = {0};
    pliant_status status = find_surface_points(what, surface, &points);
    if (status == PLIANT_OK && !fill_surface(what, surface, &points, &a))
        status = pliant_fail_memory("the file of the surface");
    const size_t rows = (size_t)points.num_rows, triangles = (size_t)surface->num_triangles;
    const vtk_array arrays[] = {{VTK_POINTS, "Points", VTK_FLOAT64, 3, rows, a.place},
                                {VTK_CELLS, "connectivity", VTK_INT32, 1, 3 * triangles, a.corner},
                                {VTK_CELLS, "offsets", VTK_INT32, 1, triangles, a.offset},
                                {VTK_POINT_DATA, "rest_position", VTK_FLOAT64, 3, rows, a.rest},
                                {VTK_POINT_DATA, "displacement", VTK_FLOAT32, 3, rows, a.displacement},
                                {VTK_POINT_DATA, "material", VTK_UINT16, 1, rows, a.material},
                                {VTK_CELL_DATA, "cut", VTK_UINT8, 1, triangles, a.cut},
                                /* last, because it may be missing */
                                {VTK_POINT_DATA, "contact_force", VTK_FLOAT32, 3, rows, a.force}};
    const int num_arrays = (int)(sizeof arrays / sizeof *arrays) - !what->contact_forces;
    if (status == PLIANT_OK)
        status = pliant_vtk_write(what->path, true, what->comment, rows, triangles, arrays, num_arrays);
    PLIANT_FREE(a.place, a.rest, a.displacement, a.force, a.material, a.corner, a.offset, a.cut);
    pliant_surface_points_free(&points);
    return status;
}

static bool ends_with(const char *path, const char *ending)
{
    const size_t length = strlen(path), size = strlen(ending);
    return length > size && strcasecmp(path + length - size, ending) == 0;
}

pliant_status pliant_mesh_save(const char *path, const pliant_model *model, const pliant_body *body,
                               const double *positions, const double *contact_forces, double unit)
{
    const bool mesh = ends_with(path, ".vtu"), vtp = ends_with(path, ".vtp"), ply = ends_with(path, ".ply");
    saved what = {path, model, body, positions, contact_forces, unit, ""};
    pliant_surface *surface = NULL;
    if (!(mesh || vtp || ply))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "%s: unknown ending of a mesh; use .vtu, .vtp or .ply", path);
    if (!(unit == 1 || unit == 1e-3))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "%s: its unit is %g m; use 1 (metres) or 1e-3 (millimetres)", path,
                           unit);
    describe(&what);
    if (mesh) return save_mesh(&what);
    pliant_status status = pliant_surface_create(body, NULL, &surface);
    if (status == PLIANT_OK)
        status =
            vtp ? save_surface(&what, surface) : pliant_surface_write(path, surface, positions, unit, 0, NULL, NULL);
    pliant_surface_free(surface);
    return status;
}
