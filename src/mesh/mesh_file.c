/* Reads a tetrahedral mesh and builds the fine mesh from it. */
#include "mesh/mesh_file.h"

#include "base/fail.h"
#include "base/open.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <errno.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

static const size_t max_file_size = (size_t)1 << 32;

void pliant_mesh_file_free(mesh_file *file)
{
    if (!file) return;
    PLIANT_FREE(file->nodes, file->tets, file->region, file->name);
    memset(file, 0, sizeof *file);
}

static pliant_status read_text(const char *path, file_text *out)
{
    pliant_opening opening;
    FILE *file = pliant_opening_begin(path, &opening) ? fopen(opening.name, "rb") : NULL;
    pliant_opening_end(&opening);
    if (opening.refused) return pliant_fail(PLIANT_ERROR_FILE, "%s: may not be read: %s", path, opening.refused);
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    const long size = fseek(file, 0, SEEK_END) == 0 ? ftell(file) : -1;
    char *data = size >= 0 && (size_t)size < max_file_size ? pliant_calloc((size_t)size + 1, 1) : NULL;
    const bool whole = data && fseek(file, 0, SEEK_SET) == 0 && fread(data, 1, (size_t)size, file) == (size_t)size;
    fclose(file);
    if (whole) {
        *out = (file_text){path, data, (size_t)size};
        return PLIANT_OK;
    }
    pliant_free(data);
    if (size >= 0 && (size_t)size >= max_file_size)
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: a mesh file of more than 4 GiB is not read", path);
    return data || size < 0 ? pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be read", path)
                            : pliant_fail_memory("a mesh file");
}

static double six_volumes(const mesh_file *file, const int32_t *node)
{
    double e[3][3];
    for (int v = 0; v < 3; v++)
        for (int d = 0; d < 3; d++)
            e[v][d] = file->nodes[3 * (size_t)node[v + 1] + (size_t)d] - file->nodes[3 * (size_t)node[0] + (size_t)d];
    return e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) - e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
           e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
}

/* Check the parsed numbers, and give every tetrahedron a positive orientation. */
static pliant_status check(const char *path, double unit, mesh_file *file)
{
    if (file->num_tets < 1)
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: has no tetrahedra; export a volume mesh of linear tetrahedra",
                           path);
    for (size_t n = 0; n < 3 * (size_t)file->num_nodes; n++) {
        file->nodes[n] *= unit;
        if (!(fabs(file->nodes[n]) < 1e6))
            return pliant_fail(PLIANT_ERROR_FORMAT, "%s: node %zu does not lie within 1e6 m; check mesh/unit", path,
                               n / 3);
    }
    for (int32_t t = 0; t < file->num_tets; t++) {
        int32_t *node = file->tets + 4 * (size_t)t;
        for (int v = 0; v < 4; v++)
            if (node[v] < 0 || node[v] >= file->num_nodes)
                return pliant_fail(PLIANT_ERROR_FORMAT, "%s: tetrahedron %d names node %d of %d; the file is damaged",
                                   path, t, node[v], file->num_nodes);
        double longest = 0;
        for (int v = 1; v < 4; v++)
            for (int d = 0; d < 3; d++)
                longest = fmax(longest, fabs(file->nodes[3 * (size_t)node[v] + (size_t)d] -
                                             file->nodes[3 * (size_t)node[0] + (size_t)d]));
        const double volume = six_volumes(file, node);
        if (!(fabs(volume) > 1e-9 * longest * longest * longest))
            return pliant_fail(PLIANT_ERROR_FORMAT,
                               "%s: tetrahedron %d is flat; mesh again, or optimize the mesh's quality", path, t);
        if (volume < 0) {
            const int32_t last = node[3];
            node[3] = node[2];
            node[2] = last;
        }
    }
    return PLIANT_OK;
}

/* Drop nodes that no tetrahedron uses. */
static pliant_status drop_unused(mesh_file *file)
{
    int32_t *row = pliant_calloc((size_t)file->num_nodes, sizeof *row), count = 0;
    if (!row) return pliant_fail_memory("a mesh file");
    for (size_t v = 0; v < 4 * (size_t)file->num_tets; v++) row[file->tets[v]] = 1;
    for (int32_t n = 0; n < file->num_nodes; n++) {
        if (!row[n]) continue;
        memmove(file->nodes + 3 * (size_t)count, file->nodes + 3 * (size_t)n, 3 * sizeof *file->nodes);
        row[n] = count++;
    }
    for (size_t v = 0; v < 4 * (size_t)file->num_tets; v++) file->tets[v] = row[file->tets[v]];
    file->num_nodes = count;
    pliant_free(row);
    return PLIANT_OK;
}

static bool ends_with(const char *path, const char *ending)
{
    const size_t length = strlen(path), size = strlen(ending);
    return length > size && strcasecmp(path + length - size, ending) == 0;
}

