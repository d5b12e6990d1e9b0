/* A 24 x 24 stiffness for every coarse cube, computed from its fine elements. It is the method of averages
 * (NUMERICS.md) applied to hexahedra.
 *
 * A trilinear cube of homogeneous tissue with one change of volume has 18 stress modes tau. Multiplied by the fraction
 * of tissue, they define loads Phi = sum over the fine elements of int B' tau. K is the fine stiffness with a free
 * boundary, and P the trilinear map from the corners. The cube has the minimum energy over all fine displacements u
 * with Phi'u = Phi'P u_c:
 *     H = Phi' K^-1 Phi,   K_c = (Phi'P)' H^-1 (Phi'P).
 * K_c passes the patch test and is never stiffer than P'KP. For homogeneous tissue it is close to the hexahedron of the
 * coarse cube. Self-equilibrated stresses (Pian and Tong, Int. J. Numer. Meth. Engng 22:173, 1986) are equally accurate
 * between soft and stiff tissue, but with them a beam of three cubes sags 2 % less.
 *
 * A cube with fixed fine nodes is grounded (NUMERICS.md) unless these nodes depend on fixed corners alone. It has P'KP
 * with these nodes held, one change of volume, and R = I. Cubes with disconnected fine elements have the same P'KP, but
 * rotate. */
#include "base/fail.h"
#include "base/threads.h"
#include "fem/coarse/cubes.h"
#include "base/dense.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

enum { MODES = 18, UNKNOWNS = 24, CORNERS = 8 };

/* ---- Stresses. */

/* Compute tau of a mode at a point y in [-1, 1]^3 of a cube of this size, in lattice axes. The first six modes are
 * constant. The others are the deviatoric stresses of a displacement u_i = xy, yz, xz or xyz. */
static void mode_at(int mode, const double y[3], const double size[3], double tau[3][3])
{
    memset(tau, 0, 9 * sizeof tau[0][0]);
    if (mode < 6) {
        const int a = mode % 3, b = mode < 3 ? a : (a + 1) % 3;
        tau[a][b] = tau[b][a] = 1;
        return;
    }
    static const int factors[4] = {3, 6, 5, 7};
    const int i = (mode - 6) / 4, factor = factors[(mode - 6) % 4];
    for (int d = 0; d < 3; d++) {
        if (!(factor >> d & 1)) continue;
        double slope = size[0] / size[d]; /* of no dimension */
        for (int o = 0; o < 3; o++) slope *= o != d && factor >> o & 1 ? y[o] : 1;
        tau[i][d] += slope;
        tau[d][i] += slope;
        for (int o = 0; d == i && o < 3; o++) tau[o][o] -= 2.0 / 3 * slope;
    }
}

/* Add weight * B' tau of an element with n corners at a point y. gradient: in world axes. */
static void add_loads(const pliant_mesh *coarse, const double y[3], double weight, int n, double gradient[][3],
                      const int32_t *local_of, double *phi)
{
    const double *direction = coarse->direction;
    double g[CORNERS][3] = {{0}};
    for (int v = 0; v < n; v++)
        for (int d = 0; d < 3; d++)
            for (int r = 0; r < 3; r++) g[v][d] += weight * direction[3 * r + d] * gradient[v][r];
    for (int mode = 0; mode < MODES; mode++) {
        double tau[3][3], turned[3][3] = {{0}};
        mode_at(mode, y, coarse->cell_size, tau);
        for (int r = 0; r < 3; r++)
            for (int d = 0; d < 3; d++)
                for (int e = 0; e < 3; e++) turned[r][d] += direction[3 * r + e] * tau[e][d];
        for (int v = 0; v < n; v++)
            for (int r = 0; r < 3; r++)
                phi[MODES * (3 * (size_t)local_of[v] + (size_t)r) + (size_t)mode] +=
                    turned[r][0] * g[v][0] + turned[r][1] * g[v][1] + turned[r][2] * g[v][2];
    }
}

/* Return the weight of tissue in the averages. Without it, air next to tissue would dominate the average
 * (NUMERICS.md). */
static double share_of(const pliant_tet_material *material) { return material->tissue + 1e-3; }

