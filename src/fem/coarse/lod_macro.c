/* Builds macro-elements from correctors: their corners, shape functions on the fine nodes, and matrices. */
#include "base/fail.h"
#include "base/dense.h"
#include "fem/coarse/lod_macro.h"
#include "fem/element/hexahedra.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

/* List the corners of a macro-element, each once: the nodes of the cubes within k, as in fem/system.h. Their indices
 * stay in the slots of the work arrays. */
static int32_t list_corners(const lod_builder *lod, lod_buffers *buffers, int32_t cube, int32_t *node, uint8_t *held)
{
    int32_t near[PLIANT_MAX_NEAR], count = 0;
    int cubes = lod_near(lod, cube, near);
    for (int c = 0; c < cubes; c++) {
        bool holds = lod->grounded[cube] || lod->grounded[near[c]];
        for (int v = 0; v < 8; v++) {
            int32_t own = lod->own[8 * near[c] + v];
            if (own < 0 || (holds && lod->coarse_fixed[own]) || buffers->slot[2 * own + holds] >= 0) continue;
            buffers->slot[2 * own + holds] = count;
            node[count] = own;
            held[count++] = holds;
        }
    }
    return count;
}

static void leave_corners(lod_buffers *buffers, int32_t count, const int32_t *node, const uint8_t *held)
{
    for (int32_t c = 0; c < count; c++) buffers->slot[2 * node[c] + held[c]] = -1;
}

/* Add the gradients of a fine element's corners, integrated over the element: corners x 3. Return its volume. Hexahedra
 * have the same size, so 1 replaces their volume. */
static double integrate_gradients(const lod_builder *lod, int32_t element, double out[24])
{
    if (!lod->whole.macros) {
        const double volume = pliant_mesh_gradients(lod->system->fine, element, out);
        for (int m = 0; m < 12; m++) out[m] *= volume;
        return volume;
    }
    memcpy(out, lod->whole.macros->gradient + 24 * (size_t)element, 24 * sizeof *out);
    return 1;
}

/* Compute g_v in F = sum of x_v g_v', the mean of P's gradient in the tissue of a cube. In a cube with little tissue, a
 * mean over all nodes would extrapolate: the tissue hardly moves the nodes that are far from it. */
static void find_frame(const lod_builder *lod, int32_t cube, double gradient[24])
{
    double whole = 0;
    for (int32_t e = lod->element_start[cube]; e < lod->element_start[cube + 1]; e++) {
        const int32_t *of_element;
        double own[24];
        const int corners = lod_element(lod, lod->elements[e], &of_element, NULL);
        whole += integrate_gradients(lod, lod->elements[e], own);
        for (int a = 0; a < corners; a++) {
            int32_t nodes[LOD_MAX_WEIGHTS];
            double weights[LOD_MAX_WEIGHTS];
            const int count = lod_interpolation(lod, of_element[a], nodes, weights);
            for (int v = 0; v < count; v++)
                for (int d = 0; d < 3; d++)
                    gradient[3 * lod_corner(lod, cube, nodes[v]) + d] += weights[v] * own[3 * a + d];
        }
    }
    for (int m = 0; m < 24; m++) gradient[m] /= whole;
}

