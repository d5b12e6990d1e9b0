/* Trilinear hexahedra on the cubes of the lattice. The change of volume is constant in a cube, and the change of shape
 * is trilinear (mean dilatation: Nagtegaal, Parks, Rice 1974; B-bar: Hughes, Int. J. Numer. Meth. Engng 15:1413, 1980).
 * With one rotation per cube (Mueller and Gross 2004) the stiffness is constant:
 *     K = sum over t of mu_t int_t (2 e : e - 2/3 div^2) + (sum over t of V_t kappa_t) b b'
 * b is the mean of the gradients, and kappa = lambda + 2/3 mu. The sums are over the five tetrahedra t of the cube,
 * which carry the voxels' material. This is [H] 2.1 applied to a cube.
 *
 * A fourth of the stiffness comes from another formulation. Its displacement has the condensed incompatible modes of
 * Taylor, Beresford and Wilson (Int. J. Numer. Meth. Engng 10:1211, 1976), and its change of volume is linear in the
 * cube. It bends like a beam at any Poisson's ratio.
 *
 * Next to a cut, parts of cubes are hexahedra as well, with their part of the material (hexahedra_cells.c). All other
 * fragments stay tetrahedra. */
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/element/hexahedra.h"
#include "base/dense.h"
#include "fem/system.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

enum { CORNERS = 8, UNKNOWNS = 24, POINTS = 3, ENHANCED = CORNERS + 3, MODES = PLIANT_CUBE_MODES };

/* Stiffness fraction of the empty part of a partially filled cube (finite cell method: Parvizian, Duester, Rank 2007;
 * NUMERICS.md). */
static const double filler = 5e-2;

/* Fraction of the stiffness from the cube with incompatible modes (NUMERICS.md). With a constant change of volume
 * alone, tissue one cube thin would bend too easily. */
static const double enhanced = 0.25;

/* ---- Stiffness. */

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
            gradient[v][d] =
                (local[v][0] * inverse[d] + local[v][1] * inverse[3 + d] + local[v][2] * inverse[6 + d]) / determinant;
    return determinant;
}

/* Add 2 e : e - 2/3 div^2 at a point, times a weight. */
static void add_deviatoric(double gradient[ENHANCED][3], double weight, double *out)
{
    for (int a = 0; a < ENHANCED; a++)
        for (int b = 0; b < ENHANCED; b++) {
            const double *g = gradient[a], *h = gradient[b];
            double dot = g[0] * h[0] + g[1] * h[1] + g[2] * h[2];
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    out[MODES * (3 * a + i) + 3 * b + j] +=
                        weight * ((i == j ? dot : 0) + g[j] * h[i] - 2.0 / 3 * g[i] * h[j]);
        }
}

/* Data shared by the integrals of a cube: corners, Jacobian in the middle, and the change of volume as a linear
 * function in the cube. */
typedef struct cube_frame {
    double x[CORNERS][3], middle[9], determinant;
    double dilation[4][UNKNOWNS];  /* mean, and slope along each axis */
} cube_frame;

/* Compute the gradients of the corners' shape functions and of the incompatible modes 1/2 s_d^2, with s from the
 * middle. The modes are scaled to a mean gradient of zero (Taylor, Beresford, Wilson, Int. J. Numer. Meth. Engng
 * 10:1211, 1976). Return the determinant of the map. */
static double gradients_at(cube_frame *frame, const double at[3], double gradient[ENHANCED][3])
{
    const double determinant = pliant_cube_gradients(frame->x, at, gradient);
    for (int d = 0; d < 3; d++)
        for (int i = 0; i < 3; i++)
            gradient[CORNERS + d][i] = frame->determinant / determinant * (at[d] - 0.5) * frame->middle[3 * d + i];
    return determinant;
}