static void cube_loads(const pliant_submesh *submesh, const pliant_cube_buffers *buffers, const pliant_cube *cube,
                       double *phi)
{
    const double inset = 0.5 - 0.5 / sqrt(3);
    double x[CORNERS][3], fraction = 0;
    int32_t local_of[CORNERS];
    for (int v = 0; v < CORNERS; v++) {
        memcpy(x[v], submesh->fine->rest + 3 * cube->node[v], sizeof x[v]);
        local_of[v] = submesh->local_of[cube->node[v]];
    }
    for (int slot = 0; slot < 5; slot++)
        fraction += (slot == 0 ? 2.0 : 1.0) / 6 * share_of(submesh->material + cube->tet[slot]);
    for (int p = 0; p < CORNERS; p++) {
        double at[3], y[3] = {0, 0, 0}, gradient[CORNERS][3];
        for (int d = 0; d < 3; d++) at[d] = p >> d & 1 ? 1 - inset : inset;
        double volume = fabs(pliant_cube_gradients(x, at, gradient)) / CORNERS;
        for (int v = 0; v < CORNERS; v++) {
            double shape = 1;
            for (int d = 0; d < 3; d++) shape *= v >> d & 1 ? at[d] : 1 - at[d];
            for (int d = 0; d < 3; d++) y[d] += shape * buffers->local[3 * local_of[v] + d];
        }
        add_loads(submesh->coarse, y, fraction * volume, CORNERS, gradient, local_of, phi);
    }
}

static void tet_loads(const pliant_submesh *submesh, const pliant_cube_buffers *buffers, int32_t tet, double *phi)
{
    const double far = 0.5854101966249685, near = 0.1381966011250105; /* exact for squares */
    double flat[12], gradient[4][3], volume = pliant_mesh_gradients(submesh->fine, tet, flat);
    int32_t local_of[4];
    memcpy(gradient, flat, sizeof gradient);
    for (int v = 0; v < 4; v++) local_of[v] = submesh->local_of[submesh->fine->tets[4 * tet + v]];
    for (int p = 0; p < 4; p++) {
        double y[3] = {0, 0, 0};
        for (int v = 0; v < 4; v++)
            for (int d = 0; d < 3; d++) y[d] += (v == p ? far : near) * buffers->local[3 * local_of[v] + d];
        add_loads(submesh->coarse, y, 0.25 * volume * share_of(submesh->material + tet), 4, gradient, local_of, phi);
    }
}

static void all_loads(const pliant_submesh *submesh, const pliant_cube_buffers *buffers, double *phi)
{
    memset(phi, 0, 3 * MODES * (size_t)submesh->num_nodes * sizeof *phi);
    for (int32_t t = 0; t < submesh->num_tets; t++) {
        bool alone;
        const pliant_cube *cube = pliant_cube_at(submesh, submesh->tets[t], &alone);
        if (cube) cube_loads(submesh, buffers, cube, phi);
        else if (alone) tet_loads(submesh, buffers, submesh->tets[t], phi);
    }
}

/* ---- Stiffness. */

/* Compute the root of g' h^-1 g for a well-conditioned h: L^-1 g with h = L L'. */
static bool root_by_factor(const double h[MODES * MODES], const double g[MODES * UNKNOWNS], double *root)
{
    const double minimum = 1e-6; /* squared pivot divided by the largest diagonal entry */
    double l[MODES * MODES], maximum = 0;
    memcpy(l, h, sizeof l);
    for (int m = 0; m < MODES; m++) maximum = fmax(maximum, h[(MODES + 1) * m]);
    if (!pliant_dense_cholesky(MODES, l)) return false;
    for (int m = 0; m < MODES; m++) {
        const double pivot = l[(MODES + 1) * m];
        if (!(pivot * pivot > minimum * maximum)) return false;
        for (int i = 0; i < UNKNOWNS; i++) {
            double sum = g[UNKNOWNS * m + i];
            for (int n = 0; n < m; n++) sum -= l[MODES * m + n] * root[UNKNOWNS * n + i];
            root[UNKNOWNS * m + i] = sum / pivot;
            if (!isfinite(root[UNKNOWNS * m + i])) return false;
        }
    }
    return true;
}

