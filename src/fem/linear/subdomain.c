#include "fem/linear/subdomain.h"

#include "base/fail.h"
#include "base/buffer.h"
#include "base/memory.h"

#include <string.h>

static pliant_status no_memory(void) { return pliant_fail_memory("the equations of the elements near a cut"); }

void pliant_subdomain_free(pliant_subdomain *subdomain)
{
    if (!subdomain) return;
    pliant_system_clear(&subdomain->system);
    pliant_free(subdomain->mesh.rest);
    pliant_free(subdomain->mesh.tets);
    pliant_free(subdomain->unknown);
    pliant_free(subdomain->element);
    pliant_free(subdomain->tangents);
    pliant_free(subdomain->stiffness);
    pliant_free(subdomain->axes);
    pliant_factor_free(subdomain->factor);
    pliant_free(subdomain->values);
    pliant_free(subdomain->inner);
    pliant_free(subdomain->x);
    pliant_free(subdomain->y);
    pliant_free(subdomain);
}

/* ---- Construction. */

/* Data used only during construction. */
typedef struct builder {
    const pliant_system *whole;
    pliant_subdomain *made;
    uint8_t *inner;           /* (num_free of the whole) */
    int32_t *list, count;     /* (num_free) the inner unknowns */
    uint8_t *is_here;         /* (elements of the whole) */
    int32_t *node;            /* (num_nodes of the whole system) local number, or -1 */
} builder;

/* Add one ring of unknowns: the free corners of the elements around list entries from `first` on. Return the new
 * length. */
static int32_t add_ring(const pliant_system *whole, int32_t first, int32_t last, uint8_t *inner, int32_t *list)
{
    const int32_t *nodes = pliant_element_nodes(whole);
    int32_t count = last;
    for (int32_t i = first; i < last; i++)
        for (int32_t c = whole->corner_start[list[i]]; c < whole->corner_end[list[i]]; c++) {
            const int32_t element = pliant_element_of_corner(whole, whole->corner[c]);
            for (int32_t v = pliant_element_begin(whole, element); v < pliant_element_begin(whole, element + 1); v++) {
                int32_t f = whole->free_of_node[nodes[v]];
                if (f < 0 || inner[f]) continue;
                inner[f] = 1;
                list[count++] = f;
            }
        }
    return count;
}

int32_t pliant_subdomain_inner(const pliant_system *system, int32_t rings, uint8_t *inner, int32_t *list)
{
    int32_t count = 0;
    for (int32_t f = 0; f < system->num_free; f++)
        if (inner[f]) list[count++] = f;
    for (int32_t ring = 0, first = 0; ring < rings; ring++) {
        const int32_t next = add_ring(system, first, count, inner, list);
        first = count;
        count = next;
    }
    return count;
}

/* Find the elements with an inner unknown as a corner, and their nodes. */
static pliant_status find_elements(builder *build)
{
    const pliant_system *whole = build->whole;
    const int32_t *nodes = pliant_element_nodes(whole);
    pliant_subdomain *made = build->made;
    pliant_mesh *mesh = &made->mesh;
    const size_t whole_nodes = (size_t)whole->mesh->num_nodes;
    size_t corners = 0, maximum = 0;
    for (int32_t i = 0; i < build->count; i++)
        maximum += (size_t)(whole->corner_end[build->list[i]] - whole->corner_start[build->list[i]]);
    made->element = pliant_calloc(maximum, sizeof *made->element);
    build->node = pliant_calloc(whole_nodes, sizeof *build->node);
    if (!made->element || !build->node) return no_memory();
    memset(build->node, 0xff, whole_nodes * sizeof *build->node);
    for (int32_t i = 0; i < build->count; i++)
        for (int32_t c = whole->corner_start[build->list[i]]; c < whole->corner_end[build->list[i]]; c++) {
            const int32_t element = pliant_element_of_corner(whole, whole->corner[c]);
            if (build->is_here[element]) continue;
            build->is_here[element] = 1;
            made->element[made->num_elements++] = element;
            corners += (size_t)(pliant_element_begin(whole, element + 1) - pliant_element_begin(whole, element));
        }
    if (!(made->unknown = pliant_calloc(corners, sizeof *made->unknown))) return no_memory();
    for (int32_t e = 0; e < made->num_elements; e++)
        for (int32_t v = pliant_element_begin(whole, made->element[e]);
             v < pliant_element_begin(whole, made->element[e] + 1); v++) {
            if (build->node[nodes[v]] >= 0) continue;
            made->unknown[mesh->num_nodes] = whole->free_of_node[nodes[v]];
            build->node[nodes[v]] = mesh->num_nodes++;
        }
    return PLIANT_OK;
}