/* Make every free fine node follow the first cube that contains it. */
static void list_followers(const lod_builder *lod, pliant_macros *macros)
{
    const pliant_mesh *fine = lod->system->fine;
    memset(macros->cube_of_fine, 0xff, (size_t)fine->num_nodes * sizeof *macros->cube_of_fine);
    for (int32_t cube = 0; cube < lod->count; cube++)
        for (int32_t e = lod->element_start[cube]; e < lod->element_start[cube + 1]; e++) {
            const int32_t *nodes;
            const int corners = lod_element(lod, lod->elements[e], &nodes, NULL);
            for (int v = 0; v < corners; v++) {
                if (macros->cube_of_fine[nodes[v]] >= 0 || lod->fine_fixed[nodes[v]]) continue;
                macros->cube_of_fine[nodes[v]] = cube;
                macros->fine_start[cube + 1]++;
            }
        }
    for (int32_t cube = 0; cube < lod->count; cube++) macros->fine_start[cube + 1] += macros->fine_start[cube];
    /* In reverse order, so that the starts end at their final values. */
    for (int32_t node = fine->num_nodes - 1; node >= 0; node--) {
        int32_t cube = macros->cube_of_fine[node];
        if (cube >= 0) macros->fine[--macros->fine_start[cube + 1]] = node;
    }
    for (int32_t cube = 0; cube < lod->count; cube++) macros->fine_start[cube] = macros->fine_start[cube + 1];
    macros->fine_start[lod->count] = lod->whole.num_free;
}

static pliant_status allocate(const lod_builder *lod, pliant_macros *macros)
{
    size_t count = (size_t)lod->count, fine = (size_t)lod->system->fine->num_nodes;
    bool good = (macros->start = pliant_calloc(count + 1, sizeof *macros->start)) &&
                (macros->grounded = pliant_calloc(count, sizeof *macros->grounded)) &&
                (macros->own = pliant_calloc(count, 8 * sizeof *macros->own)) &&
                (macros->gradient = pliant_calloc(count, 24 * sizeof *macros->gradient)) &&
                (macros->rank = pliant_calloc(count, sizeof *macros->rank)) &&
                (macros->root = pliant_calloc(count, sizeof *macros->root)) &&
                (macros->fine_start = pliant_calloc(count + 1, sizeof *macros->fine_start)) &&
                (macros->fine = pliant_calloc(fine, sizeof *macros->fine)) &&
                (macros->cube_of_fine = pliant_calloc(fine, sizeof *macros->cube_of_fine)) &&
                (macros->entry_start = pliant_calloc(count, sizeof *macros->entry_start)) &&
                (macros->entry_corner = pliant_calloc(count, sizeof *macros->entry_corner)) &&
                (macros->entry_shape = pliant_calloc(count, sizeof *macros->entry_shape));
    return good ? PLIANT_OK : pliant_fail_memory("the macro-elements");
}

pliant_status lod_macros_create(lod_builder *lod)
{
    pliant_system *system = lod->system;
    pliant_macros *macros = system->macros = pliant_calloc(1, sizeof *macros);
    if (!macros) return pliant_fail_memory("the macro-elements");
    lod_buffers buffers = {0};
    int32_t node[PLIANT_MAX_CORNERS];
    uint8_t held[PLIANT_MAX_CORNERS];
    macros->count = lod->count;
    pliant_status status = allocate(lod, macros);
    if (status == PLIANT_OK) status = lod_buffers_create(lod, &buffers);
    for (int pass = 0; pass < 2 && status == PLIANT_OK; pass++) {
        int32_t total = 0;
        for (int32_t cube = 0; cube < lod->count; cube++) {
            int32_t count = list_corners(lod, &buffers, cube, node, held);
            leave_corners(&buffers, count, node, held);
            macros->start[cube] = total;
            if (pass == 1) {
                memcpy(macros->node + total, node, (size_t)count * sizeof *node);
                memcpy(macros->held + total, held, (size_t)count * sizeof *held);
            }
            total += count;
        }
        macros->start[lod->count] = total;
        if (pass == 1) break;
        macros->node = pliant_calloc((size_t)total, sizeof *macros->node);
        macros->held = pliant_calloc((size_t)total, sizeof *macros->held);
        if (!macros->node || !macros->held) status = pliant_fail_memory("the macro-elements");
    }
    lod_buffers_free(&buffers);
    if (status != PLIANT_OK) return status;
    memcpy(macros->grounded, lod->grounded, (size_t)lod->count * sizeof *macros->grounded);
    memcpy(macros->own, lod->own, 8 * (size_t)lod->count * sizeof *macros->own);
    for (int32_t cube = 0; cube < lod->count; cube++)
        find_frame(lod, cube, macros->gradient + 24 * cube);
    list_followers(lod, macros);
    system->num_blocks = pliant_macros_blocks((size_t)lod->count, (size_t)macros->start[lod->count]);
    return PLIANT_OK;
}

