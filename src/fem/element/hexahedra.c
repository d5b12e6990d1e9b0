/* Trilinear hexahedra on the cubes of the lattice: the change of volume is the same everywhere in a cube, the change of shape is the
 * trilinear one (mean dilatation: Nagtegaal, Parks, Rice 1974; B-bar: Hughes, Int. J. Numer. Meth. Engng 15:1413, 1980). With one rotation
 * a cube (Mueller and Gross 2004) its stiffness is constant:
 *     K = sum over t of mu_t int_t (2 e : e - 2/3 div^2) + (sum over t of V_t kappa_t) b b',   b = mean of the gradients, kappa = lambda + 2/3 mu,
 * over the five tetrahedra t of the cube, which carry the voxels' material: [H] 2.1 taken over a cube. A fourth of it is another cube's: that one's
 * displacement has the incompatible modes of Taylor, Beresford and Wilson (Int. J. Numer. Meth. Engng 10:1211, 1976), which are condensed, and its
 * change of volume is linear in the cube, so that it bends as a beam does at any Poisson's ratio. What is not whole, beside a cut, stays tetrahedra. */
#include "base/fail.h"
#include "base/room.h"
#include "fem/element/hexahedra.h"
#include "base/dense.h"
#include "fem/system.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

enum { CORNERS = 8, UNKNOWNS = 24, POINTS = 3, ENHANCED = CORNERS + 3, MODES = PLIANT_CUBE_MODES };

/* Tissue that fills a part of a cube alone leaves the rest this part of its stiffness (finite cell method: Parvizian, Duester, Rank 2007;
 * NUMERICS 5). */
static const double filler = 5e-2;

/* Part of the stiffness that is of the cube with incompatible modes (NUMERICS 5): one change of volume alone lets tissue one cube thin bend too easily. */
static const double enhanced = 0.25;

int pliant_cell_parity(const pliant_mesh *mesh, int32_t cell)
{
    int32_t nx = mesh->cells[0], ny = mesh->cells[1];
    return (cell % nx + cell / nx % ny + cell / nx / ny) & 1;
}

int32_t pliant_cell_of_tet(const pliant_mesh *mesh, int32_t tet)
{
    if (mesh->lattice_of_tet) return mesh->lattice_of_tet[tet] / 5;
    const int32_t nx = mesh->cells[0] + 1, ny = mesh->cells[1] + 1;
    int32_t sum[3] = {0, 0, 0}; /* its middle lies within a smallest cell of its leaf, or between such cells */
    for (int v = 0; v < 4; v++) {
        const int32_t at = mesh->lattice_of_node[mesh->tets[4 * tet + v]];
        sum[0] += at % nx, sum[1] += at / nx % ny, sum[2] += at / nx / ny;
    }
    return mesh->leaf_of_cell[sum[0] / 4 + mesh->cells[0] * (sum[1] / 4 + mesh->cells[1] * (sum[2] / 4))];
}

size_t pliant_count_cells(const pliant_mesh *mesh)
{
    return mesh->lattice_of_tet ? (size_t)mesh->cells[0] * (size_t)mesh->cells[1] * (size_t)mesh->cells[2] : (size_t)mesh->num_leaves;
}

/* ---- which cubes are whole */

/* (cells) tetrahedra of each: 1 + the first one, by a list through `next`; and how many. among: as for find_cubes */
static void list_tets(const pliant_mesh *mesh, const int32_t *among, int32_t tets, int32_t *first, int32_t *next, int32_t *count)
{
    for (int32_t i = tets - 1; i >= 0; i--) {
        const int32_t t = among ? among[i] : i, cell = mesh->lattice_of_tet[t] / 5;
        next[t] = first[cell] - 1;
        first[cell] = t + 1;
        count[cell]++;
    }
}

/* One more tetrahedron of a cube that was all -1: false where there is one in its slot, or another node at a corner. */
static bool add_to_cube(const pliant_mesh *mesh, int32_t cell, int32_t tet, pliant_cube *out)
{
    const int32_t base[3] = {cell % mesh->cells[0], cell / mesh->cells[0] % mesh->cells[1], cell / mesh->cells[0] / mesh->cells[1]};
    const int32_t nx = mesh->cells[0] + 1, ny = mesh->cells[1] + 1, slot = mesh->lattice_of_tet[tet] % 5;
    if (out->tet[slot] >= 0) return false;
    out->tet[slot] = tet;
    for (int v = 0; v < 4; v++) { /* a tetrahedron's own order is turned where that makes it positive */
        int32_t node = mesh->tets[4 * tet + v], at = mesh->lattice_of_node[node];
        int corner = (at % nx - base[0]) | (at / nx % ny - base[1]) << 1 | (at / nx / ny - base[2]) << 2;
        if (out->node[corner] >= 0 && out->node[corner] != node) return false;
        out->node[corner] = node;
    }
    return true;
}

