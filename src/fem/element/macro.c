/* Macro-elements in a step: forces, rotations, matrix, and upsampling of the fine nodes. */
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/element/macro_element.h"
#include "fem/element/neo_hookean.h"
#include "fem/element/rotation.h"
#include "fem/system.h"
#include "base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Compute the rotations of a block of cubes. A separate function lets the compiler vectorize it. */
PLIANT_VECTORIZED static void rotations_of(double f[9][LANES], double out[9][LANES]) { pliant_rotations(f, out); }

static const double *rest_of(const pliant_system *system)
{
    return system->macros->rest ? system->macros->rest : system->mesh->rest;
}

/* Compute the frames of cubes [first, first + LANES), and their deformation gradients f and rotations r. */
static void deform(const pliant_system *system, const double *x, int32_t first, pliant_macro_frame out[LANES],
                   double f[9][LANES], double r[9][LANES])
{
    const pliant_macros *macros = system->macros;
    for (int l = 0; l < LANES; l++) {
        int32_t cube = first + l;
        double one[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
        if (cube < macros->count)
            pliant_macro_find_frame(macros->own + 8 * (size_t)cube, macros->gradient + 24 * (size_t)cube, x,
                                    rest_of(system), one, out + l);
        for (int m = 0; m < 9; m++) f[m][l] = cube >= macros->count || macros->grounded[cube] ? m % 4 == 0 : one[m];
    }
    rotations_of(f, r);
    for (int l = 0; l < LANES; l++)
        for (int m = 0; m < 9; m++) out[l].rotation[m] = r[m][l];
}

static void frames_of(const pliant_system *system, const double *x, int32_t first, pliant_macro_frame out[LANES])
{
    double f[9][LANES], r[9][LANES];
    deform(system, x, first, out, f, r);
}

PLIANT_VECTORIZED static void additions_of(double f[9][LANES], double r[9][LANES], double lame[2][LANES],
                                           double out[9][LANES])
{
    for (int l = 0; l < LANES; l++) {
        double deformation[9], rotation[9], stress[9];
        for (int m = 0; m < 9; m++) deformation[m] = f[m][l], rotation[m] = r[m][l];
        pliant_neo_hookean_addition(deformation, rotation, lame[0][l], lame[1][l], stress);
        for (int m = 0; m < 9; m++) out[m][l] = stress[m];
    }
}

/* Compute the additional stresses of the neo-Hookean law, for elements [first, first + LANES). */
static void find_additions(const pliant_macros *macros, int32_t first, double f[9][LANES], double r[9][LANES],
                           double out[9][LANES])
{
    double lame[2][LANES];
    for (int l = 0; l < LANES; l++) {
        const pliant_macro_law *law = macros->law + (first + l < macros->count ? first + l : first);
        lame[0][l] = law->lambda, lame[1][l] = law->mu;
    }
    additions_of(f, r, lame, out);
}

/* Add a stress to the forces of an element, whose corners are its own nodes. out: (corners x 3). */
static void add_stress(const pliant_macros *macros, int32_t cube, double stress[9][LANES], int lane, double *out)
{
    double one[9];
    for (int m = 0; m < 9; m++) one[m] = stress[m][lane];
    for (int32_t v = 0; v < macros->start[cube + 1] - macros->start[cube]; v++)
        pliant_add_product(one, macros->gradient + 24 * (size_t)cube + 3 * v, out + 3 * v);
}

/* Compute q of every corner of a cube. */
static void corners_in_frame(const pliant_system *system, const double *x, int32_t cube,
                             const pliant_macro_frame *frame, double *q)
{
    const pliant_macros *macros = system->macros;
    const double *rest = rest_of(system);
    for (int32_t c = macros->start[cube]; c < macros->start[cube + 1]; c++, q += 3)
        pliant_macro_corner(frame, macros->held[c], x + 3 * macros->node[c], rest + 3 * macros->node[c], q);
}

/* Compute f = root' (root q), n numbers; each row is read once. */
static inline __attribute__((always_inline)) void apply_rows(int32_t rank, int32_t n, const float *root,
                                                             const double *q, double *f)
{
    for (int32_t i = 0; i < n; i++) f[i] = 0;
    for (int32_t m = 0; m < rank; m++, root += n) {
        double sum[LANES] = {0}, whole = 0;
        int32_t i = 0;
        for (; i + LANES <= n; i += LANES)
            for (int l = 0; l < LANES; l++) sum[l] += (double)root[i + l] * q[i + l];
        for (int l = 0; l < LANES; l++) whole += sum[l];
        for (; i < n; i++) whole += (double)root[i] * q[i];
        for (i = 0; i < n; i++) f[i] += (double)root[i] * whole;
    }
}

PLIANT_VECTORIZED static void apply_root(int32_t rank, int32_t n, const float *root, const double *q, double *f)
{
    if (n == 24) apply_rows(rank, 24, root, q, f); /* with a constant size, a hexahedron's values stay in registers */
    else apply_rows(rank, n, root, q, f);
}

void pliant_macro_forces(const pliant_system *system, const double *positions, double *forces)
{
    const pliant_macros *macros = system->macros;
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t first = 0; first < macros->count; first += LANES) {
        double q[3 * PLIANT_MAX_CORNERS], f[3 * PLIANT_MAX_CORNERS];
        double deformations[9][LANES], rotations[9][LANES], additions[9][LANES];
        pliant_macro_frame frames[LANES];
        deform(system, positions, first, frames, deformations, rotations);
        if (macros->law) find_additions(macros, first, deformations, rotations, additions);
        for (int32_t cube = first; cube < first + LANES && cube < macros->count; cube++) {
            double *out = forces + 3 * (size_t)macros->start[cube];
            int32_t n = 3 * (macros->start[cube + 1] - macros->start[cube]);
            corners_in_frame(system, positions, cube, &frames[cube - first], q);
            apply_root(macros->rank[cube], n, macros->root[cube], q, f);
            for (int32_t i = 0; i < n; i += 3) pliant_macro_turn(frames[cube - first].rotation, f + i, out + i);
            if (macros->law) add_stress(macros, cube, additions, cube - first, out);
        }
    }
}