pliant_status pliant_mesh_file_read(const char *path, double unit, mesh_file *out)
{
    file_text text;
    mesh_file file = {0};
    const bool msh = ends_with(path, ".msh");
    if (!msh && !ends_with(path, ".vtu"))
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: unknown ending of a mesh; use .vtu (VTK) or .msh (Gmsh 4.1)",
                           path);
    pliant_status status = read_text(path, &text);
    if (status != PLIANT_OK) return status;
    locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0), old = uselocale(c); /* decimal points in numbers */
    status = msh ? pliant_mesh_parse_msh(&text, &file) : pliant_mesh_parse_vtu(&text, &file);
    uselocale(old);
    if (c) freelocale(c);
    if (status == PLIANT_OK) status = check(path, unit, &file);
    if (status == PLIANT_OK) status = drop_unused(&file);
    pliant_free(text.data);
    if (status == PLIANT_OK) *out = file;
    else pliant_mesh_file_free(&file);
    return status;
}

/* --- The fine mesh. --- */

static void centre_of(const mesh_file *file, int32_t tet, double out[3])
{
    memset(out, 0, 3 * sizeof *out);
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++)
            out[d] += 0.25 * file->nodes[3 * (size_t)file->tets[4 * (size_t)tet + (size_t)v] + (size_t)d];
}

static void to_axes(const pliant_mesh *mesh, const double world[3], double out[3])
{
    for (int d = 0; d < 3; d++) {
        out[d] = 0;
        for (int r = 0; r < 3; r++) out[d] += mesh->direction[3 * r + d] * (world[r] - mesh->corner[r]);
    }
}

/* Create cells along the scan's axes around all nodes. A tetrahedron extends at most one cell edge from its centre. A
 * point's tetrahedron therefore has its centre in the point's cell or in an adjacent cell (pliant_mesh_locate). */
static pliant_status make_cells(const char *path, const mesh_file *file, const pliant_geometry *scan, pliant_mesh *mesh)
{
    const double max_cells = 1 << 26;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, reach = 0, count = 1,
           at[3];
    memcpy(mesh->direction, scan->direction, sizeof mesh->direction);
    for (int32_t n = 0; n < file->num_nodes; n++) {
        to_axes(mesh, file->nodes + 3 * (size_t)n, at); /* relative to 0, since the corner is not set yet */
        for (int d = 0; d < 3; d++) {
            low[d] = fmin(low[d], at[d]);
            high[d] = fmax(high[d], at[d]);
        }
    }
    for (int32_t t = 0; t < file->num_tets; t++) {
        double centre[3], along[3];
        centre_of(file, t, centre);
        to_axes(mesh, centre, along);
        for (int v = 0; v < 4; v++) {
            to_axes(mesh, file->nodes + 3 * (size_t)file->tets[4 * (size_t)t + (size_t)v], at);
            for (int d = 0; d < 3; d++) reach = fmax(reach, fabs(at[d] - along[d]));
        }
    }
    reach *= 1 + 1e-6;
    for (int d = 0; d < 3; d++) count *= ceil((high[d] - low[d]) / reach) + 1;
    if (count > max_cells) reach *= cbrt(count / max_cells) * 1.1;
    for (int r = 0; r < 3; r++)
        for (int d = 0; d < 3; d++) mesh->corner[r] += mesh->direction[3 * r + d] * (low[d] - 1e-6 * reach);
    for (int d = 0; d < 3; d++) {
        mesh->cell_size[d] = reach;
        mesh->cells[d] = (int32_t)ceil((high[d] - low[d]) / reach) + 1;
    }
    double first[3], last[3];
    pliant_geometry_to_index(scan, mesh->corner, first);
    for (int d = 0; d < 3; d++) last[d] = first[d] + (high[d] - low[d]) / scan->spacing[d];
    for (int d = 0; d < 3; d++)
        if (last[d] < -0.5 || first[d] > scan->size[d] - 0.5)
            return pliant_fail(
                PLIANT_ERROR_SCENE,
                "mesh/file: %s lies outside the scan, from %.4g to %.4g m along its axis %d; check mesh/unit (0.001 "
                "for millimetres) and that the mesh has LPS axes",
                path, low[d], high[d], d + 1);
    return PLIANT_OK;
}

static int32_t cell_of(const pliant_mesh *mesh, const mesh_file *file, int32_t tet)
{
    double centre[3], along[3];
    int32_t at[3];
    centre_of(file, tet, centre);
    to_axes(mesh, centre, along);
    for (int d = 0; d < 3; d++)
        at[d] = (int32_t)fmin(fmax(floor(along[d] / mesh->cell_size[d]), 0), mesh->cells[d] - 1);
    return at[0] + mesh->cells[0] * (at[1] + mesh->cells[1] * at[2]);
}

