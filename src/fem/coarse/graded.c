/* Graded systems: near a cut, elements of the fine mesh replace coarse elements. Coarse elements cannot open a cut that
 * is shallower than their size (NUMERICS.md). A coarse cube is refined if one of its fine cubes is at the cut or
 * adjacent to such a fine cube. The bending zone at the end of the cut is then fine as well. All other coarse elements
 * stay bitwise unchanged.
 *
 * At the interface, the fine nodes of coarse elements follow these linearly, u = C u_m (Hughes, The Finite Element
 * Method, 3.A). A fine element with such corners has C'KC on the followed nodes. A fine cube has at most three faces on
 * the faces of its coarse cube, so at most eight nodes are followed.
 *
 * After a further cut, everything far from the new cut is copied from the earlier system. */
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/coarse/graded.h"
#include "fem/element/hexahedra.h"
#include "base/memory.h"

#include <string.h>

enum { LAYERS = 3 }; /* layers of fine cubes at a cut: the cut cubes, and adjacent cubes */

bool pliant_body_is_cut(const pliant_body *body) { return body->node_parent || body->tet_parent; }

static pliant_status no_memory(void) { return pliant_fail_memory("the elements near a cut"); }

static size_t count_cells(const pliant_mesh *mesh)
{
    return (size_t)mesh->cells[0] * (size_t)mesh->cells[1] * (size_t)mesh->cells[2];
}

/* ---- The coarse elements at load time. */

static pliant_status make_tet(const pliant_system *system, int32_t tet, pliant_macros *macros)
{
    const pliant_mesh *mesh = system->mesh;
    double k[144], *gradients = macros->gradient + 24 * (size_t)tet;
    for (int m = 0; m < 12; m++) gradients[m] = system->gradients[tet / LANES][m][tet % LANES];
    for (int v = 0; v < GRADED_CORNERS; v++)
        macros->own[GRADED_CORNERS * (size_t)tet + (size_t)v] = v < 4 ? mesh->tets[4 * (size_t)tet + (size_t)v] : -1;
    memcpy(macros->node + 4 * (size_t)tet, mesh->tets + 4 * (size_t)tet, 4 * sizeof *macros->node);
    macros->start[tet + 1] = 4 * (tet + 1);
    macros->cell[tet] = mesh->lattice_of_tet[tet] / 5;
    macros->grounded[tet] = system->grounded && system->grounded[tet];
    memset(macros->held + 4 * (size_t)tet, macros->grounded[tet], 4);
    if (system->stiffness) memcpy(k, system->stiffness + 144 * (size_t)tet, sizeof k);
    else
        pliant_element_stiffness(gradients, system->lame[tet / LANES][0][tet % LANES],
                                 system->lame[tet / LANES][1][tet % LANES], k);
    return pliant_macros_keep(macros, tet, 12, k);
}

/* Convert coarse tetrahedra to macro-elements. load: their body. */
static pliant_status make_tets(const pliant_system *system, const pliant_body *load, pliant_macros **out)
{
    const size_t count = (size_t)system->mesh->num_tets;
    const double *size = load->fine.cell_size;
    pliant_macros *macros = *out = pliant_calloc(1, sizeof *macros);
    pliant_status status = macros ? pliant_macros_allocate(macros, count, 4 * count) : no_memory();
    for (int32_t t = 0; status == PLIANT_OK && t < system->mesh->num_tets; t++) status = make_tet(system, t, macros);
    /* Weight of each element in the axes of its nodes. */
    for (int32_t t = 0; status == PLIANT_OK && t < load->fine.num_tets; t++)
        macros->shear[load->coarse_of_fine[t]] +=
            size[0] * size[1] * size[2] / (load->fine.lattice_of_tet[t] % 5 == 0 ? 3 : 6) * load->fine_material[t].mu;
    return status;
}