void pliant_macro_gather(const pliant_system *system, const double *forces, double *out)
{
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t n = 0; n < system->num_free; n++) {
        double sum[3] = {0, 0, 0};
        for (int32_t c = system->corner_start[n]; c < system->corner_end[n]; c++)
            for (int d = 0; d < 3; d++) sum[d] += forces[3 * (size_t)system->corner[c] + (size_t)d];
        memcpy(out + 3 * n, sum, sizeof sum);
    }
}

void pliant_macro_tangents(const pliant_system *system, const double *positions, pliant_tangent *tangents)
{
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t first = 0; first < system->macros->count; first += LANES) {
        pliant_macro_frame frames[LANES];
        frames_of(system, positions, first, frames);
        for (int l = 0; l < LANES; l++)
            for (int m = 0; m < 9; m++) tangents[first / LANES].rotation[m][l] = frames[l].rotation[m];
    }
}

void pliant_macro_multiply(const pliant_system *system, const pliant_tangent *tangents, const double *x, double *y)
{
    const pliant_macros *macros = system->macros;
    for (int32_t e = 0; e < macros->count; e++) {
        const int32_t begin = macros->start[e], n = 3 * (macros->start[e + 1] - begin), *node = macros->node + begin;
        double r[9], back[9], q[3 * PLIANT_MAX_CORNERS], f[3 * PLIANT_MAX_CORNERS];
        if (macros->rank[e] == 0) continue;
        for (int m = 0; m < 9; m++) back[3 * (m % 3) + m / 3] = r[m] = tangents[e / LANES].rotation[m][e % LANES];
        for (int32_t i = 0; i < n; i += 3) pliant_macro_turn(back, x + 3 * node[i / 3], q + i);
        apply_root(macros->rank[e], n, macros->root[e], q, f);
        for (int32_t i = 0; i < n; i += 3) {
            double force[3];
            pliant_macro_turn(r, f + i, force);
            for (int d = 0; d < 3; d++) y[3 * node[i / 3] + d] += force[d];
        }
    }
}