/* ---- One cube. */

typedef struct cube_work {
    int32_t num_corners, num_nodes; /* columns: 3 num_corners; rows: 3 num_nodes */
    int32_t *node;      /* (num_nodes) fine */
    double *shape;      /* (rows x columns) N */
    double *force;      /* (rows x columns) K_C N */
    double *matrix;     /* (columns x columns) */
    double *root;       /* (columns x columns) */
} cube_work;

static void work_free(cube_work *work) { PLIANT_FREE(work->node, work->shape, work->force, work->matrix, work->root); }

static pliant_status work_create(const lod_builder *lod, lod_buffers *buffers, int32_t cube, cube_work *work)
{
    const pliant_macros *macros = lod->system->macros;
    work->num_corners = macros->start[cube + 1] - macros->start[cube];
    size_t maximum = PLIANT_ELEMENT_UNKNOWNS / 3 * (size_t)(lod->element_start[cube + 1] - lod->element_start[cube]);
    if (!(work->node = pliant_calloc(maximum, sizeof *work->node))) return pliant_fail_memory("a macro-element");
    for (int32_t e = lod->element_start[cube]; e < lod->element_start[cube + 1]; e++) {
        const int32_t *nodes;
        const int corners = lod_element(lod, lod->elements[e], &nodes, NULL);
        for (int v = 0; v < corners; v++) {
            if (buffers->local[nodes[v]] >= 0) continue;
            buffers->local[nodes[v]] = work->num_nodes;
            work->node[work->num_nodes++] = nodes[v];
        }
    }
    size_t rows = 3 * (size_t)work->num_nodes, columns = 3 * (size_t)work->num_corners;
    if (columns == 0) return PLIANT_OK; /* grounded on fixed nodes alone */
    bool good = (work->shape = pliant_calloc(rows, columns * sizeof *work->shape)) &&
                (work->force = pliant_calloc(rows, columns * sizeof *work->force)) &&
                (work->matrix = pliant_calloc(columns, columns * sizeof *work->matrix)) &&
                (work->root = pliant_calloc(columns, columns * sizeof *work->root));
    return good ? PLIANT_OK : pliant_fail_memory("a macro-element");
}

/* Compute N = P - sum of Q over the cubes within k. */
static void fill_shape(const lod_builder *lod, const lod_buffers *buffers, int32_t cube, cube_work *work)
{
    size_t columns = 3 * (size_t)work->num_corners;
    bool grounded = lod->grounded[cube];
    for (int32_t i = 0; i < work->num_nodes; i++) {
        int32_t nodes[LOD_MAX_WEIGHTS];
        double weights[LOD_MAX_WEIGHTS];
        if (grounded && lod->fine_fixed[work->node[i]]) continue;
        int leans = lod_interpolation(lod, work->node[i], nodes, weights);
        for (int v = 0; v < leans; v++) {
            int32_t corner = buffers->slot[2 * nodes[v] + grounded];
            for (size_t d = 0; d < 3 && corner >= 0; d++)
                work->shape[(3 * (size_t)i + d) * columns + 3 * (size_t)corner + d] += weights[v];
        }
    }
    int32_t near[PLIANT_MAX_NEAR];
    int cubes = lod_near(lod, cube, near);
    for (int c = 0; c < cubes; c++) {
        const lod_corrector *corrector = lod->correctors + near[c];
        bool held = grounded || lod->grounded[near[c]];
        for (int32_t i = 0; i < corrector->count; i++) {
            int32_t row = buffers->local[corrector->node[i]];
            for (int32_t v = 0; v < 8 && row >= 0; v++) {
                int32_t own = lod->own[8 * near[c] + v], corner = own < 0 ? -1 : buffers->slot[2 * own + held];
                for (size_t m = 0; m < 9 && corner >= 0; m++)
                    work->shape[(3 * (size_t)row + m / 3) * columns + 3 * (size_t)corner + m % 3] -=
                        corrector->value[24 * (3 * (size_t)i + m / 3) + 3 * (size_t)v + m % 3];
            }
        }
    }
}