static pliant_status number_inner(const builder *build)
{
    pliant_subdomain *made = build->made;
    uint8_t *held = pliant_calloc((size_t)made->mesh.num_nodes, 1);
    if (!held) return no_memory();
    for (int32_t n = 0; n < made->mesh.num_nodes; n++)
        held[n] = made->unknown[n] < 0 || !build->inner[made->unknown[n]];
    pliant_status status = pliant_system_unknowns(&made->system, held);
    pliant_free(held);
    return status;
}

/* Factor the stiffness. A part that is attached only by a hinge moves without force. If the factorization fails, add
 * the smallest sufficient fraction of the diagonal. */
static pliant_status factorize(pliant_subdomain *made)
{
    const pliant_pattern *pattern = &made->system.pattern;
    pliant_status status = pliant_factor_numeric(made->factor, made->values);
    for (double part = 1e-6; status == PLIANT_ERROR_NUMERIC && part < 1; part *= 100) {
        for (int32_t column = 0; column < pattern->num_columns; column++) {
            const int64_t first = 9 * (int64_t)pattern->start[column] - 3 * (int64_t)column;
            const int32_t height = pattern->start[column + 1] - pattern->start[column];
            const int64_t at[3] = {first, first + 3 * height, first + 6 * height - 1};
            double maximum = 0;
            for (int d = 0; d < 3; d++) maximum = made->values[at[d]] > maximum ? made->values[at[d]] : maximum;
            for (int d = 0; d < 3; d++) made->values[at[d]] += part * maximum;
        }
        status = pliant_factor_numeric(made->factor, made->values);
    }
    return status;
}

static pliant_status reserve_search(const builder *build, const double *axes)
{
    pliant_subdomain *made = build->made;
    const pliant_system *system = &made->system;
    const size_t nodes = (size_t)made->mesh.num_nodes;
    const bool tets = !system->macros;
    made->tangents = pliant_calloc((size_t)system->num_blocks, sizeof *made->tangents);
    made->x = pliant_calloc(nodes, 3 * sizeof *made->x);
    made->y = pliant_calloc(nodes, 3 * sizeof *made->y);
    made->inner = pliant_calloc((size_t)system->num_free, 3 * sizeof *made->inner);
    if (tets) made->stiffness = pliant_malloc((size_t)made->num_elements, 144 * sizeof *made->stiffness);
    made->values = pliant_calloc((size_t)system->pattern.num_values, sizeof *made->values);
    if (axes) made->axes = pliant_calloc(nodes, 9 * sizeof *made->axes);
    if (!made->tangents || !made->x || !made->y || !made->inner || (tets && !made->stiffness) || !made->values ||
        (axes && !made->axes))
        return no_memory();
    for (size_t n = 0; axes && n < nodes; n++)
        if (made->unknown[n] >= 0) memcpy(made->axes + 9 * n, axes + 9 * (size_t)made->unknown[n], 9 * sizeof *axes);
    return pliant_factor_analyze(&system->pattern, &made->factor);
}

/* Compute the values for the subdomain's tangents. */
static pliant_status find_numbers(pliant_subdomain *made)
{
    const pliant_system *system = &made->system;
    for (int32_t e = 0; made->stiffness && e < made->num_elements; e++)
        pliant_system_element(system, made->tangents, e, made->stiffness + 144 * (size_t)e);
    pliant_system_assemble(system, made->tangents, made->values);
    return factorize(made);
}