/* Compute the same root if the stress modes are dependent on an incomplete cube. Return its number of rows. h is
 * overwritten. */
static int32_t root_by_eigenvalues(double h[MODES * MODES], const double g[MODES * UNKNOWNS], double *root)
{
    double values[MODES], vectors[MODES * MODES], maximum = 0;
    pliant_dense_symmetric_eigen(MODES, h, values, vectors);
    for (int m = 0; m < MODES; m++) maximum = fmax(maximum, values[m]);
    int32_t rank = 0;
    for (int m = 0; m < MODES; m++) {
        if (!(values[m] > 1e-10 * maximum)) continue;
        double *row = root + UNKNOWNS * rank++;
        for (int i = 0; i < UNKNOWNS; i++) {
            row[i] = 0;
            for (int n = 0; n < MODES; n++) row[i] += vectors[MODES * n + m] * g[UNKNOWNS * n + i];
            row[i] /= sqrt(values[m]);
            if (!isfinite(row[i])) return 0;
        }
    }
    return rank;
}

/* Compute the root of K_c (at most 18 rows of 24). Return its number of rows, or 0 if the fine elements are
 * disconnected. */
static int32_t condense(pliant_submesh *submesh, const pliant_cube_buffers *buffers, double *root)
{
    const int32_t size = 3 * submesh->num_nodes;
    double *phi = submesh->work, *z = phi + (size_t)size * MODES, *modes = z + (size_t)size * MODES;
    double h[MODES * MODES] = {0}, g[MODES * UNKNOWNS] = {0};
    all_loads(submesh, buffers, phi);
    if (!pliant_submesh_factor(submesh, modes)) return 0;
    memcpy(z, phi, (size_t)size * MODES * sizeof *z);
    pliant_dense_cholesky_solve(size, submesh->square, MODES, z);
    for (int32_t i = 0; i < size; i++)
        for (int m = 0; m < MODES; m++) {
            const double p = phi[(size_t)i * MODES + (size_t)m];
            for (int n = 0; n < MODES; n++) h[MODES * m + n] += p * z[(size_t)i * MODES + (size_t)n];
            for (int v = 0; v < CORNERS; v++)
                g[UNKNOWNS * m + 3 * v + i % 3] += p * buffers->weights[CORNERS * (size_t)(i / 3) + (size_t)v];
        }
    for (int m = 0; m < MODES; m++)
        for (int n = 0; n < m; n++) h[MODES * m + n] = h[MODES * n + m] = 0.5 * (h[MODES * m + n] + h[MODES * n + m]);
    return root_by_factor(h, g, root) ? MODES : root_by_eigenvalues(h, g, root);
}

/* ---- One element. */

static pliant_status place_nodes(const pliant_cube_work *work, const pliant_submesh *submesh, int32_t element,
                                 pliant_cube_buffers *buffers)
{
    if (submesh->num_nodes > buffers->nodes) {
        buffers->nodes = 0;
        pliant_free(buffers->weights);
        pliant_free(buffers->local);
        buffers->weights = pliant_calloc((size_t)submesh->num_nodes, CORNERS * sizeof *buffers->weights);
        buffers->local = pliant_calloc((size_t)submesh->num_nodes, 3 * sizeof *buffers->local);
        if (!buffers->weights || !buffers->local) return pliant_fail_memory("the coarse hexahedra");
        buffers->nodes = submesh->num_nodes;
    }
    for (int32_t n = 0; n < submesh->num_nodes; n++) {
        double *weights = buffers->weights + CORNERS * (size_t)n, *y = buffers->local + 3 * (size_t)n;
        pliant_trilinear_weights(work->system, work->system->macros->cell[element],
                                 submesh->fine->rest + 3 * submesh->node[n], weights);
        for (int d = 0; d < 3; d++) {
            y[d] = -1;
            for (int v = 0; v < CORNERS; v++) y[d] += v >> d & 1 ? 2 * weights[v] : 0;
        }
    }
    return PLIANT_OK;
}

