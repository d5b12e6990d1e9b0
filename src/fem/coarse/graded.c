/* Where a cut runs, coarse elements are those of the fine mesh: no element whose corners lie further apart than the cut is deep opens as tissue does
 * (NUMERICS 10). A coarse cube is refined where one of its fine cubes lies by the cut, or beside one that does, so that what a cut's end bends is fine as well.
 * Elsewhere coarse elements stay, to the bit, what they were at load.
 *
 * Between the two, fine nodes of coarse elements follow these linearly, u = C u_m (Hughes, The Finite Element Method, 3.A), and a fine element with such
 * corners has C'KC on the nodes that they follow: a fine cube has no more than three faces in those of its coarse cube, so that these are eight at most. */
#include "base/fail.h"
#include "fem/element/hexahedra.h"
#include "fem/system.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

enum { CORNERS = 8, LAYERS = 3 }; /* of fine cubes by a cut: those that it parts, and those beside them */

typedef struct grading {
    pliant_system *system;
    const pliant_system *base;
    const pliant_body *body;
    const pliant_mesh *fine, *coarse;
    pliant_graded *graded;
    int32_t ratio[3];
    int32_t *element_of_tet;   /* (coarse tetrahedra) element of the base */
    int32_t *now;              /* (elements of the base) its number here, or -1 */
    int32_t *within;           /* (fine nodes) a tetrahedron of a coarse element that it follows, or -1 */
    uint8_t *in_refined;       /* (fine nodes) */
    pliant_cube *cubes;        /* hexahedra of the fine mesh */
    int32_t num_cubes;
    pliant_cube_shape *shape;  /* (2) by parity */
    bool known[2];
    uint8_t *free;             /* (solved nodes) an element has it, and nothing holds it */
    int32_t *point;            /* (fine nodes) the element without stiffness that stands for it, or -1; schur */
} grading;

/* nodes, and their weights: what a solved node is, or follows */
typedef struct followed {
    int32_t node[CORNERS];
    double weight[CORNERS];
    int count;
} followed;

bool pliant_body_is_cut(const pliant_body *body) { return body->node_parent || body->tet_parent; }

static pliant_status no_memory(void) { return pliant_fail_memory("the elements beside a cut"); }

static int32_t count_of_cells(const pliant_mesh *mesh) { return mesh->cells[0] * mesh->cells[1] * mesh->cells[2]; }

static int32_t coarse_cell(const grading *work, int32_t fine_cell)
{
    const int32_t *cells = work->fine->cells, *coarse = work->coarse->cells;
    const int32_t i = fine_cell % cells[0], j = fine_cell / cells[0] % cells[1], k = fine_cell / cells[0] / cells[1];
    return i / work->ratio[0] + coarse[0] * (j / work->ratio[1] + coarse[1] * (k / work->ratio[2]));
}

static int32_t cell_of_tet(const grading *work, int32_t tet) { return coarse_cell(work, work->fine->lattice_of_tet[tet] / 5); }

static bool is_refined(const grading *work, int32_t tet) { return work->graded->refined[cell_of_tet(work, tet)]; }

/* ---- which cubes */

/* Fine cubes with a place that has several nodes, or with fragments of a tetrahedron. places, of_slot: zeroed */
static void mark_cut(const grading *work, uint8_t *places, uint8_t *of_slot, uint8_t *marked)
{
    const pliant_mesh *fine = work->fine;
    for (int32_t n = 0; n < fine->num_nodes; n++) places[fine->lattice_of_node[n]] += places[fine->lattice_of_node[n]] < 2;
    for (int32_t t = 0; t < fine->num_tets; t++) of_slot[fine->lattice_of_tet[t]] += of_slot[fine->lattice_of_tet[t]] < 2;
    for (int32_t v = 0; v < 4 * fine->num_tets; v++)
        if (places[fine->lattice_of_node[fine->tets[v]]] > 1 || of_slot[fine->lattice_of_tet[v / 4]] > 1) marked[fine->lattice_of_tet[v / 4] / 5] = 1;
}