static pliant_status find_numbers_at(const builder *build, const double *positions)
{
    pliant_subdomain *made = build->made;
    for (int32_t n = 0; n < build->whole->mesh->num_nodes; n++)
        if (build->node[n] >= 0) memcpy(made->x + 3 * build->node[n], positions + 3 * n, 3 * sizeof *made->x);
    pliant_system_tangents(&made->system, made->x, PLIANT_TWIST_POSITIVE, made->tangents);
    return find_numbers(made);
}

pliant_status pliant_subdomain_numeric(pliant_subdomain *subdomain, const pliant_tangent *tangents)
{
    for (int32_t e = 0; e < subdomain->num_elements; e++) {
        const int32_t of = subdomain->element[e];
        const pliant_tangent *from = tangents + of / LANES;
        pliant_tangent *to = subdomain->tangents + e / LANES;
        for (int m = 0; m < 9; m++) to->rotation[m][e % LANES] = from->rotation[m][of % LANES];
        for (int m = 0; m < 6; m++) to->twist[m][e % LANES] = from->twist[m][of % LANES];
    }
    return find_numbers(subdomain);
}

pliant_status pliant_subdomain_copy(pliant_subdomain *to, const pliant_subdomain *from)
{
    memcpy(to->tangents, from->tangents, (size_t)to->system.num_blocks * sizeof *to->tangents);
    return find_numbers(to);
}

pliant_status pliant_subdomain_create(const pliant_system *system, const uint8_t *opened, int32_t rings,
                                      const double *positions, const double *axes, pliant_subdomain **out)
{
    builder build = {.whole = system};
    *out = NULL;
    build.inner = pliant_calloc((size_t)system->num_free, 1);
    build.list = pliant_calloc((size_t)system->num_free, sizeof *build.list);
    build.is_here = pliant_calloc((size_t)pliant_element_count(system), 1);
    pliant_status status = build.inner && build.list && build.is_here ? PLIANT_OK : no_memory();
    if (status == PLIANT_OK) {
        memcpy(build.inner, opened, (size_t)system->num_free);
        build.count = pliant_subdomain_inner(system, rings, build.inner, build.list);
    }
    if (status == PLIANT_OK && build.count > 0) {
        if (!(build.made = pliant_calloc(1, sizeof *build.made))) status = no_memory();
        if (status == PLIANT_OK) status = find_elements(&build);
        if (status == PLIANT_OK)
            status = pliant_system_extract(system, build.made->num_elements, build.made->element, build.node,
                                           &build.made->mesh, &build.made->system);
        if (status == PLIANT_OK) status = number_inner(&build);
        if (status == PLIANT_OK) status = reserve_search(&build, axes);
        if (status == PLIANT_OK && positions) status = find_numbers_at(&build, positions);
    }
    void *blocks[] = {build.inner, build.list, build.is_here, build.node};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    if (status == PLIANT_OK) *out = build.made;
    else pliant_subdomain_free(build.made);
    return status;
}

/* ---- In a step. */

/* Rotate a vector to or from the axes of the whole system's vectors. */
static void turn(const double *q, bool back, const double in[3], double out[3])
{
    if (!q) {
        memcpy(out, in, 3 * sizeof *out);
        return;
    }
    for (int r = 0; r < 3; r++)
        out[r] = back ? q[r] * in[0] + q[3 + r] * in[1] + q[6 + r] * in[2]
                      : q[3 * r] * in[0] + q[3 * r + 1] * in[1] + q[3 * r + 2] * in[2];
}

static const double *axes_of(const pliant_subdomain *subdomain, int32_t node)
{
    return subdomain->axes ? subdomain->axes + 9 * (size_t)node : NULL;
}