/* ---- the matrix */

static void list_corners(const pliant_system *system)
{
    const pliant_macros *macros = system->macros;
    const int32_t corners = macros->start[macros->count];
    int32_t *start = system->corner_start;
    for (int pass = 0; pass < 2; pass++) {
        for (int32_t c = 0; c < corners; c++) {
            int32_t n = system->free_of_node[macros->node[c]];
            if (n < 0) continue;
            if (pass == 0) start[n + 2]++;
            else system->corner[start[n + 1]++] = c;
        }
        for (int32_t n = 0; pass == 0 && n < system->num_free; n++) start[n + 2] += start[n + 1];
    }
    memcpy(system->corner_end, start + 1, (size_t)system->num_free * sizeof *start);
}

static int ascending(const void *a, const void *b)
{
    int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}

/* List the unknowns >= column that share a cube with it, ascending. rows: (num_free) out; last_column: (num_free) last
 * column that listed each unknown, + 1. Return their number. */
static int32_t rows_of(const pliant_system *system, const int32_t *cube_of_corner, int32_t column, int32_t *last_column,
                       int32_t *rows)
{
    const pliant_macros *macros = system->macros;
    int32_t count = 0;
    for (int32_t e = system->corner_start[column]; e < system->corner_end[column]; e++) {
        int32_t cube = cube_of_corner[system->corner[e]];
        for (int32_t c = macros->start[cube]; c < macros->start[cube + 1]; c++) {
            int32_t row = system->free_of_node[macros->node[c]];
            if (row < column || last_column[row] == column + 1) continue;
            last_column[row] = column + 1;
            rows[count++] = row;
        }
    }
    qsort(rows, (size_t)count, sizeof *rows, ascending);
    return count;
}

static void find_cubes_of_corners(const pliant_macros *macros)
{
    for (int32_t cube = 0; cube < macros->count; cube++)
        for (int32_t c = macros->start[cube]; c < macros->start[cube + 1]; c++) macros->cube_of_corner[c] = cube;
}

pliant_status pliant_macro_number(pliant_system *system)
{
    pliant_macros *macros = system->macros;
    const size_t corners = (size_t)macros->start[macros->count], nodes = (size_t)system->num_free;
    const bool known = macros->cube_of_corner != NULL;
    const int threads = system->num_threads < 2 ? system->num_threads : 2;
    system->corner_start = pliant_calloc(nodes + 2, sizeof *system->corner_start);
    system->corner_end = pliant_malloc(nodes, sizeof *system->corner_end);
    system->corner = pliant_malloc(corners, sizeof *system->corner);
    if (!known) macros->cube_of_corner = pliant_malloc(corners, sizeof *macros->cube_of_corner);
    if (!system->corner_start || !system->corner_end || !system->corner || !macros->cube_of_corner)
        return pliant_fail_memory("the unknowns");
#pragma omp parallel sections num_threads(threads)
    {
#pragma omp section
        list_corners(system);
#pragma omp section
        if (!known) find_cubes_of_corners(macros);
    }
    system->num_corners = system->corner_start[nodes];
    return PLIANT_OK;
}