/* cubes beside marked ones, marked 2 in this pass */
static void spread(const int32_t cells[3], uint8_t *marked, uint8_t pass)
{
    int32_t at[3], cell = 0;
    for (at[2] = 0; at[2] < cells[2]; at[2]++)
        for (at[1] = 0; at[1] < cells[1]; at[1]++)
            for (at[0] = 0; at[0] < cells[0]; at[0]++, cell++) {
                if (marked[cell] == 0 || marked[cell] > pass) continue;
                for (int step = 0; step < 27; step++) {
                    const int32_t i = at[0] + step % 3 - 1, j = at[1] + step / 3 % 3 - 1, k = at[2] + step / 9 - 1;
                    if (i < 0 || j < 0 || k < 0 || i >= cells[0] || j >= cells[1] || k >= cells[2]) continue;
                    uint8_t *other = marked + i + cells[0] * (j + cells[1] * k);
                    if (*other == 0) *other = (uint8_t)(pass + 1);
                }
            }
}

static pliant_status refine(grading *work)
{
    const pliant_mesh *fine = work->fine;
    const size_t cells = (size_t)count_of_cells(fine);
    const size_t nodes = ((size_t)fine->cells[0] + 1) * ((size_t)fine->cells[1] + 1) * ((size_t)fine->cells[2] + 1);
    uint8_t *places = pliant_calloc(nodes, 1), *of_slot = pliant_calloc(5 * cells, 1), *marked = pliant_calloc(cells, 1);
    const bool good = places && of_slot && marked;
    if (good) mark_cut(work, places, of_slot, marked);
    for (uint8_t pass = 1; good && pass < LAYERS; pass++) spread(fine->cells, marked, pass);
    for (size_t cell = 0; good && cell < cells; cell++)
        if (marked[cell]) work->graded->refined[coarse_cell(work, (int32_t)cell)] = 1;
    for (int32_t v = 0; good && v < 4 * fine->num_tets; v++) /* pieces have no unknowns */
        if (work->body->fine_fixed[fine->tets[v]] == PLIANT_FIXED_WHERE_IT_WAS) work->graded->refined[cell_of_tet(work, v / 4)] = 1;
    pliant_free(places);
    pliant_free(of_slot);
    pliant_free(marked);
    return good ? PLIANT_OK : no_memory();
}

/* ---- who follows */

static void find_followers(grading *work)
{
    const pliant_mesh *fine = work->fine;
    memset(work->within, 0xff, (size_t)fine->num_nodes * sizeof *work->within);
    for (int32_t v = 0; v < 4 * fine->num_tets; v++) {
        const int32_t node = fine->tets[v];
        if (is_refined(work, v / 4)) work->in_refined[node] = 1;
        else if (work->within[node] < 0) work->within[node] = v / 4;
    }
}

static bool is_cube(const pliant_macros *macros, int32_t element) { return macros && macros->start[element + 1] - macros->start[element] == CORNERS; }

static void follow_itself(const grading *work, int32_t node, followed *out)
{
    out->count = 1;
    out->node[0] = work->graded->coarse_nodes + node;
    out->weight[0] = 1;
}

/* what a fine node of a coarse element follows, or itself: a fixed one follows what is fixed alone */
static void follow(const grading *work, int32_t node, followed *out)
{
    follow_itself(work, node, out);
    if (work->within[node] < 0) return;
    const int32_t tet = work->body->coarse_of_fine[work->within[node]], element = work->element_of_tet[tet];
    const bool cube = is_cube(work->base->macros, element);
    const int32_t *corners = cube ? work->base->macros->node + work->base->macros->start[element] : work->coarse->tets + 4 * (size_t)tet;
    double weights[CORNERS];
    const double *rest = work->fine->rest + 3 * (size_t)node;
    if (cube) pliant_trilinear_weights(work->base, work->base->macros->cell[element], rest, weights);
    else pliant_mesh_barycentric(work->coarse, tet, rest, weights);
    out->count = 0;
    for (int v = 0; v < (cube ? CORNERS : 4); v++) {
        if (fabs(weights[v]) < 1e-9) continue;
        if (work->body->fine_fixed[node] && work->base->free_of_node[corners[v]] >= 0) {
            follow_itself(work, node, out);
            return;
        }
        out->node[out->count] = corners[v];
        out->weight[out->count++] = weights[v];
    }
}