static pliant_status make_base(const grading *work)
{
    const pliant_system *system = work->base;
    pliant_graded_base *base = work->graded->base = pliant_calloc(1, sizeof *base);
    if (!base) return no_memory();
    base->holders = 1;
    pliant_status status = PLIANT_OK;
    if (!system->macros) status = make_tets(system, work->body->lender ? work->body->lender : work->body, &base->made);
    if (status != PLIANT_OK) return status;
    base->macros = system->macros ? system->macros : base->made;
    if (!(base->trace = pliant_calloc((size_t)base->macros->count, sizeof *base->trace))) return no_memory();
    for (int32_t e = 0; e < base->macros->count; e++)
        base->trace[e] = pliant_macro_trace(base->macros, system->free_of_node, e);
    if (system->macros) return pliant_hexahedra_of_tets(work->coarse, system->macros, &base->element_of_tet);
    if (!(base->element_of_tet = pliant_calloc((size_t)work->coarse->num_tets, sizeof *base->element_of_tet)))
        return no_memory();
    for (int32_t t = 0; t < work->coarse->num_tets; t++) base->element_of_tet[t] = t;
    return PLIANT_OK;
}

static pliant_status find_base(grading *work)
{
    pliant_status status = PLIANT_OK;
    if (work->before) {
        work->graded->base = work->before->graded->base;
        __atomic_add_fetch(&work->graded->base->holders, 1, __ATOMIC_RELAXED);
    } else {
        status = make_base(work);
    }
    if (status == PLIANT_OK) work->elements = work->graded->base->macros;
    return status;
}

/* ---- Refined cubes. */

/* Cells of a lattice; each is listed when it is marked for the first time. */
typedef struct cell_list {
    int32_t cells[3], count, *cell;
    uint8_t *marked;
} cell_list;

static void mark(cell_list *list, int32_t cell)
{
    if (list->marked[cell]) return;
    list->marked[cell] = 1;
    list->cell[list->count++] = cell;
}

static pliant_status list_create(const pliant_mesh *mesh, cell_list *out)
{
    *out = (cell_list){.cell = pliant_malloc(count_cells(mesh), sizeof *out->cell),
                       .marked = pliant_calloc(count_cells(mesh), 1)};
    memcpy(out->cells, mesh->cells, sizeof out->cells);
    return out->cell && out->marked ? PLIANT_OK : no_memory();
}

static void list_free(cell_list *list)
{
    pliant_free(list->cell);
    pliant_free(list->marked);
}

/* Add all adjacent cells. */
static void spread(cell_list *list)
{
    const int32_t *cells = list->cells;
    const int32_t count = list->count;
    for (int32_t c = 0; c < count; c++) {
        const int32_t cell = list->cell[c],
                      at[3] = {cell % cells[0], cell / cells[0] % cells[1], cell / cells[0] / cells[1]};
        for (int step = 0; step < 27; step++) {
            const int32_t i = at[0] + step % 3 - 1, j = at[1] + step / 3 % 3 - 1, k = at[2] + step / 9 - 1;
            if (i >= 0 && j >= 0 && k >= 0 && i < cells[0] && j < cells[1] && k < cells[2])
                mark(list, i + cells[0] * (j + cells[1] * k));
        }
    }
}

/* Mark the cubes that have a tetrahedron at a lattice position. mesh: at load time. */
static void mark_around(const pliant_mesh *mesh, int32_t place, cell_list *list)
{
    const int32_t nx = mesh->cells[0] + 1, ny = mesh->cells[1] + 1,
                  at[3] = {place % nx, place / nx % ny, place / nx / ny};
    for (int side = 0; side < 8; side++) {
        const int32_t i = at[0] - (side & 1), j = at[1] - (side >> 1 & 1), k = at[2] - (side >> 2);
        if (i < 0 || j < 0 || k < 0 || i >= mesh->cells[0] || j >= mesh->cells[1] || k >= mesh->cells[2]) continue;
        const int32_t cell = i + mesh->cells[0] * (j + mesh->cells[1] * k),
                      *tets = mesh->tet_of_lattice + 5 * (size_t)cell;
        for (int v = 0; v < 20; v++)
            if (tets[v / 4] >= 0 &&
                mesh->lattice_of_node[mesh->tets[4 * (size_t)tets[v / 4] + (size_t)(v % 4)]] == place)
                mark(list, cell);
    }
}