pliant_status pliant_macro_find_pattern(pliant_system *system)
{
    pliant_pattern *pattern = &system->pattern;
    pliant_status status = PLIANT_OK;
    size_t free_nodes = (size_t)system->num_free;
    const int32_t *cubes = system->macros->cube_of_corner;
    int32_t *last_column = pliant_calloc(free_nodes, sizeof *last_column),
            *rows = pliant_calloc(free_nodes, sizeof *rows);
    pattern->num_columns = system->num_free;
    pattern->start = pliant_calloc(free_nodes + 1, sizeof *pattern->start);
    bool good = last_column && rows && pattern->start;
    for (int pass = 0; pass < 2 && good; pass++) {
        int64_t count = 0;
        memset(last_column, 0, free_nodes * sizeof *last_column);
        for (int32_t column = 0; column < system->num_free; column++) {
            int32_t height = rows_of(system, cubes, column, last_column, rows);
            if (pass == 1) memcpy(pattern->row + count, rows, (size_t)height * sizeof *rows);
            count += height;
            if (9 * count > INT32_MAX) {
                status = pliant_fail(
                    PLIANT_ERROR_SCENE,
                    "the matrix has too many entries: reduce mesh/coarse_cells, or model/lod_layers with lod");
                goto done;
            }
            pattern->start[column + 1] = (int32_t)count;
        }
        pattern->num_blocks = (int32_t)count;
        pattern->num_values = 9 * count - 3 * (int64_t)system->num_free;
        if (pass == 0) good = (pattern->row = pliant_calloc((size_t)count, sizeof *pattern->row)) != NULL;
    }
    if (!good) status = pliant_fail_memory("the pattern of the matrix");
done:
    pliant_free(last_column);
    pliant_free(rows);
    return status;
}

/* Compute the column block of root' root for one corner: out (3 x n). */
PLIANT_VECTORIZED static void root_column(int32_t rank, int32_t n, const float *root, int32_t corner, double *out)
{
    for (int32_t i = 0; i < 3 * n; i++) out[i] = 0;
    for (int32_t m = 0; m < rank; m++, root += n)
        for (int d = 0; d < 3; d++) {
            double factor = root[3 * corner + d];
            for (int32_t i = 0; i < n; i++) out[(int64_t)d * n + i] += factor * (double)root[i];
        }
}

/* Compute R block R', with the block (3 x 3) at (a, b) of a column block. */
static void turned_block(const double r[9], const double *column, int32_t n, int32_t corner, double out[9])
{
    double left[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double *k = column + (int64_t)j * n + 3 * corner;
            left[3 * i + j] = r[3 * i] * k[0] + r[3 * i + 1] * k[1] + r[3 * i + 2] * k[2];
        }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = left[3 * i] * r[3 * j] + left[3 * i + 1] * r[3 * j + 1] + left[3 * i + 2] * r[3 * j + 2];
}

void pliant_macro_column(const pliant_system *system, const pliant_tangent *tangents, int32_t corner, double *blocks)
{
    const pliant_macros *macros = system->macros;
    int32_t cube = macros->cube_of_corner[corner], at = corner - macros->start[cube],
            n = 3 * (macros->start[cube + 1] - macros->start[cube]);
    double k[9 * PLIANT_MAX_CORNERS], r[9];
    for (int m = 0; m < 9; m++) r[m] = tangents[cube / LANES].rotation[m][cube % LANES];
    if (system->stiffness)
        /* The stiffness is symmetric, so rows replace columns. */
        memcpy(k, system->stiffness + (size_t)n * ((size_t)n * (size_t)cube + 3 * (size_t)at),
               3 * (size_t)n * sizeof *k);
    else
        root_column(macros->rank[cube], n, macros->root[cube], at, k);
    for (int32_t a = 0; a < n / 3; a++) turned_block(r, k, n, a, blocks + 9 * a);
}