/* ---- elements */

static void count_corner(grading *work, int32_t node)
{
    const int32_t coarse_nodes = work->graded->coarse_nodes;
    const bool held = node < coarse_nodes ? work->base->free_of_node[node] < 0 : work->body->fine_fixed[node - coarse_nodes] != PLIANT_MOVES;
    if (node < coarse_nodes) work->graded->used[node] = 1;
    if (!held) work->free[node] = 1;
}

static pliant_status add_base_tet(grading *work, int32_t tet, int32_t e)
{
    const pliant_system *base = work->base;
    pliant_macros *macros = work->system->macros;
    double k[144], gradients[12];
    for (int m = 0; m < 12; m++) gradients[m] = base->gradients[tet / LANES][m][tet % LANES];
    for (int v = 0; v < CORNERS; v++) macros->own[CORNERS * (size_t)e + (size_t)v] = v < 4 ? work->coarse->tets[4 * (size_t)tet + (size_t)v] : -1;
    memcpy(macros->gradient + 24 * (size_t)e, gradients, sizeof gradients);
    memcpy(macros->node + macros->start[e], work->coarse->tets + 4 * (size_t)tet, 4 * sizeof *macros->node);
    macros->start[e + 1] = macros->start[e] + 4;
    macros->cell[e] = work->coarse->lattice_of_tet[tet] / 5;
    macros->grounded[e] = base->grounded && base->grounded[tet];
    memset(macros->held + macros->start[e], macros->grounded[e], 4);
    if (base->stiffness) memcpy(k, base->stiffness + 144 * (size_t)tet, sizeof k);
    else pliant_element_stiffness(gradients, base->lame[tet / LANES][0][tet % LANES], base->lame[tet / LANES][1][tet % LANES], k);
    return pliant_macros_keep(macros, e, 12, k);
}

static pliant_status add_base_macro(grading *work, int32_t from, int32_t e)
{
    const pliant_macros *was = work->base->macros;
    pliant_macros *macros = work->system->macros;
    const int32_t begin = was->start[from], corners = was->start[from + 1] - begin;
    memcpy(macros->own + CORNERS * (size_t)e, was->own + CORNERS * (size_t)from, CORNERS * sizeof *was->own);
    memcpy(macros->gradient + 24 * (size_t)e, was->gradient + 24 * (size_t)from, 24 * sizeof *was->gradient);
    memcpy(macros->node + macros->start[e], was->node + begin, (size_t)corners * sizeof *was->node);
    memcpy(macros->held + macros->start[e], was->held + begin, (size_t)corners);
    macros->start[e + 1] = macros->start[e] + corners;
    macros->cell[e] = was->cell[from];
    macros->grounded[e] = was->grounded[from];
    macros->shear[e] = was->shear[from];
    return pliant_macros_copy_root(was, from, macros, e);
}

static pliant_status add_base(grading *work)
{
    const pliant_macros *was = work->base->macros;
    pliant_macros *macros = work->system->macros;
    const int32_t count = was ? was->count : work->coarse->num_tets;
    pliant_status status = PLIANT_OK;
    for (int32_t from = 0; status == PLIANT_OK && from < count; from++) {
        work->now[from] = -1;
        if (work->graded->refined[was ? was->cell[from] : work->coarse->lattice_of_tet[from] / 5]) continue;
        work->now[from] = macros->count;
        status = was ? add_base_macro(work, from, macros->count) : add_base_tet(work, from, macros->count);
        macros->count++;
    }
    for (int32_t t = 0; !was && t < work->fine->num_tets; t++) { /* what a coarse tetrahedron weighs in the axes of its nodes */
        const int32_t e = work->now[work->body->coarse_of_fine[t]], slot = work->fine->lattice_of_tet[t] % 5;
        const double *size = work->fine->cell_size;
        if (e >= 0) macros->shear[e] += size[0] * size[1] * size[2] / (slot == 0 ? 3 : 6) * work->body->fine_material[t].mu;
    }
    return status;
}