static pliant_status make_cube(pliant_cube_work *work, pliant_submesh *submesh, pliant_cube_buffers *buffers,
                               int32_t element)
{
    pliant_macros *macros = work->system->macros;
    double root[UNKNOWNS * UNKNOWNS], k[UNKNOWNS * UNKNOWNS];
    int32_t rank = macros->grounded[element] ? 0 : condense(submesh, buffers, root);
    if (rank > 0) return pliant_cube_keep_root(macros, element, UNKNOWNS, rank, root);
    for (int32_t n = 0; macros->grounded[element] && n < submesh->num_nodes; n++)
        if (work->fixed[submesh->node[n]])
            memset(buffers->weights + CORNERS * (size_t)n, 0, CORNERS * sizeof *buffers->weights);
    pliant_cube_galerkin(submesh, buffers, k);
    rank = pliant_dense_root(UNKNOWNS, k, root);
    if (!macros->grounded[element]) {
#pragma omp atomic
        work->linear++;
    }
    return pliant_cube_keep_root(macros, element, UNKNOWNS, rank, root);
}

static pliant_status make_tet(pliant_cube_work *work, pliant_submesh *submesh, int32_t element)
{
    pliant_macros *macros = work->system->macros;
    double k[144], root[144];
    bool linear;
    pliant_status status =
        pliant_averaged_tet(submesh, work->tet_of_element[element], macros->grounded[element], k, &linear);
    if (status != PLIANT_OK) return status;
    if (linear && !macros->grounded[element]) {
#pragma omp atomic
        work->linear++;
    }
    return pliant_cube_keep_root(macros, element, 12, pliant_dense_root(12, k, root), root);
}

static pliant_status make_element(pliant_cube_work *work, pliant_submesh *submesh, pliant_cube_buffers *buffers,
                                  int32_t element)
{
    const pliant_submesh_lists *lists = &work->lists;
    pliant_macros *macros = work->system->macros;
    const int32_t *list = lists->tets + lists->start[element],
                  count = lists->start[element + 1] - lists->start[element];
    const bool whole = macros->start[element + 1] - macros->start[element] == CORNERS;
    if (count == 0) return PLIANT_OK; /* a divided cube without tissue */
    submesh->cubes = whole ? work->cubes : NULL;
    submesh->cube_of_tet = work->cube_of_tet;
    submesh->shapes = work->shapes;
    for (int32_t t = 0; t < count; t++) {
        double gradients[12];
        macros->shear[element] += pliant_mesh_gradients(submesh->fine, list[t], gradients) * work->material[list[t]].mu;
    }
    pliant_status status = pliant_submesh_load(submesh, count, list);
    if (status == PLIANT_OK && whole) status = place_nodes(work, submesh, element, buffers);
    if (status != PLIANT_OK) return status;
    if (work->schur) return pliant_cubes_schur(work, submesh, buffers, element);
    return whole ? make_cube(work, submesh, buffers, element) : make_tet(work, submesh, element);
}

static pliant_status make_all(pliant_cube_work *work, pliant_progress progress)
{
    const pliant_system *system = work->system;
    pliant_work all = {.what = "homogenization",
                       .stage = "homogenize",
                       .progress = progress,
                       .end = 1,
                       .count = system->macros->count,
                       .interval = 16};
#pragma omp parallel num_threads(system->num_threads)
    {
        pliant_submesh *submesh = NULL;
        pliant_cube_buffers buffers = {NULL, NULL, 0};
        pliant_status status = pliant_submesh_create(system->fine, system->mesh, work->fixed, work->material,
                                                     work->lists.largest, &submesh);
#pragma omp for schedule(dynamic, 2)
        for (int32_t element = 0; element < all.count; element++) {
            if (status == PLIANT_OK) status = make_element(work, submesh, &buffers, element);
            if (status == PLIANT_OK) status = pliant_work_finish_item(&all);
        }
        pliant_submesh_free(submesh);
        pliant_free(buffers.weights);
        pliant_free(buffers.local);
        pliant_work_finish_thread(&all, status);
    }
    return pliant_work_result(&all);
}

/* ---- Fixed nodes. */

/* Find elements with fixed fine nodes that depend on free corners. For schur, find all elements with fixed fine nodes
 * (pliant_cubes_schur_begin). */