/* Five tetrahedra, one a slot, that meet at eight nodes. */
static const pliant_cube no_cube = {.tet = {-1, -1, -1, -1, -1}, .node = {-1, -1, -1, -1, -1, -1, -1, -1}};
static bool is_whole(const pliant_mesh *mesh, int32_t cell, int32_t first, const int32_t *next, pliant_cube *out)
{
    *out = no_cube;
    for (int32_t t = first; t >= 0; t = next[t])
        if (!add_to_cube(mesh, cell, t, out)) return false;
    return true;
}

static int shared_nodes(const pliant_mesh *mesh, int32_t a, int32_t b)
{
    int count = 0;
    for (int v = 0; v < 16; v++) count += mesh->tets[4 * (size_t)a + v / 4] == mesh->tets[4 * (size_t)b + v % 4];
    return count;
}

/* What is left of a divided cube on one side of a cut: a fragment of its middle and on each of that one's faces one that it shares the nodes with. They
 * move as the cube did, with their part of its stiffness and mass. found: (num_found) those of the cell that there are already */
static bool is_part(const pliant_mesh *mesh, int32_t cell, int32_t first, const int32_t *next, int32_t middle, const pliant_cube *found, int32_t num_found,
                    pliant_cube *out)
{
    int count = 1;
    *out = no_cube;
    out->part = true;
    if (mesh->lattice_of_tet[middle] % 5 != 0 || !add_to_cube(mesh, cell, middle, out)) return false;
    for (int32_t t = first; t >= 0; t = next[t]) {
        const int slot = mesh->lattice_of_tet[t] % 5;
        bool taken = slot == 0 || shared_nodes(mesh, middle, t) < 3;
        for (int32_t c = 0; c < num_found; c++) taken = taken || found[c].tet[slot] == t;
        count += !taken && add_to_cube(mesh, cell, t, out);
    }
    return count == 5;
}

bool pliant_cube_of(const pliant_mesh *mesh, int32_t tet, pliant_cube *out)
{
    const int32_t cell = mesh->lattice_of_tet[tet] / 5, *tets = mesh->tet_of_lattice + 5 * (size_t)cell;
    *out = no_cube;
    for (int slot = 0; slot < 5; slot++)
        if (tets[slot] < 0 || !add_to_cube(mesh, cell, tets[slot], out)) return false;
    return out->tet[mesh->lattice_of_tet[tet] % 5] == tet;
}

bool pliant_cube_is_box(const pliant_mesh *mesh, const pliant_cube *cube, int32_t size)
{
    for (int v = 1; v < CORNERS; v++)
        for (int d = 0; d < 3; d++) {
            double apart = mesh->rest[3 * cube->node[v] + d] - mesh->rest[3 * cube->node[0] + d];
            for (int axis = 0; axis < 3; axis++)
                if (v >> axis & 1) apart -= mesh->direction[3 * d + axis] * mesh->cell_size[axis] * size;
            if (fabs(apart) > 1e-6 * mesh->cell_size[0]) return false;
        }
    return true;
}

/* of a cell with more than five tetrahedra, behind the cubes that there are */
static void add_parts(const pliant_mesh *mesh, int32_t cell, int32_t first, const int32_t *next, pliant_cube *cubes, int32_t *count)
{
    const int32_t begin = *count;
    for (int32_t t = first; t >= 0; t = next[t])
        *count += is_part(mesh, cell, first, next, t, cubes + begin, *count - begin, cubes + *count) && pliant_cube_is_box(mesh, cubes + *count, 1);
}