/* Beside fixed nodes inside a coarse element, and nodes that were moved onto bone, there are more than eight: then it keeps R = I, as that element does,
 * and what is fixed at rest adds nothing. Returns how many are left. */
static int drop_fixed(const grading *work, int n, int count, int32_t *list, double c[][CORNERS * CORNERS])
{
    int kept = 0;
    for (int m = 0; m < count; m++) {
        const int32_t fine = list[m] - work->graded->coarse_nodes;
        if (fine >= 0 && work->body->fine_fixed[fine] == PLIANT_FIXED_AT_REST) continue;
        list[kept] = list[m];
        for (int v = 0; v < n; v++) c[v][kept] = c[v][m];
        kept++;
    }
    return kept;
}

/* The nodes that an element's corners are or follow, in the place of its corners: gradient and root are those of the element yet. */
static pliant_status lead(const grading *work, const int32_t *node, int n, int32_t e)
{
    pliant_macros *macros = work->system->macros;
    double c[CORNERS][CORNERS * CORNERS] = {{0}}, gradient[3 * CORNERS] = {0};
    int32_t list[CORNERS * CORNERS];
    int count = 0;
    for (int v = 0; v < n; v++) {
        followed of;
        follow(work, node[v], &of);
        for (int i = 0; i < of.count; i++) {
            int at = 0;
            while (at < count && list[at] != of.node[i]) at++;
            if (at == count) list[count++] = of.node[i];
            c[v][at] += of.weight[i];
        }
    }
    macros->grounded[e] = count > CORNERS;
    if (count > CORNERS) count = drop_fixed(work, n, count, list, c);
    const int32_t rank = macros->rank[e], begin = macros->start[e];
    float *root = rank > 0 ? pliant_calloc((size_t)rank * 3 * (size_t)count, sizeof *root) : NULL;
    if (rank > 0 && !root) return no_memory();
    for (int32_t r = 0; r < rank; r++)
        for (int v = 0; v < n; v++)
            for (int m = 0; m < count; m++)
                for (int d = 0; d < 3; d++) root[3 * count * r + 3 * m + d] += (float)(c[v][m] * macros->root[e][3 * n * r + 3 * v + d]);
    pliant_free(macros->root[e]);
    macros->root[e] = root;
    for (int m = 0; m < count && m < CORNERS; m++)
        for (int v = 0; v < n; v++)
            for (int d = 0; d < 3; d++) gradient[3 * m + d] += c[v][m] * macros->gradient[24 * (size_t)e + (size_t)(3 * v + d)];
    memcpy(macros->gradient + 24 * (size_t)e, gradient, sizeof gradient);
    for (int m = 0; m < CORNERS; m++) macros->own[CORNERS * (size_t)e + (size_t)m] = m < count ? list[m] : -1;
    memcpy(macros->node + begin, list, (size_t)count * sizeof *list);
    memset(macros->held + begin, macros->grounded[e], (size_t)count);
    macros->start[e + 1] = begin + count;
    return PLIANT_OK;
}

/* an element all of whose nodes are fixed says nothing */
static bool is_fixed(const grading *work, const int32_t *node, int n)
{
    for (int v = 0; v < n; v++)
        if (!work->body->fine_fixed[node[v]]) return false;
    return true;
}

static const pliant_cube_shape *shape_of(grading *work, const pliant_cube *cube)
{
    const int parity = pliant_cell_parity(work->fine, work->fine->lattice_of_tet[cube->tet[0]] / 5);
    if (!work->known[parity] || work->fine->num_moved > 0) pliant_cube_integrate(work->fine, cube, parity, work->shape + parity);
    work->known[parity] = true;
    return work->shape + parity;
}