/* Add the contribution of one corner to its column of the matrix. */
static void add_column(const pliant_system *system, const pliant_tangent *tangents, int32_t column, int32_t corner,
                       double *values)
{
    const pliant_macros *macros = system->macros;
    const pliant_pattern *pattern = &system->pattern;
    int32_t cube = macros->cube_of_corner[corner], begin = macros->start[cube], count = macros->start[cube + 1] - begin;
    int32_t first = pattern->start[column], height = pattern->start[column + 1] - first;
    double blocks[9 * PLIANT_MAX_CORNERS];
    double *out[3]; /* scalar columns 3j, 3j+1, 3j+2 hold 3h, 3h-1, 3h-2 numbers */
    out[0] = values + 9 * (int64_t)first - 3 * (int64_t)column;
    out[1] = out[0] + 3 * height - 1;
    out[2] = out[1] + 3 * height - 2;
    pliant_macro_column(system, tangents, corner, blocks);
    for (int32_t a = 0; a < count; a++) {
        int32_t row = system->free_of_node[macros->node[begin + a]];
        if (row < column) continue;
        const int32_t *found = bsearch(&row, pattern->row + first, (size_t)height, sizeof *found, ascending);
        int32_t place = 3 * (int32_t)(found - (pattern->row + first));
        for (int c = 0; c < 3; c++)
            for (int d = place == 0 ? c : 0; d < 3; d++) out[c][place + d] += blocks[9 * a + 3 * d + c];
    }
}

void pliant_macro_assemble(const pliant_system *system, const pliant_tangent *tangents, double *values)
{
    memset(values, 0, (size_t)system->pattern.num_values * sizeof *values);
#pragma omp parallel for schedule(dynamic, 4) num_threads(system->num_threads)
    for (int32_t column = 0; column < system->num_free; column++)
        for (int32_t e = system->corner_start[column]; e < system->corner_end[column]; e++)
            add_column(system, tangents, column, system->corner[e], values);
}

double pliant_macro_operations(const pliant_system *system)
{
    const pliant_macros *macros = system->macros;
    double sum = 0;
    for (int32_t cube = 0; cube < macros->count; cube++) {
        double n = 3.0 * (macros->start[cube + 1] - macros->start[cube]);
        sum += 2 * macros->rank[cube] * n * n;
    }
    return sum;
}

/* If a cube has a node at two corners, the trace includes the blocks between them. */
double pliant_macro_trace(const pliant_macros *macros, const int32_t *free_of_node, int32_t element)
{
    const int32_t begin = macros->start[element], end = macros->start[element + 1], n = 3 * (end - begin);
    double sum = 0;
    for (int32_t a = begin; a < end; a++) {
        if (free_of_node[macros->node[a]] < 0) continue;
        for (int32_t b = begin; b < end; b++) {
            if (macros->node[b] != macros->node[a]) continue;
            const float *at = macros->root[element] + 3 * (a - begin), *other = macros->root[element] + 3 * (b - begin);
            for (int32_t m = 0; m < macros->rank[element]; m++)
                for (int32_t d = n * m; d < n * m + 3; d++) sum += (double)at[d] * other[d];
        }
    }
    return sum;
}

double pliant_macro_mean_diagonal(const pliant_system *system)
{
    const pliant_macros *macros = system->macros;
    double sum = 0, *trace = system->trace;
    for (int32_t e = 0; e < macros->count; e++) {
        if (macros->rank[e] == 0) continue;
        if (trace && trace[e] < 0) trace[e] = pliant_macro_trace(macros, system->free_of_node, e);
        sum += trace ? trace[e] : pliant_macro_trace(macros, system->free_of_node, e);
    }
    return sum / (3.0 * system->num_free);
}

/* ---- the fine nodes */

void pliant_macro_positions(const pliant_system *system, const double *solved, double *fine)
{
    const pliant_macros *macros = system->macros;
    memcpy(fine, system->fine->rest, 3 * (size_t)system->fine->num_nodes * sizeof *fine);
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t first = 0; first < macros->count; first += LANES) {
        double q[3 * PLIANT_MAX_CORNERS];
        pliant_macro_frame frames[LANES];
        frames_of(system, solved, first, frames);
        for (int32_t cube = first; cube < first + LANES && cube < macros->count; cube++) {
            const pliant_macro_frame *frame = frames + (cube - first);
            corners_in_frame(system, solved, cube, frame, q);
            for (int32_t i = macros->fine_start[cube]; i < macros->fine_start[cube + 1]; i++) {
                const int32_t *entries = macros->entry_start[cube] + (i - macros->fine_start[cube]);
                double w[3];
                pliant_macro_shaped(entries[0], entries[1], macros->entry_corner[cube], macros->entry_shape[cube], q,
                                    w);
                pliant_macro_follow(frame, macros->grounded[cube], w, fine + 3 * macros->fine[i]);
            }
        }
    }
}