static void find_grounded(const pliant_cube_work *work, const uint8_t *coarse_fixed)
{
    const pliant_system *system = work->system;
    const pliant_upsample *upsample = system->upsample;
    pliant_macros *macros = system->macros;
    for (int32_t v = 0; !work->schur && v < 4 * system->fine->num_tets; v++) {
        const int32_t node = system->fine->tets[v];
        for (size_t c = CORNERS * (size_t)node; work->fixed[node] && c < CORNERS * (size_t)node + CORNERS; c++)
            if (upsample->weights[c] != 0 && !coarse_fixed[upsample->node[c]])
                macros->grounded[work->element_of_fine[v / 4]] = 1;
    }
    for (int32_t e = 0; e < macros->count; e++)
        memset(macros->held + macros->start[e], macros->grounded[e], (size_t)(macros->start[e + 1] - macros->start[e]));
    for (int32_t t = 0; t < system->mesh->num_tets; t++)
        system->grounded[t] = macros->grounded[work->element_of_tet[t]];
}

/* Add a fraction of the mean stiffness to the corners of grounded elements. Corners that move no free fine node would
 * otherwise have no stiffness. */
static pliant_status ground(pliant_macros *macros)
{
    const double part = 1e-4;
    double sum = 0, k[UNKNOWNS * UNKNOWNS], root[UNKNOWNS * UNKNOWNS];
    for (int32_t e = 0; e < macros->count; e++)
        for (int32_t m = 0; m < 3 * macros->rank[e] * (macros->start[e + 1] - macros->start[e]); m++)
            sum += (double)macros->root[e][m] * macros->root[e][m];
    const double fraction = part * sum / (3.0 * macros->start[macros->count]);
    for (int32_t e = 0; e < macros->count; e++) {
        if (!macros->grounded[e]) continue;
        const int32_t n = 3 * (macros->start[e + 1] - macros->start[e]);
        for (int32_t i = 0; i < n; i++)
            for (int32_t j = 0; j < n; j++) {
                k[n * i + j] = i == j ? fraction : 0;
                for (int32_t m = 0; m < macros->rank[e]; m++)
                    k[n * i + j] += (double)macros->root[e][n * m + i] * macros->root[e][n * m + j];
            }
        pliant_free(macros->root[e]);
        macros->root[e] = NULL;
        pliant_status status = pliant_cube_keep_root(macros, e, n, pliant_dense_root(n, k, root), root);
        if (status != PLIANT_OK) return status;
    }
    return PLIANT_OK;
}

/* Fix the corners without any stiffness, where cuts have left no tissue. */
static pliant_status hold_empty(const pliant_system *system, uint8_t *coarse_fixed)
{
    const pliant_macros *macros = system->macros;
    uint8_t *carries = pliant_calloc((size_t)system->mesh->num_nodes, 1);
    if (!carries) return pliant_fail_memory("the fixed nodes");
    for (int32_t e = 0; e < macros->count; e++)
        for (int32_t c = macros->start[e]; macros->rank[e] > 0 && c < macros->start[e + 1]; c++)
            carries[macros->node[c]] = 1;
    for (int32_t n = 0; n < system->mesh->num_nodes; n++)
        if (!carries[n]) coarse_fixed[n] = PLIANT_FIXED_AT_REST;
    pliant_free(carries);
    return PLIANT_OK;
}

/* ---- The complete system. */

static pliant_status find_fine_cubes(pliant_cube_work *work)
{
    const pliant_mesh *fine = work->system->fine;
    int32_t count = 0;
    bool known[2] = {false, false};
    pliant_status status = pliant_cubes_find(fine, false, &work->cubes, &count);
    if (status != PLIANT_OK) return status;
    work->cube_of_tet = pliant_calloc((size_t)fine->num_tets, sizeof *work->cube_of_tet);
    work->shapes = pliant_calloc(2, sizeof *work->shapes);
    if (!work->cube_of_tet || !work->shapes) return pliant_fail_memory("the coarse hexahedra");
    memset(work->cube_of_tet, 0xff, (size_t)fine->num_tets * sizeof *work->cube_of_tet);
    for (int32_t c = 0; c < count; c++) {
        const int parity = pliant_cell_parity(fine, fine->lattice_of_tet[work->cubes[c].tet[0]] / 5);
        if (!known[parity] && fine->num_moved == 0)
            pliant_cube_integrate(fine, work->cubes + c, parity, work->shapes + parity);
        known[parity] = true;
        for (int slot = 0; slot < 5; slot++) work->cube_of_tet[work->cubes[c].tet[slot]] = c;
    }
    return PLIANT_OK;
}