/* among: Nullable: (count) the tetrahedra to look at, ascending; NULL: the first ones */
static pliant_status find_cubes(const pliant_mesh *mesh, const int32_t *among, int32_t tets, bool boxes, pliant_cube **out, int32_t *count)
{
    const size_t cells = (size_t)mesh->cells[0] * mesh->cells[1] * mesh->cells[2];
    int32_t *first = pliant_calloc(cells, sizeof *first), *number = pliant_calloc(cells, sizeof *number);
    int32_t *next = pliant_room((size_t)mesh->num_tets, sizeof *next);
    *count = 0;
    *out = pliant_calloc((size_t)tets / 5 + 1, sizeof **out);
    pliant_status status = first && number && next && *out ? PLIANT_OK : pliant_fail_memory("the hexahedra");
    if (status == PLIANT_OK) list_tets(mesh, among, tets, first, next, number);
    for (int32_t cell = 0; status == PLIANT_OK && (size_t)cell < cells; cell++) {
        if (number[cell] == 5 && is_whole(mesh, cell, first[cell] - 1, next, *out + *count) && (!boxes || pliant_cube_is_box(mesh, *out + *count, 1))) ++*count;
        if (boxes && number[cell] > 5) add_parts(mesh, cell, first[cell] - 1, next, *out, count);
    }
    pliant_free(first);
    pliant_free(number);
    pliant_free(next);
    if (status != PLIANT_OK) {
        pliant_free(*out);
        *out = NULL;
    }
    return status;
}

pliant_status pliant_cubes_find(const pliant_mesh *mesh, bool boxes, pliant_cube **out, int32_t *count)
{
    return find_cubes(mesh, NULL, mesh->num_tets, boxes, out, count);
}

pliant_status pliant_cubes_find_among(const pliant_mesh *mesh, const int32_t *tet, int32_t tets, pliant_cube **out, int32_t *count)
{
    return find_cubes(mesh, tet, tets, false, out, count);
}

/* ---- stiffness */

double pliant_cube_gradients(double x[CORNERS][3], const double at[3], double gradient[CORNERS][3])
{
    double local[CORNERS][3], j[9], inverse[9];
    memset(j, 0, sizeof j);
    for (int v = 0; v < CORNERS; v++) {
        double f[3], s[3];
        for (int d = 0; d < 3; d++) {
            s[d] = v >> d & 1 ? 1 : -1;
            f[d] = v >> d & 1 ? at[d] : 1 - at[d];
        }
        for (int d = 0; d < 3; d++) local[v][d] = s[d] * f[(d + 1) % 3] * f[(d + 2) % 3];
        for (int m = 0; m < 9; m++) j[m] += x[v][m / 3] * local[v][m % 3];
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            int a = (r + 1) % 3, b = (r + 2) % 3, p = (c + 1) % 3, q = (c + 2) % 3;
            inverse[3 * c + r] = j[3 * a + p] * j[3 * b + q] - j[3 * a + q] * j[3 * b + p];
        }
    double determinant = j[0] * inverse[0] + j[1] * inverse[3] + j[2] * inverse[6];
    for (int v = 0; v < CORNERS; v++)
        for (int d = 0; d < 3; d++)
            gradient[v][d] = (local[v][0] * inverse[d] + local[v][1] * inverse[3 + d] + local[v][2] * inverse[6 + d]) / determinant;
    return determinant;
}

/* 2 e : e - 2/3 div^2 at a point, times a weight */
static void add_deviatoric(double gradient[ENHANCED][3], double weight, double *out)
{
    for (int a = 0; a < ENHANCED; a++)
        for (int b = 0; b < ENHANCED; b++) {
            const double *g = gradient[a], *h = gradient[b];
            double dot = g[0] * h[0] + g[1] * h[1] + g[2] * h[2];
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    out[MODES * (3 * a + i) + 3 * b + j] += weight * ((i == j ? dot : 0) + g[j] * h[i] - 2.0 / 3 * g[i] * h[j]);
        }
}

/* What the integrals of a cube share: its corners, the map in its middle, and the change of volume as linear in the cube, of the corners' displacements */
typedef struct cube_frame {
    double x[CORNERS][3], middle[9], determinant;
    double dilation[4][UNKNOWNS];  /* mean, and along each axis */
} cube_frame;

/* The gradients of the corners' shape functions, and of the incompatible modes 1/2 s_d^2, s from the middle, scaled so that their mean is zero (Taylor,
 * Beresford, Wilson, Int. J. Numer. Meth. Engng 10:1211, 1976). Returns the determinant of the map. */
static double gradients_at(cube_frame *frame, const double at[3], double gradient[ENHANCED][3])
{
    const double determinant = pliant_cube_gradients(frame->x, at, gradient);
    for (int d = 0; d < 3; d++)
        for (int i = 0; i < 3; i++) gradient[CORNERS + d][i] = frame->determinant / determinant * (at[d] - 0.5) * frame->middle[3 * d + i];
    return determinant;
}