/* Mark fine cubes with duplicated nodes or fragments of a tetrahedron. Both were appended after load time. */
static void mark_cut(const grading *work, cell_list *list)
{
    const pliant_mesh *fine = work->fine, *load = work->base->fine;
    for (int32_t n = load->num_nodes; n < fine->num_nodes; n++) mark_around(load, fine->lattice_of_node[n], list);
    for (int32_t t = load->num_tets; t < fine->num_tets; t++) mark(list, fine->lattice_of_tet[t] / 5);
}

/* Detached pieces have no unknowns. */
static void refine_pieces(const grading *work)
{
    const uint8_t *fixed = work->body->fine_fixed;
    if (!memchr(fixed, PLIANT_FIXED_AT_POSITION, (size_t)work->fine->num_nodes)) return;
    for (int32_t v = 0; v < 4 * work->fine->num_tets; v++)
        if (fixed[work->fine->tets[v]] == PLIANT_FIXED_AT_POSITION)
            work->graded->refined[graded_cell_of(work, v / 4)] = 1;
}

static pliant_status refine(grading *work)
{
    const int32_t *cells = work->fine->cells, *coarse = work->coarse->cells, *ratio = work->ratio;
    cell_list list;
    pliant_status status = list_create(work->fine, &list);
    if (status == PLIANT_OK) {
        mark_cut(work, &list);
        for (int layer = 1; layer < LAYERS; layer++) spread(&list);
        for (int32_t c = 0; c < list.count; c++) {
            const int32_t i = list.cell[c] % cells[0], j = list.cell[c] / cells[0] % cells[1],
                          k = list.cell[c] / cells[0] / cells[1];
            work->graded->refined[i / ratio[0] + coarse[0] * (j / ratio[1] + coarse[1] * (k / ratio[2]))] = 1;
        }
        refine_pieces(work);
    }
    list_free(&list);
    return status;
}

/* List the fine tetrahedra in refined cubes, and in cubes adjacent to them. */
static pliant_status list_tets(grading *work)
{
    enum { REFINED = 1, ADJACENT = 2 };
    const pliant_mesh *fine = work->fine, *coarse = work->coarse;
    const uint8_t *refined = work->graded->refined;
    const int32_t *coarse_of_fine = work->body->coarse_of_fine;
    uint8_t *where = pliant_calloc((size_t)coarse->num_tets, 1);
    cell_list list;
    pliant_status status = list_create(coarse, &list);
    work->tet = pliant_malloc((size_t)fine->num_tets, sizeof *work->tet);
    work->adjacent = pliant_malloc((size_t)fine->num_tets, sizeof *work->adjacent);
    if (!where || !work->tet || !work->adjacent) status = no_memory();
    if (status == PLIANT_OK) {
        for (int32_t cell = 0; cell < (int32_t)count_cells(coarse); cell++)
            if (refined[cell]) mark(&list, cell);
        spread(&list);
        for (int32_t t = 0; t < coarse->num_tets; t++) {
            const int32_t cell = coarse->lattice_of_tet[t] / 5;
            where[t] = refined[cell] ? REFINED : list.marked[cell] ? ADJACENT : 0;
        }
        for (int32_t t = 0; t < fine->num_tets; t++) {
            const uint8_t here = where[coarse_of_fine[t]];
            if (here == REFINED) work->tet[work->num_tets++] = t;
            if (here == ADJACENT) work->adjacent[work->num_adjacent++] = t;
        }
    }
    list_free(&list);
    pliant_free(where);
    return status;
}

/* ---- The solved mesh. */

/* Set rest positions of coarse nodes and then of fine nodes. They are copied from the earlier system, except for
 * appended nodes, which may be copies of other nodes. */
static pliant_status make_rest(grading *work)
{
    const pliant_mesh *coarse = work->coarse, *fine = work->fine;
    pliant_mesh *mesh = &work->graded->mesh;
    const size_t first = (size_t)coarse->num_nodes, nodes = (size_t)mesh->num_nodes;
    const size_t before = work->before ? (size_t)work->before->mesh->num_nodes : first,
                 same = before < nodes ? before : nodes;
    const size_t load = work->before ? (size_t)work->base->fine->num_nodes : 0, number = (size_t)fine->num_nodes - load;
    mesh->rest = pliant_next_version(work->before ? work->before->mesh->rest : coarse->rest, 3 * same, 3 * nodes,
                                     sizeof *mesh->rest);
    if (!mesh->rest) return no_memory();
    if (number > 0) memcpy(mesh->rest + 3 * (first + load), fine->rest + 3 * load, 3 * number * sizeof *mesh->rest);
    pliant_mark_written(mesh->rest, 3 * (first + load), 3 * number, sizeof *mesh->rest);
    return PLIANT_OK;
}