/* Sort the tetrahedra with keep = 1 into leaves, one leaf per cell, by their centres. keep: (file's tetrahedra). */
static pliant_status fill_cells(const mesh_file *file, const uint8_t *keep, const uint8_t *material,
                                const pliant_material_table *table, pliant_mesh *mesh, pliant_tet_material **materials)
{
    const size_t cells = (size_t)mesh->cells[0] * (size_t)mesh->cells[1] * (size_t)mesh->cells[2];
    const size_t places = (size_t)(mesh->cells[0] + 1) * (size_t)(mesh->cells[1] + 1) * (size_t)(mesh->cells[2] + 1);
    mesh->num_leaves = (int32_t)cells;
    mesh->leaf_of_cell = pliant_calloc(cells, sizeof *mesh->leaf_of_cell);
    mesh->leaf_start = pliant_calloc(cells + 2, sizeof *mesh->leaf_start);
    mesh->node_of_lattice = pliant_calloc(places, sizeof *mesh->node_of_lattice);
    mesh->lattice_of_node = pliant_calloc((size_t)file->num_nodes, sizeof *mesh->lattice_of_node);
    mesh->rest = pliant_calloc((size_t)file->num_nodes, 3 * sizeof *mesh->rest);
    mesh->tets = pliant_calloc((size_t)file->num_tets, 4 * sizeof *mesh->tets);
    *materials = pliant_calloc((size_t)file->num_tets, sizeof **materials);
    int32_t *row = pliant_calloc((size_t)file->num_nodes, sizeof *row);
    const bool good = mesh->leaf_of_cell && mesh->leaf_start && mesh->node_of_lattice && mesh->lattice_of_node &&
                      mesh->rest && mesh->tets && *materials && row;
    if (good) {
        /* Nodes have no lattice positions. */
        memset(mesh->node_of_lattice, 0xff, places * sizeof *mesh->node_of_lattice);
        for (size_t c = 0; c < cells; c++) mesh->leaf_of_cell[c] = (int32_t)c;
        for (int32_t t = 0; t < file->num_tets; t++) {
            if (!keep[t]) continue;
            mesh->leaf_start[cell_of(mesh, file, t) + 2]++;
            for (int v = 0; v < 4; v++) row[file->tets[4 * (size_t)t + (size_t)v]] = 1;
        }
        for (size_t c = 2; c < cells + 2; c++) mesh->leaf_start[c] += mesh->leaf_start[c - 1];
        for (int32_t n = 0; n < file->num_nodes; n++) {
            if (!row[n]) continue;
            memcpy(mesh->rest + 3 * (size_t)mesh->num_nodes, file->nodes + 3 * (size_t)n, 3 * sizeof *mesh->rest);
            /* Unique, since nodes with equal numbers would count as copies. */
            mesh->lattice_of_node[mesh->num_nodes] = mesh->num_nodes;
            row[n] = mesh->num_nodes++;
        }
        for (int32_t t = 0; t < file->num_tets; t++) {
            if (!keep[t]) continue;
            const int32_t to = mesh->leaf_start[cell_of(mesh, file, t) + 1]++;
            for (int v = 0; v < 4; v++)
                mesh->tets[4 * (size_t)to + (size_t)v] = row[file->tets[4 * (size_t)t + (size_t)v]];
            pliant_material_of_voxel(table, material[t], *materials + to);
            mesh->num_tets++;
        }
        mesh->num_moved = mesh->num_nodes; /* tetrahedra extend into adjacent cells */
    }
    pliant_free(row);
    return good ? PLIANT_OK : pliant_fail_memory("the mesh of a file");
}

pliant_status pliant_mesh_of_file(const char *path, const mesh_file *file, const pliant_geometry *scan,
                                  const uint8_t *material, bool keep_air, const pliant_material_table *table,
                                  pliant_mesh *out, pliant_tet_material **materials)
{
    pliant_mesh mesh = {0};
    int32_t kept = 0;
    uint8_t *keep = pliant_calloc((size_t)file->num_tets, 1);
    pliant_status status = keep ? make_cells(path, file, scan, &mesh) : pliant_fail_memory("the mesh of a file");
    for (int32_t t = 0; status == PLIANT_OK && t < file->num_tets; t++)
        kept += keep[t] = keep_air || !table->materials[material[t]].empty;
    if (status == PLIANT_OK && kept == 0)
        status = pliant_fail(
            PLIANT_ERROR_SCENE,
            "mesh/file: %s has no tetrahedron of a material that is tissue; check its regions and the material table",
            path);
    *materials = NULL;
    if (status == PLIANT_OK) status = fill_cells(file, keep, material, table, &mesh, materials);
    pliant_free(keep);
    if (status == PLIANT_OK) {
        *out = mesh;
        return PLIANT_OK;
    }
    pliant_mesh_free(&mesh);
    pliant_free(*materials);
    *materials = NULL;
    return status;
}