/* Compute y = K x on all nodes of the elements. */
static void multiply(pliant_subdomain *subdomain)
{
    const pliant_system *system = &subdomain->system;
    memset(subdomain->y, 0, 3 * (size_t)subdomain->mesh.num_nodes * sizeof *subdomain->y);
    if (system->macros) pliant_macro_multiply(system, subdomain->tangents, subdomain->x, subdomain->y);
    for (int32_t e = 0; !system->macros && e < subdomain->num_elements; e++) {
        const double *k = subdomain->stiffness + 144 * (size_t)e;
        const int32_t *nodes = system->mesh->tets + 4 * (size_t)e;
        double x[12];
        for (int m = 0; m < 12; m++) x[m] = subdomain->x[3 * nodes[m / 3] + m % 3];
        for (int i = 0; i < 12; i++) {
            double sum = 0;
            for (int j = 0; j < 12; j++) sum += k[12 * i + j] * x[j];
            subdomain->y[3 * nodes[i / 3] + i % 3] += sum;
        }
    }
}

pliant_status pliant_subdomain_solve(pliant_subdomain *subdomain, const double *right, double *z, double *rest)
{
    const pliant_system *system = &subdomain->system;
    for (int32_t f = 0; f < system->num_free; f++) {
        const int32_t node = system->node_of_free[f];
        turn(axes_of(subdomain, node), false, right + 3 * (size_t)subdomain->unknown[node], subdomain->inner + 3 * f);
    }
    pliant_status status = pliant_factor_solve(subdomain->factor, 1, subdomain->inner, subdomain->inner);
    if (status != PLIANT_OK) return status;
    memset(subdomain->x, 0, 3 * (size_t)subdomain->mesh.num_nodes * sizeof *subdomain->x);
    for (int32_t f = 0; f < system->num_free; f++) {
        const int32_t node = system->node_of_free[f];
        memcpy(subdomain->x + 3 * node, subdomain->inner + 3 * f, 3 * sizeof *subdomain->x);
        turn(axes_of(subdomain, node), true, subdomain->inner + 3 * f, z + 3 * (size_t)subdomain->unknown[node]);
    }
    multiply(subdomain);
    for (int32_t n = 0; n < subdomain->mesh.num_nodes; n++) {
        if (subdomain->unknown[n] < 0) continue;
        double *at = rest + 3 * (size_t)subdomain->unknown[n], pull[3];
        if (system->free_of_node[n] >= 0) {
            memset(at, 0, 3 * sizeof *at);
            continue;
        }
        turn(axes_of(subdomain, n), true, subdomain->y + 3 * n, pull);
        for (int d = 0; d < 3; d++) at[d] -= pull[d];
    }
    return PLIANT_OK;
}

pliant_status pliant_subdomain_extend(pliant_subdomain *subdomain, const double *v, double *z)
{
    const pliant_system *system = &subdomain->system;
    memset(subdomain->x, 0, 3 * (size_t)subdomain->mesh.num_nodes * sizeof *subdomain->x);
    for (int32_t n = 0; n < subdomain->mesh.num_nodes; n++)
        if (subdomain->unknown[n] >= 0)
            turn(axes_of(subdomain, n), false, v + 3 * (size_t)subdomain->unknown[n], subdomain->x + 3 * n);
    multiply(subdomain);
    for (int32_t f = 0; f < system->num_free; f++)
        memcpy(subdomain->inner + 3 * f, subdomain->y + 3 * system->node_of_free[f], 3 * sizeof *subdomain->inner);
    pliant_status status = pliant_factor_solve(subdomain->factor, 1, subdomain->inner, subdomain->inner);
    if (status != PLIANT_OK) return status;
    for (int32_t f = 0; f < system->num_free; f++) {
        const int32_t node = system->node_of_free[f];
        double by[3];
        turn(axes_of(subdomain, node), true, subdomain->inner + 3 * f, by);
        for (int d = 0; d < 3; d++) z[3 * (size_t)subdomain->unknown[node] + (size_t)d] -= by[d];
    }
    return PLIANT_OK;
}