static void find_frame(cube_frame *frame)
{
    static const double point[POINTS] = {0.1127016653792583, 0.5, 0.8872983346207417}, weight[POINTS] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    const double middle[3] = {0.5, 0.5, 0.5};
    double gradient[CORNERS][3], whole = 0;
    frame->determinant = pliant_cube_gradients(frame->x, middle, gradient);
    /* a local coordinate is the sum of the shape functions of the corners where it is 1 */
    for (int d = 0; d < 3; d++)
        for (int i = 0; i < 3; i++) {
            frame->middle[3 * d + i] = 0;
            for (int v = 0; v < CORNERS; v++) frame->middle[3 * d + i] += v >> d & 1 ? gradient[v][i] : 0;
        }
    memset(frame->dilation, 0, sizeof frame->dilation);
    for (int p = 0; p < POINTS * POINTS * POINTS; p++) {
        const double at[3] = {point[p % POINTS], point[p / POINTS % POINTS], point[p / POINTS / POINTS]};
        const double part = weight[p % POINTS] * weight[p / POINTS % POINTS] * weight[p / POINTS / POINTS];
        const double determinant = fabs(pliant_cube_gradients(frame->x, at, gradient));
        whole += part * determinant;
        for (int i = 0; i < UNKNOWNS; i++) {
            const double g = gradient[i / 3][i % 3];
            frame->dilation[0][i] += part * determinant * g;
            for (int d = 0; d < 3; d++) frame->dilation[1 + d][i] += 12 * part * (at[d] - 0.5) * g;
        }
    }
    for (int i = 0; i < UNKNOWNS; i++) frame->dilation[0][i] /= whole;
}

static void add_dilation(const cube_frame *frame, const double at[3], double gradient[ENHANCED][3], double weight, double *out)
{
    double change[MODES];
    for (int i = 0; i < MODES; i++) change[i] = i < UNKNOWNS ? frame->dilation[0][i] : gradient[i / 3][i % 3];
    for (int i = 0; i < UNKNOWNS; i++)
        for (int d = 0; d < 3; d++) change[i] += (at[d] - 0.5) * frame->dilation[1 + d][i];
    for (int i = 0; i < MODES; i++)
        for (int j = 0; j < MODES; j++) out[MODES * i + j] += weight * change[i] * change[j];
}

/* Gauss points of a tetrahedron: those of the cube, collapsed (Stroud 1971); exact for the products of gradients in a box */
static void integrate_slot(cube_frame *frame, const int corners[4], double *deviatoric, double *dilation, double *volume, double mean[UNKNOWNS],
                           double load[CORNERS])
{
    static const double point[POINTS] = {0.1127016653792583, 0.5, 0.8872983346207417}, weight[POINTS] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    double corner[4][3], edge[9];
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) corner[v][d] = corners[v] >> d & 1;
    for (int m = 0; m < 9; m++) edge[m] = corner[1 + m / 3][m % 3] - corner[0][m % 3];
    double six = fabs(edge[0] * (edge[4] * edge[8] - edge[5] * edge[7]) - edge[1] * (edge[3] * edge[8] - edge[5] * edge[6]) +
                      edge[2] * (edge[3] * edge[7] - edge[4] * edge[6]));
    for (int p = 0; p < POINTS * POINTS * POINTS; p++) {
        double u = point[p % POINTS], v = point[p / POINTS % POINTS], w = point[p / POINTS / POINTS];
        double b[4] = {0, u, (1 - u) * v, (1 - u) * (1 - v) * w}, at[3] = {0, 0, 0}, gradient[ENHANCED][3];
        b[0] = 1 - b[1] - b[2] - b[3];
        for (int c = 0; c < 4; c++)
            for (int d = 0; d < 3; d++) at[d] += b[c] * corner[c][d];
        double part = weight[p % POINTS] * weight[p / POINTS % POINTS] * weight[p / POINTS / POINTS] * (1 - u) * (1 - u) * (1 - v) * six;
        part *= fabs(gradients_at(frame, at, gradient));
        add_deviatoric(gradient, part, deviatoric);
        add_dilation(frame, at, gradient, part, dilation);
        *volume += part;
        for (int i = 0; i < UNKNOWNS; i++) mean[i] += part * gradient[i / 3][i % 3];
        for (int c = 0; c < CORNERS; c++)
            load[c] += part * (c & 1 ? at[0] : 1 - at[0]) * (c & 2 ? at[1] : 1 - at[1]) * (c & 4 ? at[2] : 1 - at[2]);
    }
}