/* K_C N */
static void fill_force(const lod_builder *lod, const lod_buffers *buffers, int32_t cube, cube_work *work)
{
    const size_t columns = 3 * (size_t)work->num_corners;
    for (int32_t e = lod->element_start[cube]; e < lod->element_start[cube + 1]; e++) {
        const int32_t *nodes;
        double k[PLIANT_ELEMENT_UNKNOWNS * PLIANT_ELEMENT_UNKNOWNS];
        const int n = 3 * lod_element(lod, lod->elements[e], &nodes, k);
        for (int a = 0; a < n; a++)
            for (int b = 0; b < n; b++) {
                double *to = work->force + columns * (3 * (size_t)buffers->local[nodes[a / 3]] + (size_t)(a % 3));
                const double *from =
                    work->shape + columns * (3 * (size_t)buffers->local[nodes[b / 3]] + (size_t)(b % 3));
                for (size_t c = 0; c < columns; c++) to[c] += k[n * a + b] * from[c];
            }
    }
}

/* Add the resistance to the cube's mean change of volume. row: work array with one number per column. */
static void add_bulk(const lod_builder *lod, const lod_buffers *buffers, int32_t cube, cube_work *work, double *row)
{
    const size_t columns = 3 * (size_t)work->num_corners;
    double whole = 0;
    memset(row, 0, columns * sizeof *row);
    for (int32_t e = lod->element_start[cube]; e < lod->element_start[cube + 1]; e++) {
        const int32_t element = lod->elements[e], *nodes;
        const double *gradient = lod->whole.macros->gradient + 24 * (size_t)element;
        const int n = 3 * lod_element(lod, element, &nodes, NULL);
        whole += lod->bulk[element];
        for (int a = 0; a < n; a++) {
            const double *from = work->shape + columns * (3 * (size_t)buffers->local[nodes[a / 3]] + (size_t)(a % 3));
            for (size_t c = 0; c < columns; c++) row[c] += lod->bulk[element] * gradient[a] * from[c];
        }
    }
    for (size_t i = 0; whole > 0 && i < columns; i++)
        for (size_t j = 0; j <= i; j++) work->matrix[columns * i + j] += row[i] * row[j] / whole;
}

/* Compute the lower triangle of N' K_C N. Corners of grounded cubes that move only fixed nodes get a small support
 * stiffness. */
static void fill_matrix(const lod_builder *lod, int32_t cube, cube_work *work)
{
    size_t columns = 3 * (size_t)work->num_corners;
    for (size_t row = 0; row < 3 * (size_t)work->num_nodes; row++) {
        const double *n = work->shape + columns * row, *f = work->force + columns * row;
        for (size_t i = 0; i < columns; i++) {
            if (n[i] == 0) continue;
            double *to = work->matrix + columns * i;
            for (size_t j = 0; j <= i; j++) to[j] += n[i] * f[j];
        }
    }
    for (size_t i = 0; i < columns; i++) {
        int32_t node = lod->system->macros->node[lod->system->macros->start[cube] + (int32_t)(i / 3)];
        if (lod->grounded[cube] && lod_corner(lod, cube, node) >= 0) work->matrix[(columns + 1) * i] += lod->support;
    }
}

/* Blocks of N below this value have no visible effect on upsampled displacements. The matrix uses all blocks
 * (NUMERICS.md). */
static const double smallest_shape = 1e-4;