static pliant_status add_fine(grading *work)
{
    const pliant_mesh *fine = work->fine;
    pliant_macros *macros = work->system->macros;
    pliant_status status = PLIANT_OK;
    uint8_t *done = pliant_calloc((size_t)fine->num_tets, 1);
    if (!done) return no_memory();
    for (int32_t i = 0; status == PLIANT_OK && i < work->num_cubes; i++) {
        const pliant_cube *cube = work->cubes + i;
        if (!is_refined(work, cube->tet[0])) continue;
        for (int slot = 0; slot < 5; slot++) done[cube->tet[slot]] = 1;
        if (is_fixed(work, cube->node, CORNERS)) continue;
        macros->cell[macros->count] = cell_of_tet(work, cube->tet[0]);
        status = pliant_macros_add_hexahedron(work->body->fine_material, cube, shape_of(work, cube), macros, macros->count);
        if (status == PLIANT_OK) status = lead(work, cube->node, CORNERS, macros->count);
        macros->count++;
    }
    for (int32_t t = 0; status == PLIANT_OK && t < fine->num_tets; t++) {
        if (done[t] || !is_refined(work, t) || is_fixed(work, fine->tets + 4 * (size_t)t, 4)) continue;
        macros->cell[macros->count] = cell_of_tet(work, t);
        status = pliant_macros_add_tet(fine, work->body->fine_material, t, macros, macros->count);
        if (status == PLIANT_OK) status = lead(work, fine->tets + 4 * (size_t)t, 4, macros->count);
        macros->count++;
    }
    pliant_free(done);
    return status;
}

/* Where fine nodes follow the shape functions of elements, one that moves by itself has an element of its own, without stiffness. */
static void add_points(grading *work)
{
    pliant_macros *macros = work->system->macros;
    memset(work->point, 0xff, (size_t)work->fine->num_nodes * sizeof *work->point);
    for (int32_t v = 0; v < 4 * work->fine->num_tets; v++) {
        const int32_t fine = work->fine->tets[v], node = work->graded->coarse_nodes + fine, e = macros->count, begin = macros->start[e];
        if (!work->free[node] || work->point[fine] >= 0) continue;
        work->point[fine] = e;
        macros->node[begin] = node;
        macros->held[begin] = macros->grounded[e] = 1;
        for (int m = 0; m < CORNERS; m++) macros->own[CORNERS * (size_t)e + (size_t)m] = m == 0 ? node : -1;
        macros->cell[e] = cell_of_tet(work, v / 4);
        macros->start[e + 1] = begin + 1;
        macros->count++;
    }
}

static pliant_status make_elements(grading *work)
{
    pliant_system *system = work->system;
    const pliant_macros *was = work->base->macros;
    size_t count = was ? (size_t)was->count : (size_t)work->coarse->num_tets, corners = was ? (size_t)was->start[was->count] : 4 * count;
    for (int32_t t = 0; t < work->fine->num_tets; t++) {
        if (!is_refined(work, t)) continue;
        count += 5; /* with its nodes */
        corners += CORNERS * CORNERS + 4;
    }
    if (!(system->macros = pliant_calloc(1, sizeof *system->macros))) return no_memory();
    pliant_status status = pliant_macros_allocate(system->macros, count, corners);
    system->macros->count = 0;
    if (status == PLIANT_OK) status = add_base(work);
    if (status == PLIANT_OK) status = add_fine(work);
    if (status != PLIANT_OK) return status;
    const pliant_macros *macros = system->macros;
    for (int32_t c = 0; c < macros->start[macros->count]; c++) count_corner(work, macros->node[c]);
    if (work->point) add_points(work);
    system->num_blocks = pliant_macros_blocks((size_t)macros->count, (size_t)macros->start[macros->count]);
    return PLIANT_OK;
}

/* ---- what is solved, and how fine nodes follow */