/* where a corner is from the first one; as a lattice has it where no node was moved, so that its cubes are alike to the last bit */
static void corner_of(const pliant_mesh *mesh, const pliant_cube *cube, int corner, double x[3])
{
    const bool alike = mesh->num_moved == 0 && !mesh->leaf_of_cell;
    for (int d = 0; d < 3; d++) {
        x[d] = alike ? 0 : mesh->rest[3 * cube->node[corner] + d] - mesh->rest[3 * cube->node[0] + d];
        for (int axis = 0; alike && axis < 3; axis++)
            if (corner >> axis & 1) x[d] += mesh->direction[3 * d + axis] * mesh->cell_size[axis];
    }
}

void pliant_cube_integrate(const pliant_mesh *mesh, const pliant_cube *cube, int parity, pliant_cube_shape *out)
{
    cube_frame frame;
    double whole = 0;
    memset(out, 0, sizeof *out);
    for (int v = 0; v < CORNERS; v++) corner_of(mesh, cube, v, frame.x[v]);
    find_frame(&frame);
    for (int slot = 0; slot < 5; slot++) {
        int corners[4];
        pliant_mesh_slot_corners(parity, slot, corners);
        integrate_slot(&frame, corners, out->deviatoric[slot], out->dilation[slot], &out->volume[slot], out->mean, out->load[slot]);
        whole += out->volume[slot];
    }
    for (int i = 0; i < UNKNOWNS; i++) out->mean[i] /= whole;
}

void pliant_cube_moduli(const pliant_cube *cube, const double volume[5], const pliant_tet_material *material, double lambda[5], double mu[5])
{
    const double least = cube->part ? 0 : filler;
    double least_mu = 0, least_lambda = 0, whole = 0;
    for (int slot = 0; slot < 5; slot++) {
        whole += volume[slot];
        least_mu += least * volume[slot] * material[cube->tet[slot]].mu;
        least_lambda += least * volume[slot] * material[cube->tet[slot]].lambda;
    }
    for (int slot = 0; slot < 5; slot++) {
        mu[slot] = fmax(material[cube->tet[slot]].mu, least_mu / whole);
        lambda[slot] = fmax(material[cube->tet[slot]].lambda, least_lambda / whole);
    }
}

/* out: k without what its incompatible modes can take; false: they have no stiffness of their own */
static bool condense(const double *k, double *out)
{
    enum { INNER = MODES - UNKNOWNS };
    double inner[INNER * INNER], outer[INNER * UNKNOWNS], answer[INNER * UNKNOWNS];
    for (int m = 0; m < INNER; m++) {
        for (int n = 0; n < INNER; n++) inner[INNER * m + n] = k[MODES * (UNKNOWNS + m) + UNKNOWNS + n];
        for (int i = 0; i < UNKNOWNS; i++) answer[UNKNOWNS * m + i] = outer[UNKNOWNS * m + i] = k[MODES * (UNKNOWNS + m) + i];
    }
    if (!pliant_dense_cholesky(INNER, inner)) return false;
    pliant_dense_cholesky_solve(INNER, inner, UNKNOWNS, answer);
    for (int i = 0; i < UNKNOWNS; i++)
        for (int j = 0; j < UNKNOWNS; j++) {
            out[UNKNOWNS * i + j] = k[MODES * i + j];
            for (int m = 0; m < INNER; m++) out[UNKNOWNS * i + j] -= outer[UNKNOWNS * m + i] * answer[UNKNOWNS * m + j];
        }
    return true;
}

double pliant_cube_deviatoric(const pliant_cube_shape *shape, const pliant_cube *cube, const pliant_tet_material *material, double *out)
{
    double lambda[5], mu[5], bulk = 0, k[MODES * MODES] = {0}, bending[UNKNOWNS * UNKNOWNS];
    pliant_cube_moduli(cube, shape->volume, material, lambda, mu);
    memset(out, 0, UNKNOWNS * UNKNOWNS * sizeof *out);
    for (int slot = 0; slot < 5; slot++) {
        const double kappa = lambda[slot] + 2.0 / 3 * mu[slot];
        bulk += shape->volume[slot] * kappa;
        for (int i = 0; i < UNKNOWNS * UNKNOWNS; i++) out[i] += mu[slot] * shape->deviatoric[slot][i / UNKNOWNS * MODES + i % UNKNOWNS];
        for (int i = 0; i < MODES * MODES; i++) k[i] += mu[slot] * shape->deviatoric[slot][i] + kappa * shape->dilation[slot][i];
    }
    if (!condense(k, bending)) return bulk;
    for (int i = 0; i < UNKNOWNS; i++)
        for (int j = 0; j < UNKNOWNS; j++)
            out[UNKNOWNS * i + j] += enhanced * (bending[UNKNOWNS * i + j] - bulk * shape->mean[i] * shape->mean[j] - out[UNKNOWNS * i + j]);
    return bulk;
}