/* Create the coarse elements without stiffness, and map coarse and fine tetrahedra to them. */
static pliant_status find_elements(pliant_cube_work *work, const int32_t *coarse_of_fine)
{
    pliant_system *system = work->system;
    const size_t tets = (size_t)system->mesh->num_tets, fine = (size_t)system->fine->num_tets;
    pliant_tet_material *none = pliant_calloc(tets, sizeof *none);
    pliant_status status = none ? pliant_system_build_hexahedra(system, none, NULL, NULL, NULL)
                                : pliant_fail_memory("the coarse hexahedra");
    pliant_free(none);
    if (status == PLIANT_OK) status = pliant_hexahedra_of_tets(system->mesh, system->macros, &work->element_of_tet);
    if (status != PLIANT_OK) return status;
    work->element_of_fine = pliant_calloc(fine, sizeof *work->element_of_fine);
    work->tet_of_element = pliant_calloc((size_t)system->macros->count, sizeof *work->tet_of_element);
    system->grounded = pliant_calloc(tets, sizeof *system->grounded);
    if (!work->element_of_fine || !work->tet_of_element || !system->grounded)
        return pliant_fail_memory("the coarse hexahedra");
    for (size_t t = 0; t < tets; t++) work->tet_of_element[work->element_of_tet[t]] = (int32_t)t;
    for (size_t t = 0; t < fine; t++) work->element_of_fine[t] = work->element_of_tet[coarse_of_fine[t]];
    return PLIANT_OK;
}

pliant_status pliant_homogenize_cubes(pliant_system *system, const pliant_scene *scene, const pliant_mesh *fine,
                                      const uint8_t *fine_fixed, uint8_t *coarse_fixed,
                                      const pliant_tet_material *fine_material, const int32_t *coarse_of_fine,
                                      pliant_progress progress)
{
    const bool schur = scene->model.method == PLIANT_SCHUR;
    const pliant_submesh_extent extent = schur ? scene->model.submesh : PLIANT_SUBMESH_OVERLAP;
    pliant_cube_work work = {.system = system,
                             .material = fine_material,
                             .fixed = fine_fixed};
    pliant_status status = find_elements(&work, coarse_of_fine);
    if (status == PLIANT_OK) status = find_fine_cubes(&work);
    if (status == PLIANT_OK && schur) status = pliant_cubes_schur_begin(&work, extent);
    else if (status == PLIANT_OK)
        status = pliant_submesh_list(fine, work.element_of_fine, system->macros->count, extent, &work.lists);
    if (status == PLIANT_OK && !schur) status = pliant_upsample_trilinear(system, work.element_of_fine);
    if (status == PLIANT_OK) {
        find_grounded(&work, coarse_fixed);
        status = make_all(&work, progress);
    }
    if (status == PLIANT_OK && schur) status = pliant_shapes_sort(system, CORNERS, work.schur);
    if (status == PLIANT_OK) system->upsample->still = fine_fixed;
    if (status == PLIANT_OK && !schur) status = ground(system->macros);
    if (status == PLIANT_OK) status = hold_empty(system, coarse_fixed);
    if (status == PLIANT_OK && work.linear > 0)
        pliant_log(PLIANT_LOG_INFO,
                   "homogenize: %d of %d coarse hexahedra hold loose fragments and follow their corners linearly",
                   work.linear, system->macros->count);
    pliant_submesh_lists_free(&work.lists);
    pliant_shapes_free(work.schur, system->macros ? system->macros->count : 0);
    PLIANT_FREE(work.element_of_tet, work.element_of_fine, work.tet_of_element, work.cubes, work.cube_of_tet,
                work.shapes);
    return status;
}