static pliant_status make_mesh(grading *work)
{
    const pliant_mesh *coarse = work->coarse, *fine = work->fine;
    pliant_graded *graded = work->system->graded = work->graded = pliant_calloc(1, sizeof *graded);
    if (!graded) return no_memory();
    pliant_mesh *mesh = &graded->mesh;
    graded->coarse_nodes = coarse->num_nodes;
    memcpy(mesh->cells, coarse->cells, sizeof mesh->cells);
    memcpy(mesh->cell_size, coarse->cell_size, sizeof mesh->cell_size);
    memcpy(mesh->corner, coarse->corner, sizeof mesh->corner);
    memcpy(mesh->direction, coarse->direction, sizeof mesh->direction);
    mesh->num_nodes = coarse->num_nodes + fine->num_nodes;
    mesh->rest = pliant_calloc((size_t)mesh->num_nodes, 3 * sizeof *mesh->rest);
    graded->used = pliant_calloc((size_t)coarse->num_nodes, 1);
    graded->refined = pliant_calloc((size_t)count_of_cells(coarse), 1);
    if (!mesh->rest || !graded->used || !graded->refined) return no_memory();
    memcpy(mesh->rest, coarse->rest, 3 * (size_t)coarse->num_nodes * sizeof *mesh->rest);
    memcpy(mesh->rest + 3 * (size_t)coarse->num_nodes, fine->rest, 3 * (size_t)fine->num_nodes * sizeof *mesh->rest);
    return PLIANT_OK;
}

/* its number in the body that the base is of */
static size_t node_of_base(const grading *work, size_t node)
{
    return node < (size_t)work->base->fine->num_nodes ? node : (size_t)work->body->node_parent[node];
}

static pliant_status follow_linearly(grading *work, pliant_upsample *upsample)
{
    const pliant_upsample *was = work->base->upsample;
    const size_t corners = (size_t)was->corners, nodes = (size_t)work->fine->num_nodes;
    upsample->node = pliant_calloc(nodes, corners * sizeof *upsample->node);
    upsample->weights = pliant_calloc(nodes, corners * sizeof *upsample->weights);
    if (!upsample->node || !upsample->weights) return no_memory();
    for (size_t n = 0; n < nodes; n++) {
        const size_t load = node_of_base(work, n);
        if (!work->in_refined[n]) {
            memcpy(upsample->node + corners * n, was->node + corners * load, corners * sizeof *was->node);
            memcpy(upsample->weights + corners * n, was->weights + corners * load, corners * sizeof *was->weights);
            continue;
        }
        followed of;
        follow(work, (int32_t)n, &of);
        for (size_t v = 0; v < corners; v++) {
            upsample->node[corners * n + v] = of.node[v < (size_t)of.count ? v : 0];
            upsample->weights[corners * n + v] = v < (size_t)of.count ? of.weight[v] : 0;
        }
    }
    return PLIANT_OK;
}

/* By the shape functions of the coarse elements that are left, and of points. */
static pliant_status follow_shapes(grading *work, pliant_upsample *upsample)
{
    const pliant_upsample *was = work->base->upsample;
    const size_t each = 9 * (size_t)was->corners;
    const int32_t nodes = work->fine->num_nodes;
    size_t most = (size_t)nodes;
    for (int32_t n = 0; n < nodes; n++) most += (size_t)(was->start[node_of_base(work, (size_t)n) + 1] - was->start[node_of_base(work, (size_t)n)]);
    upsample->start = pliant_calloc((size_t)nodes + 1, sizeof *upsample->start);
    upsample->entry_element = pliant_calloc(most, sizeof *upsample->entry_element);
    upsample->entry_share = pliant_calloc(most, sizeof *upsample->entry_share);
    upsample->entry_shape = pliant_calloc(most, each * sizeof *upsample->entry_shape);
    if (!upsample->start || !upsample->entry_element || !upsample->entry_share || !upsample->entry_shape) return no_memory();
    for (int32_t n = 0; n < nodes; n++) {
        const size_t load = node_of_base(work, (size_t)n);
        const int32_t begin = upsample->start[n];
        int32_t at = begin;
        double sum = 0;
        for (int32_t e = was->start[load]; work->point[n] < 0 && e < was->start[load + 1]; e++) {
            if (work->now[was->entry_element[e]] < 0) continue;
            upsample->entry_element[at] = work->now[was->entry_element[e]];
            sum += upsample->entry_share[at] = was->entry_share[e];
            memcpy(upsample->entry_shape + each * (size_t)at++, was->entry_shape + each * (size_t)e, each * sizeof(double));
        }
        for (int32_t e = begin; e < at; e++) upsample->entry_share[e] /= sum;
        if (work->point[n] >= 0) {
            upsample->entry_element[at] = work->point[n];
            upsample->entry_share[at] = 1;
            for (size_t m = 0; m < 9; m += 4) upsample->entry_shape[each * (size_t)at + m] = 1;
            at++;
        }
        upsample->start[n + 1] = at;
    }
    return PLIANT_OK;
}