static pliant_status make_mesh(grading *work)
{
    const pliant_mesh *coarse = work->coarse, *fine = work->fine;
    pliant_graded *graded = work->system->graded = work->graded = pliant_calloc(1, sizeof *graded);
    if (!graded) return no_memory();
    pliant_mesh *mesh = &graded->mesh;
    graded->coarse_nodes = coarse->num_nodes;
    graded->coarse_place = coarse->lattice_of_node;
    memcpy(mesh->cells, coarse->cells, sizeof mesh->cells);
    memcpy(mesh->cell_size, coarse->cell_size, sizeof mesh->cell_size);
    memcpy(mesh->corner, coarse->corner, sizeof mesh->corner);
    memcpy(mesh->direction, coarse->direction, sizeof mesh->direction);
    mesh->num_nodes = coarse->num_nodes + fine->num_nodes;
    graded->used = pliant_calloc((size_t)coarse->num_nodes, 1);
    graded->refined = pliant_calloc(count_cells(coarse), 1);
    graded->unrefined_neighbour = pliant_malloc((size_t)fine->num_nodes, sizeof *graded->unrefined_neighbour);
    graded->in_refined = pliant_calloc((size_t)fine->num_nodes, 1);
    return graded->used && graded->refined && graded->unrefined_neighbour && graded->in_refined ? make_rest(work)
                                                                                                : no_memory();
}

static pliant_status find_fixed(const grading *work, uint8_t **fixed)
{
    const int32_t count = work->graded->mesh.num_nodes;
    uint8_t *out = *fixed = pliant_calloc((size_t)count, 1);
    if (!out) return no_memory();
    for (int32_t n = 0; n < count; n++) {
        const int32_t fine = n - work->graded->coarse_nodes;
        if (!work->free[n])
            out[n] = fine >= 0 && work->body->fine_fixed[fine] ? work->body->fine_fixed[fine] : PLIANT_FIXED_AT_REST;
    }
    return PLIANT_OK;
}

static pliant_status begin(grading *work)
{
    const size_t nodes = (size_t)work->fine->num_nodes;
    for (int d = 0; d < 3; d++) work->ratio[d] = work->fine->cells[d] / work->coarse->cells[d];
    pliant_status status = find_base(work);
    if (status != PLIANT_OK) return status;
    work->now = pliant_calloc((size_t)work->elements->count, sizeof *work->now);
    work->free = pliant_calloc((size_t)work->graded->mesh.num_nodes, 1);
    if (work->before) work->alike = pliant_calloc(nodes, 1);
    if (!work->now || !work->free || (work->before && !work->alike)) return no_memory();
    return !work->base->upsample->start || (work->point = pliant_calloc(nodes, sizeof *work->point)) ? PLIANT_OK
                                                                                                     : no_memory();
}

pliant_status pliant_system_build_graded(pliant_system *system, const pliant_system *base, const pliant_body *body,
                                         const pliant_unchanged_elements *kept, bool hexahedra, uint8_t **fixed)
{
    grading work = {.system = system,
                    .base = base,
                    .body = body,
                    .fine = &body->fine,
                    .coarse = &body->coarse,
                    .hexahedra = hexahedra};
    if (kept && kept->before->system->graded) {
        work.kept = kept;
        work.before = kept->before->system;
    }
    pliant_status status = make_mesh(&work);
    if (status == PLIANT_OK) status = begin(&work);
    if (status == PLIANT_OK) status = refine(&work);
    if (status == PLIANT_OK) status = list_tets(&work);
    if (status == PLIANT_OK) {
        system->mesh = &work.graded->mesh;
        status = pliant_graded_elements(&work);
    }
    if (status == PLIANT_OK) status = pliant_graded_upsample(&work);
    if (status == PLIANT_OK) status = find_fixed(&work, fixed);
    PLIANT_FREE(work.tet, work.adjacent, work.now, work.alike, work.free, work.point);
    return status;
}