static void stiffness_of(const pliant_cube_shape *shape, const pliant_cube *cube, const pliant_tet_material *material, double *out)
{
    double bulk = pliant_cube_deviatoric(shape, cube, material, out);
    for (int i = 0; i < UNKNOWNS; i++)
        for (int j = 0; j < UNKNOWNS; j++) out[UNKNOWNS * i + j] += bulk * shape->mean[i] * shape->mean[j];
}

/* ---- as macro-elements */

pliant_status pliant_macros_keep(pliant_macros *macros, int32_t element, int32_t unknowns, const double *stiffness)
{
    double root[UNKNOWNS * UNKNOWNS];
    int32_t rank = macros->rank[element] = pliant_dense_root(unknowns, stiffness, root);
    macros->root[element] = NULL;
    if (rank == 0) return PLIANT_OK;
    size_t count = (size_t)rank * (size_t)unknowns;
    if (!(macros->root[element] = pliant_calloc(count, sizeof **macros->root))) return pliant_fail_memory("the hexahedra");
    for (size_t m = 0; m < count; m++) macros->root[element][m] = (float)root[m];
    return PLIANT_OK;
}

pliant_status pliant_macros_add_hexahedron(const pliant_tet_material *material, const pliant_cube *cube, const pliant_cube_shape *shape, pliant_macros *macros,
                                           int32_t element)
{
    double k[UNKNOWNS * UNKNOWNS], shear = 0;
    for (int v = 0; v < CORNERS; v++) macros->own[8 * element + v] = cube->node[v];
    memcpy(macros->gradient + 24 * (size_t)element, shape->mean, sizeof shape->mean);
    stiffness_of(shape, cube, material, k);
    for (int slot = 0; slot < 5; slot++) shear += shape->volume[slot] * material[cube->tet[slot]].mu;
    macros->shear[element] = shear;
    return pliant_macros_keep(macros, element, UNKNOWNS, k);
}

pliant_status pliant_macros_add_tet(const pliant_mesh *mesh, const pliant_tet_material *material, int32_t tet, pliant_macros *macros, int32_t element)
{
    double k[144];
    for (int v = 0; v < CORNERS; v++) macros->own[8 * element + v] = v < 4 ? mesh->tets[4 * tet + v] : -1;
    macros->shear[element] = material[tet].mu * pliant_mesh_gradients(mesh, tet, macros->gradient + 24 * (size_t)element);
    pliant_tet_stiffness(mesh, tet, material + tet, k);
    return pliant_macros_keep(macros, element, 12, k);
}

static pliant_status take_room(pliant_macros *macros, size_t count, size_t corners, void *(*take)(size_t count, size_t size))
{
    bool good = (macros->start = take(count + 1, sizeof *macros->start)) && (macros->node = take(corners, sizeof *macros->node)) &&
                (macros->held = take(corners, 1)) && (macros->grounded = take(count, 1)) && (macros->own = take(count, 8 * sizeof *macros->own)) &&
                (macros->gradient = take(count, 24 * sizeof *macros->gradient)) && (macros->cell = take(count, sizeof *macros->cell)) &&
                (macros->shear = take(count, sizeof *macros->shear)) && (macros->rank = take(count, sizeof *macros->rank)) &&
                (macros->root = take(count, sizeof *macros->root));
    macros->count = good ? (int32_t)count : 0;
    return good ? PLIANT_OK : pliant_fail_memory("the hexahedra");
}

pliant_status pliant_macros_allocate(pliant_macros *macros, size_t count, size_t corners) { return take_room(macros, count, corners, pliant_calloc); }

pliant_status pliant_macros_room(pliant_macros *macros, size_t count, size_t corners)
{
    pliant_status status = take_room(macros, count, corners, pliant_room);
    macros->count = 0;
    if (status == PLIANT_OK) macros->start[0] = 0;
    return status;
}