/* ---- derivative of a fine node's position (NUMERICS.md) */

/* Compute (tr(S) I - S)^-1 of S = R'F. It is bounded in cubes that are nearly flat. */
static void invert_stretch(const double f[9], const double r[9], double out[9])
{
    const double minimum = 0.2; /* of the sum of two stretches, as in elements.c */
    double s[9], matrix[9], values[3], vectors[9];
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) s[3 * a + b] = r[a] * f[b] + r[3 + a] * f[3 + b] + r[6 + a] * f[6 + b];
    for (int m = 0; m < 9; m++)
        matrix[m] = (m % 4 == 0 ? s[0] + s[4] + s[8] : 0) - 0.5 * (s[m] + s[3 * (m % 3) + m / 3]);
    pliant_symmetric_eigen(matrix, values, vectors);
    memset(out, 0, 9 * sizeof *out);
    for (int m = 0; m < 9; m++)
        for (int k = 0; k < 3; k++)
            out[m] += vectors[m - m % 3 + k] * vectors[3 * (m % 3) + k] / fmax(values[k], minimum);
}

/* out = a b */
static void multiply(const double a[9], const double b[9], double out[9])
{
    for (int m = 0; m < 9; m++)
        out[m] = a[m - m % 3] * b[m % 3] + a[m - m % 3 + 1] * b[3 + m % 3] + a[m - m % 3 + 2] * b[6 + m % 3];
}

/* Compute the motion of a fine node by a small rotation w of its cube: R (w x y - N (w x y_c)). The corners stay.
 * Here y and y_c are the positions of the node and the corners in the cube's frame.
 * @param entries  first entry of the node, and end
 * @param out      (3 x 3), to be multiplied by w */
static void motion_by_turn(const pliant_system *system, const double *solved, int32_t cube, int32_t fine_node,
                           const pliant_macro_frame *frame, const int32_t entries[2], double out[9])
{
    const pliant_macros *macros = system->macros;
    double motion[9] = {0}, y[3];
    for (int d = 0; d < 3; d++) y[d] = system->fine->rest[3 * (size_t)fine_node + (size_t)d] - frame->rest_centre[d];
    for (int32_t e = entries[0]; e < entries[1]; e++) {
        const int32_t corner = macros->start[cube] + macros->entry_corner[cube][e];
        const double *rest = rest_of(system) + 3 * macros->node[corner];
        const float *n = macros->entry_shape[cube] + 9 * (size_t)e;
        double q[3];
        pliant_macro_corner(frame, macros->held[corner], solved + 3 * macros->node[corner], rest, q);
        for (int d = 0; d < 3; d++) y[d] += n[3 * d] * q[0] + n[3 * d + 1] * q[1] + n[3 * d + 2] * q[2];
        for (int d = 0; d < 3 && !macros->held[corner]; d++) q[d] += rest[d] - frame->rest_centre[d];
        for (int i = 0; i < 9; i += 3) {
            motion[i] += n[i + 1] * q[2] - n[i + 2] * q[1];
            motion[i + 1] += n[i + 2] * q[0] - n[i] * q[2];
            motion[i + 2] += n[i] * q[1] - n[i + 1] * q[0];
        }
    }
    const double cross[9] = {0, y[2], -y[1], -y[2], 0, y[0], y[1], -y[0], 0};
    for (int m = 0; m < 9; m++) motion[m] += cross[m];
    multiply(frame->rotation, motion, out);
}