static pliant_status make_upsample(grading *work)
{
    pliant_upsample *upsample = work->system->upsample = pliant_calloc(1, sizeof *upsample);
    if (!upsample) return no_memory();
    upsample->corners = work->base->upsample->corners;
    upsample->still = work->body->fine_fixed;
    return work->point ? follow_shapes(work, upsample) : follow_linearly(work, upsample);
}

static pliant_status find_fixed(const grading *work, uint8_t **fixed)
{
    const int32_t count = work->graded->mesh.num_nodes;
    uint8_t *out = *fixed = pliant_calloc((size_t)count, 1);
    if (!out) return no_memory();
    for (int32_t n = 0; n < count; n++) {
        const int32_t fine = n - work->graded->coarse_nodes;
        if (!work->free[n]) out[n] = fine >= 0 && work->body->fine_fixed[fine] ? work->body->fine_fixed[fine] : PLIANT_FIXED_AT_REST;
    }
    return PLIANT_OK;
}

static pliant_status begin(grading *work, bool hexahedra)
{
    const size_t nodes = (size_t)work->fine->num_nodes, tets = (size_t)work->coarse->num_tets;
    const pliant_macros *was = work->base->macros;
    for (int d = 0; d < 3; d++) work->ratio[d] = work->fine->cells[d] / work->coarse->cells[d];
    work->now = pliant_calloc(was ? (size_t)was->count : tets, sizeof *work->now);
    work->within = pliant_calloc(nodes, sizeof *work->within);
    work->in_refined = pliant_calloc(nodes, 1);
    work->shape = pliant_calloc(2, sizeof *work->shape);
    work->free = pliant_calloc(nodes + (size_t)work->coarse->num_nodes, 1);
    if (!work->now || !work->within || !work->in_refined || !work->shape || !work->free) return no_memory();
    if (work->base->upsample->start && !(work->point = pliant_calloc(nodes, sizeof *work->point))) return no_memory();
    pliant_status status = PLIANT_OK;
    if (was) status = pliant_hexahedra_of_tets(work->coarse, was, &work->element_of_tet);
    else if (!(work->element_of_tet = pliant_calloc(tets, sizeof *work->element_of_tet))) status = no_memory();
    for (size_t t = 0; status == PLIANT_OK && !was && t < tets; t++) work->element_of_tet[t] = (int32_t)t;
    if (status == PLIANT_OK && hexahedra) status = pliant_cubes_find(work->fine, false, &work->cubes, &work->num_cubes);
    return status;
}

pliant_status pliant_system_graded(pliant_system *system, const pliant_system *base, const pliant_body *body, bool hexahedra, uint8_t **fixed)
{
    grading work = {.system = system, .base = base, .body = body, .fine = &body->fine, .coarse = &body->coarse};
    pliant_status status = begin(&work, hexahedra);
    if (status == PLIANT_OK) status = make_mesh(&work);
    if (status == PLIANT_OK) status = refine(&work);
    if (status == PLIANT_OK) {
        system->mesh = &work.graded->mesh;
        find_followers(&work);
        status = make_elements(&work);
    }
    if (status == PLIANT_OK) status = make_upsample(&work);
    if (status == PLIANT_OK) status = find_fixed(&work, fixed);
    void *blocks[] = {work.element_of_tet, work.now, work.within, work.in_refined, work.cubes, work.shape, work.free, work.point};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    return status;
}