int32_t pliant_macros_blocks(size_t count, size_t corners)
{
    const size_t for_forces = (corners + 4 * LANES - 1) / (4 * LANES), for_rotations = (count + LANES - 1) / LANES;
    return (int32_t)(for_forces > for_rotations ? for_forces : for_rotations);
}

/* Hexahedra of the body before, by cell. */
typedef struct earlier_cubes {
    const pliant_macros *macros;
    const uint8_t *kept;      /* (tetrahedra) */
    int32_t *element;         /* (cells) 1 + a hexahedron; 0: none */
} earlier_cubes;

static pliant_status list_earlier(const pliant_system *before, const uint8_t *kept, int32_t cells, earlier_cubes *out)
{
    *out = (earlier_cubes){.macros = before->macros, .kept = kept, .element = pliant_calloc((size_t)cells, sizeof *out->element)};
    if (!out->element) return pliant_fail_memory("the hexahedra");
    for (int32_t e = 0; e < out->macros->count; e++)
        if (out->macros->start[e + 1] - out->macros->start[e] == CORNERS) out->element[out->macros->cell[e]] = e + 1;
    return PLIANT_OK;
}

/* -1: there was none, or of another material */
static int32_t find_earlier(const earlier_cubes *earlier, int32_t cell, const pliant_cube *cube)
{
    bool same = earlier->element[cell] > 0;
    for (int slot = 0; slot < 5; slot++) same = same && earlier->kept[cube->tet[slot]];
    return same ? earlier->element[cell] - 1 : -1;
}

void pliant_macros_share_root(const pliant_macros *from, int32_t was, pliant_macros *macros, int32_t element)
{
    macros->rank[element] = from->rank[was];
    macros->root[element] = pliant_share(from->root[was]);
}

static void copy_hexahedron(const pliant_macros *from, int32_t was, const pliant_cube *cube, pliant_macros *macros, int32_t element)
{
    memcpy(macros->own + 8 * (size_t)element, cube->node, sizeof cube->node);
    memcpy(macros->gradient + 24 * (size_t)element, from->gradient + 24 * (size_t)was, 24 * sizeof *macros->gradient);
    macros->shear[element] = from->shear[was];
    pliant_macros_share_root(from, was, macros, element);
}

/* first, next: the lists of list_tets; whole: (cells) */
static pliant_status fill(pliant_system *system, const pliant_tet_material *material, const int32_t *first, const int32_t *next,
                          const uint8_t *whole, int32_t cells, const earlier_cubes *earlier)
{
    const pliant_mesh *mesh = system->mesh;
    pliant_macros *macros = system->macros;
    pliant_cube_shape *shape = pliant_calloc(2, sizeof *shape); /* by parity: all cubes of a lattice without moved nodes are alike */
    bool known[2] = {false, false};
    pliant_status status = shape ? PLIANT_OK : pliant_fail_memory("the hexahedra");
    int32_t element = 0, corner = 0;
    for (int32_t cell = 0; status == PLIANT_OK && cell < cells; cell++) {
        int parity = pliant_cell_parity(mesh, cell);
        pliant_cube cube;
        if (whole[cell]) {
            is_whole(mesh, cell, first[cell] - 1, next, &cube);
            if (!known[parity] || mesh->num_moved > 0) pliant_cube_integrate(mesh, &cube, parity, &shape[parity]);
            known[parity] = true;
            const int32_t was = earlier ? find_earlier(earlier, cell, &cube) : -1;
            if (was >= 0) copy_hexahedron(earlier->macros, was, &cube, macros, element);
            else status = pliant_macros_add_hexahedron(material, &cube, &shape[parity], macros, element);
            memcpy(macros->node + corner, cube.node, sizeof cube.node);
            corner += CORNERS;
            macros->cell[element] = cell;
            macros->start[++element] = corner;
        }
        for (int32_t t = first[cell] - 1; status == PLIANT_OK && !whole[cell] && t >= 0; t = next[t]) {
            status = pliant_macros_add_tet(mesh, material, t, macros, element);
            memcpy(macros->node + corner, mesh->tets + 4 * t, 4 * sizeof *mesh->tets);
            corner += 4;
            macros->cell[element] = cell;
            macros->start[++element] = corner;
        }
    }
    pliant_free(shape);
    return status;
}