static bool counts(const double *shape, size_t columns, size_t corner)
{
    double maximum = 0;
    for (size_t m = 0; m < 9; m++) maximum = fmax(maximum, fabs(shape[m / 3 * columns + 3 * corner + m % 3]));
    return maximum > smallest_shape;
}

static pliant_status keep_shape(const lod_builder *lod, const lod_buffers *buffers, int32_t cube, const cube_work *work)
{
    pliant_macros *macros = lod->system->macros;
    size_t columns = 3 * (size_t)work->num_corners, total = 0,
           count = (size_t)(macros->fine_start[cube + 1] - macros->fine_start[cube]);
    const int32_t *nodes = macros->fine + macros->fine_start[cube];
    if (count == 0) return PLIANT_OK;
    if (!(macros->entry_start[cube] = pliant_calloc(count + 1, sizeof **macros->entry_start)))
        return pliant_fail_memory("a macro-element");
    if (columns == 0) return PLIANT_OK;
    for (size_t i = 0; i < count; i++) {
        const double *shape = work->shape + 3 * columns * (size_t)buffers->local[nodes[i]];
        for (size_t c = 0; c < (size_t)work->num_corners; c++) total += counts(shape, columns, c);
        macros->entry_start[cube][i + 1] = (int32_t)total;
    }
    if (total == 0) return PLIANT_OK;
    macros->entry_corner[cube] = pliant_calloc(total, sizeof **macros->entry_corner);
    macros->entry_shape[cube] = pliant_calloc(total, 9 * sizeof **macros->entry_shape);
    if (!macros->entry_corner[cube] || !macros->entry_shape[cube]) return pliant_fail_memory("a macro-element");
    size_t at = 0;
    for (size_t i = 0; i < count; i++) {
        const double *shape = work->shape + 3 * columns * (size_t)buffers->local[nodes[i]];
        for (size_t c = 0; c < (size_t)work->num_corners; c++) {
            if (!counts(shape, columns, c)) continue;
            macros->entry_corner[cube][at] = (uint16_t)c;
            for (size_t m = 0; m < 9; m++)
                macros->entry_shape[cube][9 * at + m] = (float)shape[m / 3 * columns + 3 * c + m % 3];
            at++;
        }
    }
    return PLIANT_OK;
}

static pliant_status keep_root(const lod_builder *lod, int32_t cube, cube_work *work)
{
    pliant_macros *macros = lod->system->macros;
    int32_t columns = 3 * work->num_corners, rank = pliant_dense_root(columns, work->matrix, work->root);
    if (rank == 0) return PLIANT_OK;
    size_t count = (size_t)rank * (size_t)columns;
    if (!(macros->root[cube] = pliant_calloc(count, sizeof **macros->root)))
        return pliant_fail_memory("a macro-element");
    for (size_t m = 0; m < count; m++) macros->root[cube][m] = (float)work->root[m];
    macros->rank[cube] = rank;
    return PLIANT_OK;
}

pliant_status lod_macro(lod_builder *lod, lod_buffers *buffers, int32_t cube)
{
    cube_work work = {0};
    const pliant_macros *macros = lod->system->macros;
    int32_t first = macros->start[cube];
    pliant_status status = work_create(lod, buffers, cube, &work);
    if (status == PLIANT_OK && work.num_corners > 0) {
        for (int32_t c = 0; c < work.num_corners; c++)
            buffers->slot[2 * macros->node[first + c] + macros->held[first + c]] = c;
        fill_shape(lod, buffers, cube, &work);
        fill_force(lod, buffers, cube, &work);
        fill_matrix(lod, cube, &work);
        if (lod->bulk) add_bulk(lod, buffers, cube, &work, work.root);
        leave_corners(buffers, work.num_corners, macros->node + first, macros->held + first);
        status = keep_root(lod, cube, &work);
    }
    if (status == PLIANT_OK) status = keep_shape(lod, buffers, cube, &work);
    for (int32_t i = 0; i < work.num_nodes; i++) buffers->local[work.node[i]] = -1;
    work_free(&work);
    return status;
}