static void find_frame(cube_frame *frame)
{
    static const double point[POINTS] = {0.1127016653792583, 0.5, 0.8872983346207417},
                        weight[POINTS] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    const double middle[3] = {0.5, 0.5, 0.5};
    double gradient[CORNERS][3], whole = 0;
    frame->determinant = pliant_cube_gradients(frame->x, middle, gradient);
    /* A local coordinate is the sum of the shape functions of the corners where it is 1. */
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

static void add_dilation(const cube_frame *frame, const double at[3], double gradient[ENHANCED][3], double weight,
                         double *out)
{
    double change[MODES];
    for (int i = 0; i < MODES; i++) change[i] = i < UNKNOWNS ? frame->dilation[0][i] : gradient[i / 3][i % 3];
    for (int i = 0; i < UNKNOWNS; i++)
        for (int d = 0; d < 3; d++) change[i] += (at[d] - 0.5) * frame->dilation[1 + d][i];
    for (int i = 0; i < MODES; i++)
        for (int j = 0; j < MODES; j++) out[MODES * i + j] += weight * change[i] * change[j];
}

/* Integrate over one tetrahedron with the collapsed Gauss points of the cube (Stroud 1971). The rule is exact for
 * products of gradients in a box. */
static void integrate_slot(cube_frame *frame, const int corners[4], double *deviatoric, double *dilation,
                           double *volume, double mean[UNKNOWNS], double load[CORNERS])
{
    static const double point[POINTS] = {0.1127016653792583, 0.5, 0.8872983346207417},
                        weight[POINTS] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    double corner[4][3], edge[9];
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) corner[v][d] = corners[v] >> d & 1;
    for (int m = 0; m < 9; m++) edge[m] = corner[1 + m / 3][m % 3] - corner[0][m % 3];
    double six =
        fabs(edge[0] * (edge[4] * edge[8] - edge[5] * edge[7]) - edge[1] * (edge[3] * edge[8] - edge[5] * edge[6]) +
             edge[2] * (edge[3] * edge[7] - edge[4] * edge[6]));
    for (int p = 0; p < POINTS * POINTS * POINTS; p++) {
        double u = point[p % POINTS], v = point[p / POINTS % POINTS], w = point[p / POINTS / POINTS];
        double b[4] = {0, u, (1 - u) * v, (1 - u) * (1 - v) * w}, at[3] = {0, 0, 0}, gradient[ENHANCED][3];
        b[0] = 1 - b[1] - b[2] - b[3];
        for (int c = 0; c < 4; c++)
            for (int d = 0; d < 3; d++) at[d] += b[c] * corner[c][d];
        double part = weight[p % POINTS] * weight[p / POINTS % POINTS] * weight[p / POINTS / POINTS] * (1 - u) *
                      (1 - u) * (1 - v) * six;
        part *= fabs(gradients_at(frame, at, gradient));
        add_deviatoric(gradient, part, deviatoric);
        add_dilation(frame, at, gradient, part, dilation);
        *volume += part;
        for (int i = 0; i < UNKNOWNS; i++) mean[i] += part * gradient[i / 3][i % 3];
        for (int c = 0; c < CORNERS; c++)
            load[c] += part * (c & 1 ? at[0] : 1 - at[0]) * (c & 2 ? at[1] : 1 - at[1]) * (c & 4 ? at[2] : 1 - at[2]);
    }
}

/* Return the position of a corner relative to the first corner. Without moved nodes it is computed from the lattice, so
 * that all cubes are bitwise identical. */
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
        integrate_slot(&frame, corners, out->deviatoric[slot], out->dilation[slot], &out->volume[slot], out->mean,
                       out->load[slot]);
        whole += out->volume[slot];
    }
    for (int i = 0; i < UNKNOWNS; i++) out->mean[i] /= whole;
}

void pliant_cube_moduli(const pliant_cube *cube, const double volume[5], const pliant_tet_material *material,
                        double lambda[5], double mu[5])
{
    const double minimum = cube->part ? 0 : filler;
    double min_mu = 0, min_lambda = 0, whole = 0;
    for (int slot = 0; slot < 5; slot++) {
        whole += volume[slot];
        min_mu += minimum * volume[slot] * material[cube->tet[slot]].mu;
        min_lambda += minimum * volume[slot] * material[cube->tet[slot]].lambda;
    }
    for (int slot = 0; slot < 5; slot++) {
        mu[slot] = fmax(material[cube->tet[slot]].mu, min_mu / whole);
        lambda[slot] = fmax(material[cube->tet[slot]].lambda, min_lambda / whole);
    }
}