/* Add the motion of a fine node by the rotation of its cube: w = (tr(S) I - S)^-1 sum of g_v x R' dx_v. */
static void add_turn(const pliant_macros *macros, int32_t cube, const int32_t *free_of_node, double weight,
                     const double by_turn[9], const double f[9], const double r[9], pliant_weight_blocks *blocks)
{
    const double back[9] = {r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]};
    double inverse[9], scaled[9];
    invert_stretch(f, r, inverse);
    multiply(by_turn, inverse, scaled);
    for (size_t v = 8 * (size_t)cube; v < 8 * (size_t)cube + 8; v++) {
        const int32_t unknown = macros->own[v] < 0 ? -1 : free_of_node[macros->own[v]];
        const double *g = macros->gradient + 3 * v;
        const double cross[9] = {0, -g[2], g[1], g[2], 0, -g[0], -g[1], g[0], 0};
        double turn[9], block[9], *out = unknown < 0 ? NULL : pliant_weight_blocks_at(blocks, unknown);
        multiply(cross, back, turn);
        multiply(scaled, turn, block);
        for (int m = 0; m < 9 && out; m++) out[m] += weight * block[m];
    }
}

void pliant_macro_weights(const pliant_system *system, const double *solved, int32_t fine_node, double weight,
                          pliant_weight_blocks *blocks)
{
    const pliant_macros *macros = system->macros;
    int32_t cube = macros->cube_of_fine[fine_node];
    if (cube < 0) return;
    const int32_t *first = macros->fine + macros->fine_start[cube];
    size_t count = (size_t)(macros->fine_start[cube + 1] - macros->fine_start[cube]);
    const int32_t *found = bsearch(&fine_node, first, count, sizeof *found, ascending);
    int32_t index = (int32_t)(found - first);
    pliant_macro_frame frames[LANES];
    double deformations[9][LANES], rotations[9][LANES], f[9];
    deform(system, solved, cube - cube % LANES, frames, deformations, rotations);
    for (int m = 0; m < 9; m++) f[m] = deformations[m][cube % LANES];
    const double *r = frames[cube % LANES].rotation;
    const int32_t *entries = macros->entry_start[cube] + index;
    if (!macros->grounded[cube]) {
        double by_turn[9];
        motion_by_turn(system, solved, cube, fine_node, frames + cube % LANES, entries, by_turn);
        add_turn(macros, cube, system->free_of_node, weight, by_turn, f, r, blocks);
    }
    /* with constant rotation: R N R'; the N of free corners sum to the identity, so the center adds nothing */
    for (int32_t e = entries[0]; e < entries[1]; e++) {
        int32_t unknown = system->free_of_node[macros->node[macros->start[cube] + macros->entry_corner[cube][e]]];
        const float *n = macros->entry_shape[cube] + 9 * (size_t)e;
        double *out = unknown >= 0 ? pliant_weight_blocks_at(blocks, unknown) : NULL;
        for (int i = 0; i < 3 && out; i++)
            for (int j = 0; j < 3; j++) {
                double turned = 0;
                for (int k = 0; k < 3; k++)
                    for (int l = 0; l < 3; l++) turned += r[3 * i + k] * n[3 * k + l] * r[3 * j + l];
                out[3 * i + j] += weight * turned;
            }
    }
}

void pliant_macros_free(pliant_macros *macros)
{
    if (!macros) return;
    for (int32_t cube = 0; cube < macros->count; cube++) {
        if (macros->root && cube >= macros->num_lent) pliant_free(macros->root[cube]);
        if (macros->entry_start) pliant_free(macros->entry_start[cube]);
        if (macros->entry_corner) pliant_free(macros->entry_corner[cube]);
        if (macros->entry_shape) pliant_free(macros->entry_shape[cube]);
    }
    void *blocks[] = {macros->start,        macros->node,        macros->held,           macros->grounded,
                      macros->own,          macros->gradient,    macros->rank,           macros->root,
                      macros->fine_start,   macros->fine,        macros->cube_of_fine,   macros->entry_start,
                      macros->entry_corner, macros->entry_shape, macros->cube_of_corner, macros->cell,
                      macros->shear,        macros->law,         macros->rest};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    pliant_free(macros);
}