pliant_status pliant_system_hexahedra(pliant_system *system, const pliant_tet_material *material, const pliant_system *before, const uint8_t *kept)
{
    const pliant_mesh *mesh = system->mesh;
    const int32_t cells = mesh->cells[0] * mesh->cells[1] * mesh->cells[2];
    int32_t *first = pliant_calloc((size_t)cells, sizeof *first), *count = pliant_calloc((size_t)cells, sizeof *count);
    int32_t *next = pliant_calloc((size_t)mesh->num_tets, sizeof *next);
    uint8_t *whole = pliant_calloc((size_t)cells, 1);
    pliant_status status = first && count && next && whole ? PLIANT_OK : pliant_fail_memory("the hexahedra");
    size_t elements = 0, corners = 0;
    if (status == PLIANT_OK) list_tets(mesh, NULL, mesh->num_tets, first, next, count);
    for (int32_t cell = 0; status == PLIANT_OK && cell < cells; cell++) {
        pliant_cube cube;
        whole[cell] = count[cell] == 5 && is_whole(mesh, cell, first[cell] - 1, next, &cube);
        elements += whole[cell] ? 1 : (size_t)count[cell];
        corners += whole[cell] ? CORNERS : 4 * (size_t)count[cell];
    }
    if (status == PLIANT_OK && !(system->macros = pliant_calloc(1, sizeof *system->macros))) status = pliant_fail_memory("the hexahedra");
    if (status == PLIANT_OK) status = pliant_macros_allocate(system->macros, elements, corners);
    earlier_cubes earlier = {0};
    if (status == PLIANT_OK && kept) status = list_earlier(before, kept, cells, &earlier);
    if (status == PLIANT_OK) status = fill(system, material, first, next, whole, cells, kept ? &earlier : NULL);
    pliant_free(earlier.element);
    system->num_blocks = pliant_macros_blocks(elements, corners);
    pliant_free(first);
    pliant_free(count);
    pliant_free(next);
    pliant_free(whole);
    return status;
}

pliant_status pliant_hexahedra_of_tets(const pliant_mesh *mesh, const pliant_macros *macros, int32_t **out)
{
    int32_t *next = pliant_calloc(pliant_count_cells(mesh), sizeof *next);
    int32_t *element = *out = pliant_calloc((size_t)mesh->num_tets, sizeof *element);
    if (!next || !element) {
        pliant_free(next);
        pliant_free(element);
        *out = NULL;
        return pliant_fail_memory("the hexahedra");
    }
    for (int32_t e = macros->count - 1; e >= 0; e--) next[macros->cell[e]] = e;
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        const int32_t cell = pliant_cell_of_tet(mesh, t);
        element[t] = next[cell];
        next[cell] += macros->start[next[cell] + 1] - macros->start[next[cell]] == 4; /* the tetrahedra of a cube are in their own order */
    }
    pliant_free(next);
    return PLIANT_OK;
}

pliant_status pliant_system_cubes(pliant_system *system)
{
    const pliant_mesh *mesh = system->mesh;
    const int32_t cells = mesh->cells[0] * mesh->cells[1] * mesh->cells[2], nx = mesh->cells[0] + 1, ny = mesh->cells[1] + 1;
    size_t count = (size_t)mesh->num_tets / 5;
    pliant_macros *macros = system->macros = pliant_calloc(1, sizeof *macros);
    if (!macros || !(macros->start = pliant_calloc(count + 1, sizeof *macros->start)) ||
        !(macros->node = pliant_calloc(CORNERS * count, sizeof *macros->node)) || !(macros->cell = pliant_calloc(count, sizeof *macros->cell)))
        return pliant_fail_memory("the hexahedra");
    for (int32_t cell = 0; cell < cells; cell++) {
        if (mesh->tet_of_lattice[5 * (size_t)cell] < 0) continue;
        int32_t i = cell % mesh->cells[0], j = cell / mesh->cells[0] % mesh->cells[1], k = cell / mesh->cells[0] / mesh->cells[1];
        for (int v = 0; v < CORNERS; v++)
            macros->node[CORNERS * macros->count + v] = mesh->node_of_lattice[i + (v & 1) + nx * (j + (v >> 1 & 1) + ny * (k + (v >> 2)))];
        macros->cell[macros->count++] = cell;
        macros->start[macros->count] = CORNERS * macros->count;
    }
    system->num_blocks = (macros->count + LANES - 1) / LANES;
    return PLIANT_OK;
}