/* Condense the incompatible modes. Return false if they have no stiffness. */
static bool condense(const double *k, double *out)
{
    enum { INNER = MODES - UNKNOWNS };
    double inner[INNER * INNER], outer[INNER * UNKNOWNS], answer[INNER * UNKNOWNS];
    for (int m = 0; m < INNER; m++) {
        for (int n = 0; n < INNER; n++) inner[INNER * m + n] = k[MODES * (UNKNOWNS + m) + UNKNOWNS + n];
        for (int i = 0; i < UNKNOWNS; i++)
            answer[UNKNOWNS * m + i] = outer[UNKNOWNS * m + i] = k[MODES * (UNKNOWNS + m) + i];
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

double pliant_cube_missing_lambda(const pliant_cube *cube, const double volume[5],
                                  const pliant_tet_material *material, const pliant_tet_material *complete)
{
    double lambda[5], all[5], mu[5], sum = 0, whole = 0;
    if (!complete) return 0;
    pliant_cube_moduli(cube, volume, material, lambda, mu);
    pliant_cube_moduli(cube, volume, complete, all, mu);
    for (int slot = 0; slot < 5; slot++) {
        sum += volume[slot] * (all[slot] - lambda[slot]);
        whole += volume[slot];
    }
    return sum / whole;
}

double pliant_cube_deviatoric(const pliant_cube_shape *shape, const pliant_cube *cube,
                              const pliant_tet_material *material, double missing_lambda, double *out)
{
    double lambda[5], mu[5], bulk = 0, missing = 0, k[MODES * MODES] = {0}, bending[UNKNOWNS * UNKNOWNS];
    pliant_cube_moduli(cube, shape->volume, material, lambda, mu);
    memset(out, 0, UNKNOWNS * UNKNOWNS * sizeof *out);
    for (int slot = 0; slot < 5; slot++) {
        const double kappa = lambda[slot] + 2.0 / 3 * mu[slot];
        bulk += shape->volume[slot] * kappa;
        missing += shape->volume[slot] * missing_lambda;
        for (int i = 0; i < UNKNOWNS * UNKNOWNS; i++)
            out[i] += mu[slot] * shape->deviatoric[slot][i / UNKNOWNS * MODES + i % UNKNOWNS];
        for (int i = 0; i < MODES * MODES; i++)
            k[i] += mu[slot] * shape->deviatoric[slot][i] + (kappa + missing_lambda) * shape->dilation[slot][i];
    }
    if (!condense(k, bending)) return bulk;
    for (int i = 0; i < UNKNOWNS; i++)
        for (int j = 0; j < UNKNOWNS; j++)
            out[UNKNOWNS * i + j] +=
                enhanced * (bending[UNKNOWNS * i + j] - (bulk + missing) * shape->mean[i] * shape->mean[j] -
                            out[UNKNOWNS * i + j]);
    return bulk;
}

static void stiffness_of(const pliant_cube_shape *shape, const pliant_cube *cube, const pliant_tet_material *material,
                         const pliant_tet_material *complete, double *out)
{
    const double missing = pliant_cube_missing_lambda(cube, shape->volume, material, complete);
    const double bulk = pliant_cube_deviatoric(shape, cube, material, missing, out);
    for (int i = 0; i < UNKNOWNS; i++)
        for (int j = 0; j < UNKNOWNS; j++) out[UNKNOWNS * i + j] += bulk * shape->mean[i] * shape->mean[j];
}

/* ---- Macro-elements. */

void pliant_cube_law(const pliant_cube *cube, const double volume[5], const pliant_tet_material *material,
                     pliant_macro_law *out)
{
    double lambda[5], mu[5];
    bool fills = true;
    pliant_cube_moduli(cube, volume, material, lambda, mu);
    *out = (pliant_macro_law){0, 0};
    for (int slot = 0; slot < 5; slot++) fills = fills && pliant_tet_fills(material + cube->tet[slot]);
    for (int slot = 0; slot < 5 && !fills; slot++) {
        out->lambda += volume[slot] * lambda[slot];
        out->mu += volume[slot] * mu[slot];
    }
}

pliant_status pliant_macros_keep(pliant_macros *macros, int32_t element, int32_t unknowns, const double *stiffness)
{
    double root[UNKNOWNS * UNKNOWNS];
    int32_t rank = macros->rank[element] = pliant_dense_root(unknowns, stiffness, root);
    macros->root[element] = NULL;
    if (rank == 0) return PLIANT_OK;
    size_t count = (size_t)rank * (size_t)unknowns;
    if (!(macros->root[element] = pliant_calloc(count, sizeof **macros->root)))
        return pliant_fail_memory("the hexahedra");
    for (size_t m = 0; m < count; m++) macros->root[element][m] = (float)root[m];
    return PLIANT_OK;
}

pliant_status pliant_macros_add_hexahedron(const pliant_tet_material *material, const pliant_tet_material *complete,
                                           const pliant_cube *cube, const pliant_cube_shape *shape,
                                           pliant_macros *macros, int32_t element)
{
    double k[UNKNOWNS * UNKNOWNS], shear = 0;
    for (int v = 0; v < CORNERS; v++) macros->own[8 * element + v] = cube->node[v];
    memcpy(macros->gradient + 24 * (size_t)element, shape->mean, sizeof shape->mean);
    stiffness_of(shape, cube, material, complete, k);
    for (int slot = 0; slot < 5; slot++) shear += shape->volume[slot] * material[cube->tet[slot]].mu;
    macros->shear[element] = shear;
    if (macros->law) pliant_cube_law(cube, shape->volume, material, macros->law + element);
    return pliant_macros_keep(macros, element, UNKNOWNS, k);
}

pliant_status pliant_macros_add_tet(const pliant_mesh *mesh, const pliant_tet_material *material, int32_t tet,
                                    pliant_macros *macros, int32_t element)
{
    double k[144];
    const double volume = pliant_mesh_gradients(mesh, tet, macros->gradient + 24 * (size_t)element);
    for (int v = 0; v < CORNERS; v++) macros->own[8 * element + v] = v < 4 ? mesh->tets[4 * tet + v] : -1;
    macros->shear[element] = volume * material[tet].mu;
    if (macros->law && !pliant_tet_fills(material + tet))
        macros->law[element] = (pliant_macro_law){volume * material[tet].lambda, volume * material[tet].mu};
    pliant_tet_stiffness(mesh, tet, material + tet, k);
    return pliant_macros_keep(macros, element, 12, k);
}

static pliant_status take_capacity(pliant_macros *macros, size_t count, size_t corners,
                                   void *(*take)(size_t count, size_t size))
{
    bool good =
        (macros->start = take(count + 1, sizeof *macros->start)) &&
        (macros->node = take(corners, sizeof *macros->node)) && (macros->held = take(corners, 1)) &&
        (macros->grounded = take(count, 1)) && (macros->own = take(count, 8 * sizeof *macros->own)) &&
        (macros->gradient = take(count, 24 * sizeof *macros->gradient)) &&
        (macros->cell = take(count, sizeof *macros->cell)) && (macros->shear = take(count, sizeof *macros->shear)) &&
        (macros->rank = take(count, sizeof *macros->rank)) && (macros->root = take(count, sizeof *macros->root));
    macros->count = good ? (int32_t)count : 0;
    return good ? PLIANT_OK : pliant_fail_memory("the hexahedra");
}

pliant_status pliant_macros_allocate(pliant_macros *macros, size_t count, size_t corners)
{
    return take_capacity(macros, count, corners, pliant_calloc);
}

pliant_status pliant_macros_allocate_law(pliant_macros *macros, pliant_elasticity law)
{
    if (law == PLIANT_ELASTICITY_COROTATIONAL) return PLIANT_OK;
    macros->law = pliant_calloc((size_t)macros->count, sizeof *macros->law);
    return macros->law ? PLIANT_OK : pliant_fail_memory("the hexahedra");
}

pliant_status pliant_macros_reserve_entries(pliant_macros *macros, size_t count, size_t corners)
{
    pliant_status status = take_capacity(macros, count, corners, pliant_malloc);
    macros->count = 0;
    if (status == PLIANT_OK) macros->start[0] = 0;
    return status;
}

int32_t pliant_macros_blocks(size_t count, size_t corners)
{
    const size_t for_forces = (corners + 4 * LANES - 1) / (4 * LANES), for_rotations = (count + LANES - 1) / LANES;
    return (int32_t)(for_forces > for_rotations ? for_forces : for_rotations);
}

/* Hexahedra from before the cut, by cell. */
typedef struct earlier_cubes {
    const pliant_macros *macros;
    const uint8_t *kept;      /* (tetrahedra) */
    int32_t *element;         /* (cells) 1 + first hexahedron; 0: none */
} earlier_cubes;

static pliant_status list_earlier(const pliant_system *before, const uint8_t *kept, int32_t cells, earlier_cubes *out)
{
    *out = (earlier_cubes){
        .macros = before->macros, .kept = kept, .element = pliant_calloc((size_t)cells, sizeof *out->element)};
    if (!out->element) return pliant_fail_memory("the hexahedra");
    for (int32_t e = out->macros->count - 1; e >= 0; e--)
        if (out->macros->start[e + 1] - out->macros->start[e] == CORNERS) out->element[out->macros->cell[e]] = e + 1;
    return PLIANT_OK;
}

/* Return the earlier element of a cube; -1: none, or its material has changed. */
static int32_t find_earlier(const earlier_cubes *earlier, int32_t cell, const pliant_cube *cube)
{
    const pliant_macros *macros = earlier->macros;
    for (int slot = 0; slot < 5; slot++)
        if (earlier->element[cell] == 0 || !earlier->kept[cube->tet[slot]]) return -1;
    for (int32_t e = earlier->element[cell] - 1;
         e < macros->count && macros->cell[e] == cell && macros->start[e + 1] - macros->start[e] == CORNERS; e++)
        if (memcmp(macros->own + CORNERS * (size_t)e, cube->node, sizeof cube->node) == 0) return e;
    return -1;
}

void pliant_macros_share_root(const pliant_macros *from, int32_t was, pliant_macros *macros, int32_t element)
{
    macros->rank[element] = from->rank[was];
    macros->root[element] = pliant_retain_block(from->root[was]);
}

static void copy_hexahedron(const pliant_macros *from, int32_t was, const pliant_cube *cube, pliant_macros *macros,
                            int32_t element)
{
    memcpy(macros->own + 8 * (size_t)element, cube->node, sizeof cube->node);
    memcpy(macros->gradient + 24 * (size_t)element, from->gradient + 24 * (size_t)was, 24 * sizeof *macros->gradient);
    macros->shear[element] = from->shear[was];
    if (macros->law) macros->law[element] = from->law[was];
    pliant_macros_share_root(from, was, macros, element);
}

/* Create the elements of each cell: its cubes, then the tetrahedra in no cube. */
static pliant_status fill(pliant_system *system, const pliant_tet_material *material,
                          const pliant_tet_material *complete, const pliant_cell_lists *lists,
                          const earlier_cubes *earlier)
{
    const pliant_mesh *mesh = system->mesh;
    pliant_macros *macros = system->macros;
    /* By parity: all cubes of a lattice without moved nodes are equal. */
    pliant_cube_shape *shape = pliant_calloc(2, sizeof *shape);
    bool known[2] = {false, false};
    pliant_status status = shape ? PLIANT_OK : pliant_fail_memory("the hexahedra");
    int32_t element = 0, corner = 0;
    for (int32_t cell = 0; status == PLIANT_OK && cell < lists->cells; cell++) {
        const int parity = pliant_cell_parity(mesh, cell);
        const int32_t cubes = pliant_cubes_of_cell(lists, cell);
        for (int32_t c = 0; status == PLIANT_OK && c < cubes; c++) {
            const pliant_cube *cube = lists->cube + c;
            if (!known[parity] || mesh->num_moved > 0) pliant_cube_integrate(mesh, cube, parity, &shape[parity]);
            known[parity] = true;
            const int32_t was = earlier ? find_earlier(earlier, cell, cube) : -1;
            if (was >= 0) copy_hexahedron(earlier->macros, was, cube, macros, element);
            else status = pliant_macros_add_hexahedron(material, complete, cube, &shape[parity], macros, element);
            memcpy(macros->node + corner, cube->node, sizeof cube->node);
            corner += CORNERS;
            macros->cell[element] = cell;
            macros->start[++element] = corner;
        }
        for (int32_t t = lists->first[cell]; status == PLIANT_OK && t >= 0; t = lists->next[t]) {
            if (pliant_cube_among(lists, cubes, t) >= 0) continue;
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

pliant_status pliant_system_build_hexahedra(pliant_system *system, const pliant_tet_material *material,
                                            const pliant_tet_material *complete, const pliant_system *before,
                                            const uint8_t *kept)
{
    pliant_cell_lists lists;
    earlier_cubes earlier = {0};
    pliant_status status = pliant_cell_lists_make(system->mesh, NULL, system->mesh->num_tets, &lists);
    size_t elements = 0, corners = 0;
    for (int32_t cell = 0; status == PLIANT_OK && cell < lists.cells; cell++) {
        const size_t cubes = (size_t)pliant_cubes_of_cell(&lists, cell), tets = (size_t)lists.count[cell] - 5 * cubes;
        elements += cubes + tets;
        corners += CORNERS * cubes + 4 * tets;
    }
    if (status == PLIANT_OK && !(system->macros = pliant_calloc(1, sizeof *system->macros)))
        status = pliant_fail_memory("the hexahedra");
    if (status == PLIANT_OK) status = pliant_macros_allocate(system->macros, elements, corners);
    if (status == PLIANT_OK) status = pliant_macros_allocate_law(system->macros, system->law);
    if (status == PLIANT_OK && kept) status = list_earlier(before, kept, lists.cells, &earlier);
    if (status == PLIANT_OK) status = fill(system, material, complete, &lists, kept ? &earlier : NULL);
    pliant_free(earlier.element);
    system->num_blocks = pliant_macros_blocks(elements, corners);
    pliant_cell_lists_free(&lists);
    return status;
}

/* Find the elements of a lattice that may have been cut. */
static pliant_status elements_of_lists(const pliant_mesh *mesh, int32_t *next, int32_t *element)
{
    pliant_cell_lists lists;
    pliant_status status = pliant_cell_lists_make(mesh, NULL, mesh->num_tets, &lists);
    for (int32_t cell = 0; status == PLIANT_OK && cell < lists.cells; cell++) {
        const int32_t cubes = pliant_cubes_of_cell(&lists, cell), begin = next[cell];
        next[cell] += cubes;
        for (int32_t t = lists.first[cell]; t >= 0; t = lists.next[t]) {
            const int32_t c = pliant_cube_among(&lists, cubes, t);
            element[t] = c >= 0 ? begin + c : next[cell]++;
        }
    }
    pliant_cell_lists_free(&lists);
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
    pliant_status status = PLIANT_OK;
    if (mesh->lattice_of_tet) status = elements_of_lists(mesh, next, element);
    for (int32_t t = 0; !mesh->lattice_of_tet && t < mesh->num_tets; t++) {
        const int32_t cell = pliant_cell_of_tet(mesh, t);
        element[t] = next[cell];
        /* A cube's tetrahedra are in its list order. */
        next[cell] += macros->start[next[cell] + 1] - macros->start[next[cell]] == 4;
    }
    pliant_free(next);
    if (status == PLIANT_OK) return PLIANT_OK;
    pliant_free(element);
    *out = NULL;
    return status;
}

pliant_status pliant_system_cubes(pliant_system *system)
{
    const pliant_mesh *mesh = system->mesh;
    const int32_t cells = mesh->cells[0] * mesh->cells[1] * mesh->cells[2], nx = mesh->cells[0] + 1,
                  ny = mesh->cells[1] + 1;
    size_t count = (size_t)mesh->num_tets / 5;
    pliant_macros *macros = system->macros = pliant_calloc(1, sizeof *macros);
    if (!macros || !(macros->start = pliant_calloc(count + 1, sizeof *macros->start)) ||
        !(macros->node = pliant_calloc(CORNERS * count, sizeof *macros->node)) ||
        !(macros->cell = pliant_calloc(count, sizeof *macros->cell)))
        return pliant_fail_memory("the hexahedra");
    for (int32_t cell = 0; cell < cells; cell++) {
        if (mesh->tet_of_lattice[5 * (size_t)cell] < 0) continue;
        int32_t i = cell % mesh->cells[0], j = cell / mesh->cells[0] % mesh->cells[1],
                k = cell / mesh->cells[0] / mesh->cells[1];
        for (int v = 0; v < CORNERS; v++)
            macros->node[CORNERS * macros->count + v] =
                mesh->node_of_lattice[i + (v & 1) + nx * (j + (v >> 1 & 1) + ny * (k + (v >> 2)))];
        macros->cell[macros->count++] = cell;
        macros->start[macros->count] = CORNERS * macros->count;
    }
    system->num_blocks = (macros->count + LANES - 1) / LANES;
    return PLIANT_OK;
}
