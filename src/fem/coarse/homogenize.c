/* A 12 x 12 stiffness for every coarse tetrahedron, computed from its fine submesh.
 * - schur: [H] 1 to 7, as published. It is too soft and fails the patch test, since point loads carry the element
 *   (NUMERICS.md).
 * - averaged: the averages of gradient and displacement constrain the submesh (NUMERICS.md). It passes the patch test
 *   and stays bounded under refinement of the fine mesh.
 *
 * A coarse tetrahedron whose submesh contains fixed fine nodes is grounded: it keeps R = I. Its stiffness has no rigid
 * null space, so corotation would be wrong (NUMERICS.md). */
#include "base/fail.h"
#include "base/threads.h"
#include "base/dense.h"
#include "fem/coarse/shape_functions.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

static void symmetrize(double k[144])
{
    for (int i = 0; i < 12; i++)
        for (int j = 0; j < i; j++) k[12 * i + j] = k[12 * j + i] = 0.5 * (k[12 * i + j] + k[12 * j + i]);
}

/* Compute the Galerkin product with linear interpolation and fixed nodes held: (masked P)' K (masked P). */
static void galerkin_stiffness(pliant_submesh *submesh, int32_t tet, double out[144])
{
    int32_t size = 3 * submesh->num_nodes;
    double *shape = submesh->work; /* (num_nodes x 4) */
    for (int32_t n = 0; n < submesh->num_nodes; n++) {
        pliant_mesh_barycentric(submesh->coarse, tet, submesh->fine->rest + 3 * submesh->node[n], shape + 4 * n);
        if (submesh->fixed[submesh->node[n]]) memset(shape + 4 * n, 0, 4 * sizeof *shape);
    }
    memset(out, 0, 144 * sizeof *out);
    for (int32_t i = 0; i < size; i++)
        for (int32_t j = 0; j < size; j++) {
            double k = submesh->stiffness[(size_t)i * size + j];
            if (k == 0) continue;
            for (int a = 0; a < 4; a++)
                for (int b = 0; b < 4; b++)
                    out[12 * (3 * a + i % 3) + 3 * b + j % 3] += shape[4 * (i / 3) + a] * k * shape[4 * (j / 3) + b];
        }
}

/* Compute weighted averages over the submesh: rows 0 to 8 of the gradient (row 3 r + c: du_r/dx_c), rows 9 to 11 of the
 * displacement.
 * @param phi  Out: (size x 12) their transpose on the fine unknowns.
 * @param a    Out: (12 x 12) the same for the coarse element's linear field. */
static void average_rows(const pliant_submesh *submesh, int32_t tet, double *phi, double a[144])
{
    const pliant_mesh *fine = submesh->fine, *coarse = submesh->coarse;
    double total = 0, centre[3] = {0, 0, 0};
    memset(phi, 0, 3 * (size_t)submesh->num_nodes * 12 * sizeof *phi);
    for (int32_t t = 0; t < submesh->num_tets; t++) {
        const int32_t *nodes = fine->tets + 4 * submesh->tets[t];
        double g[12];
        double volume = pliant_mesh_gradients(fine, submesh->tets[t], g);
        /* Weight: volume times fraction of tissue. Otherwise air next to tissue would dominate the average
         * (NUMERICS.md). */
        double weight = volume * (submesh->material[submesh->tets[t]].tissue + 1e-3);
        total += weight;
        for (int v = 0; v < 4; v++) {
            double *row = phi + 36 * (size_t)submesh->local_of[nodes[v]];
            for (int r = 0; r < 3; r++) {
                for (int c = 0; c < 3; c++) row[12 * r + 3 * r + c] += weight * g[3 * v + c];
                row[12 * r + 9 + r] += 0.25 * weight;
                centre[r] += 0.25 * weight * fine->rest[3 * nodes[v] + r];
            }
        }
    }
    for (size_t m = 0; m < 36 * (size_t)submesh->num_nodes; m++) phi[m] /= total;
    for (int d = 0; d < 3; d++) centre[d] /= total;
    const int32_t *nodes = coarse->tets + 4 * tet;
    double g[12];
    pliant_mesh_gradients(coarse, tet, g);
    memset(a, 0, 144 * sizeof *a);
    for (int v = 0; v < 4; v++) {
        double fraction = v == 0;
        for (int d = 0; d < 3; d++) fraction += g[3 * v + d] * (centre[d] - coarse->rest[3 * nodes[0] + d]);
        for (int r = 0; r < 3; r++) {
            for (int c = 0; c < 3; c++) a[12 * (3 * r + c) + 3 * v + r] = g[3 * v + c];
            a[12 * (9 + r) + 3 * v + r] = fraction;
        }
    }
}

/* Compute the rigid modes about the first node, scaled to the size of the submesh: (size x 6). */
static void rigid_modes(const pliant_submesh *submesh, double *modes)
{
    const double *rest = submesh->fine->rest, *origin = rest + 3 * submesh->node[0];
    double length = submesh->coarse->cell_size[0];
    memset(modes, 0, 18 * (size_t)submesh->num_nodes * sizeof *modes);
    for (int32_t n = 0; n < submesh->num_nodes; n++) {
        const double *x = rest + 3 * submesh->node[n];
        double y[3] = {(x[0] - origin[0]) / length, (x[1] - origin[1]) / length, (x[2] - origin[2]) / length};
        double *m = modes + 18 * (size_t)n;
        for (int d = 0; d < 3; d++) {
            m[6 * d + d] = 1;
            int p = (d + 1) % 3, q = (d + 2) % 3;
            m[6 * p + 3 + d] = -y[q];
            m[6 * q + 3 + d] = y[p];
        }
    }
}

/* Soft constraints on rigid modes replace six supports: a support at the edge of the submesh could be in air. */
bool pliant_submesh_factor(pliant_submesh *submesh, double *modes)
{
    rigid_modes(submesh, modes);
    int32_t size = 3 * submesh->num_nodes;
    double trace = 0;
    memcpy(submesh->square, submesh->stiffness, (size_t)size * size * sizeof *submesh->square);
    for (int32_t i = 0; i < size; i++) trace += submesh->stiffness[(size_t)i * size + i];
    double scale = trace / size / submesh->num_nodes;
    for (int32_t i = 0; i < size; i++)
        for (int32_t j = 0; j < size; j++) {
            double sum = 0;
            for (int m = 0; m < 6; m++) sum += modes[6 * i + m] * modes[6 * j + m];
            submesh->square[(size_t)i * size + j] += scale * sum;
        }
    return pliant_dense_cholesky(size, submesh->square);
}

/* Minimize u' K u / 2 under Phi' u = A u_c with a free boundary. With Z = K^+ Phi: [Phi'Z, Phi'R; R'Phi, 0] [mu; q] =
 * [A; 0], and K_c = A' mu (NUMERICS.md). */
static bool averaged_stiffness(pliant_submesh *submesh, int32_t tet, double out[144])
{
    int32_t size = 3 * submesh->num_nodes;
    double a[144], *phi = submesh->work, *z = phi + (size_t)size * 12, *modes = z + (size_t)size * 12;
    average_rows(submesh, tet, phi, a);
    if (!pliant_submesh_factor(submesh, modes)) return false;
    memcpy(z, phi, (size_t)size * 12 * sizeof *z);
    pliant_dense_cholesky_solve(size, submesh->square, 12, z);
    double matrix[324] = {0}, right[216] = {0};
    for (int32_t i = 0; i < size; i++)
        for (int m = 0; m < 12; m++) {
            double p = phi[12 * i + m];
            if (p == 0) continue;
            for (int n = 0; n < 12; n++) matrix[18 * m + n] += p * z[12 * i + n];
            for (int n = 0; n < 6; n++) matrix[18 * m + 12 + n] += p * modes[6 * i + n];
        }
    /* The compliance rows are many orders of magnitude smaller than the geometric rows; scale them. */
    double scale = 0;
    for (int m = 0; m < 12; m++) scale = fmax(scale, matrix[19 * m]);
    for (int m = 0; m < 12; m++) {
        for (int n = 0; n < 12; n++) matrix[18 * m + n] /= scale;
        for (int n = 0; n < 6; n++) matrix[18 * (12 + n) + m] = matrix[18 * m + 12 + n];
        memcpy(right + 12 * m, a + 12 * m, 12 * sizeof *right);
    }
    if (!pliant_dense_solve(18, matrix, 12, right)) return false;
    for (int i = 0; i < 12; i++)
        for (int j = 0; j < 12; j++) {
            out[12 * i + j] = 0;
            for (int m = 0; m < 12; m++) out[12 * i + j] += a[12 * m + i] * right[12 * m + j] / scale;
        }
    symmetrize(out);
    return true;
}

/* Return whether a 12 x 12 stiffness is positive semidefinite up to rounding. An indefinite stiffness would make the
 * solver diverge. Rounding can cause it: fragments that touch only at an edge or a corner move without force. Neither
 * averages nor corners then determine their shape. */
static bool is_semidefinite(const double k[144])
{
    double shifted[144], trace = 0;
    bool any = false; /* a completely fixed submesh has zero stiffness */
    for (int i = 0; i < 12; i++) trace += k[13 * i];
    for (int m = 0; m < 144; m++) any = any || k[m] != 0;
    memcpy(shifted, k, sizeof shifted);
    for (int i = 0; i < 12; i++) shifted[13 * i] += 1e-7 * trace;
    return !any || (isfinite(trace) && pliant_dense_cholesky(12, shifted));
}

static void find_corners(const pliant_submesh *submesh, int32_t tet, int32_t corner[4])
{
    for (int v = 0; v < 4; v++) corner[v] = pliant_submesh_corner(submesh, submesh->coarse->tets[4 * tet + v]);
}

/* Return whether the submesh has a node at every corner. A fragment without one cannot be condensed, and its nodes
 * follow the corners linearly. */
static bool has_corners(const pliant_submesh *submesh, int32_t tet)
{
    int32_t corner[4];
    find_corners(submesh, tet, corner);
    return corner[0] >= 0 && corner[1] >= 0 && corner[2] >= 0 && corner[3] >= 0;
}

static void linear_shapes(const pliant_submesh *submesh, int32_t tet, double *shape)
{
    memset(shape, 0, 36 * (size_t)submesh->num_nodes * sizeof *shape);
    for (int32_t n = 0; n < submesh->num_nodes; n++) {
        double weights[4];
        if (submesh->fixed[submesh->node[n]]) continue;
        pliant_mesh_barycentric(submesh->coarse, tet, submesh->fine->rest + 3 * submesh->node[n], weights);
        for (int v = 0; v < 4; v++)
            for (int d = 0; d < 3; d++) shape[36 * (size_t)n + (size_t)(12 * d + 3 * v + d)] = weights[v];
    }
}

static bool schur_stiffness(pliant_submesh *submesh, int32_t tet, double out[144], double *shape)
{
    int32_t corner[4];
    find_corners(submesh, tet, corner);
    return pliant_submesh_condense(submesh, 4, corner, out, shape);
}

pliant_status pliant_schur_tet(pliant_submesh *submesh, int32_t tet, double out[144], double *shape)
{
    if (!has_corners(submesh, tet)) {
        linear_shapes(submesh, tet, shape);
        galerkin_stiffness(submesh, tet, out);
        return PLIANT_OK;
    }
    if (schur_stiffness(submesh, tet, out, shape) && is_semidefinite(out)) return PLIANT_OK;
    /* The shape functions would be equally wrong, so another stiffness cannot replace this one. */
    return pliant_fail(PLIANT_ERROR_NUMERIC,
                       "schur: the submesh of coarse tetrahedron %d cannot be condensed on its corners to a "
                       "positive semidefinite stiffness; use averaged",
                       tet);
}

typedef struct homogenization {
    pliant_system *system;
    const pliant_submesh_lists *lists;
    pliant_shapes *shapes; /* Nullable: averaged */
    int32_t galerkin;      /* coarse tetrahedra with a disconnected submesh: linear interpolation instead */
} homogenization;

pliant_status pliant_averaged_tet(pliant_submesh *submesh, int32_t tet, bool grounded, double out[144], bool *linear)
{
    *linear = grounded || !averaged_stiffness(submesh, tet, out) || !is_semidefinite(out);
    if (!*linear) return PLIANT_OK;
    galerkin_stiffness(submesh, tet, out);
    if (is_semidefinite(out)) return PLIANT_OK;
    return pliant_fail(PLIANT_ERROR_NUMERIC,
                       "the stiffness in coarse tetrahedron %d is not positive semidefinite; Young's moduli must "
                       "be positive, and Poisson's ratios in [0, 0.4999]",
                       tet);
}

static pliant_status homogenize_one(homogenization *work, pliant_submesh *submesh, int32_t tet)
{
    const pliant_submesh_lists *lists = work->lists;
    double *out = work->system->stiffness + 144 * (size_t)tet;
    pliant_status status =
        pliant_submesh_load(submesh, lists->start[tet + 1] - lists->start[tet], lists->tets + lists->start[tet]);
    if (status != PLIANT_OK) return status;
    bool fixed = pliant_submesh_has_fixed(submesh);
    work->system->grounded[tet] = fixed;
    if (work->shapes) {
        status = pliant_shapes_of(submesh, 4, work->shapes + tet);
        return status == PLIANT_OK ? pliant_schur_tet(submesh, tet, out, work->shapes[tet].shape) : status;
    }
    bool linear;
    status = pliant_averaged_tet(submesh, tet, fixed, out, &linear);
    if (status == PLIANT_OK && linear && !fixed) {
#pragma omp atomic
        work->galerkin++;
    }
    return status;
}

/* Fraction of the mean stiffness that is added to the corners of grounded elements. Corners that move no free fine node
 * would otherwise have no stiffness. */
static const double ground_stiffness = 1e-4;

static void ground(pliant_system *system)
{
    double sum = 0;
    int32_t count = system->mesh->num_tets;
    for (size_t c = 0; c < (size_t)count; c++)
        for (size_t i = 0; i < 12; i++) system->raw_diagonal[12 * c + i] = system->stiffness[144 * c + 13 * i];
    for (size_t c = 0; c < (size_t)count; c++)
        for (int i = 0; i < 12; i++) sum += system->stiffness[144 * c + 13 * i];
    double fraction = ground_stiffness * sum / (12.0 * count);
    for (size_t c = 0; c < (size_t)count; c++)
        for (int i = 0; system->grounded[c] && i < 12; i++) system->stiffness[144 * c + 13 * i] += fraction;
}

static pliant_status homogenize_all(homogenization *work, const uint8_t *fine_fixed,
                                    const pliant_tet_material *material, pliant_progress progress)
{
    pliant_system *system = work->system;
    pliant_work all = {.what = "homogenization",
                       .stage = "homogenize",
                       .progress = progress,
                       .end = 1,
                       .count = system->mesh->num_tets,
                       .interval = 64};
#pragma omp parallel num_threads(system->num_threads)
    {
        pliant_submesh *submesh = NULL;
        pliant_status status =
            pliant_submesh_create(system->fine, system->mesh, fine_fixed, material, work->lists->largest, &submesh);
#pragma omp for schedule(dynamic, 8)
        for (int32_t tet = 0; tet < all.count; tet++) {
            if (status == PLIANT_OK) status = homogenize_one(work, submesh, tet);
            if (status == PLIANT_OK) status = pliant_work_finish_item(&all);
        }
        pliant_submesh_free(submesh);
        pliant_work_finish_thread(&all, status);
    }
    return pliant_work_result(&all);
}

static pliant_status reserve_capacity(homogenization *work, bool schur)
{
    pliant_system *system = work->system;
    const size_t count = (size_t)system->mesh->num_tets;
    system->stiffness = pliant_calloc(count, 144 * sizeof *system->stiffness);
    system->grounded = pliant_calloc((size_t)system->num_blocks * LANES, sizeof *system->grounded);
    if (schur) work->shapes = pliant_calloc(count, sizeof *work->shapes);
    else system->raw_diagonal = pliant_calloc(count, 12 * sizeof *system->raw_diagonal);
    bool good = system->stiffness && system->grounded && (schur ? work->shapes != NULL : system->raw_diagonal != NULL);
    return good ? PLIANT_OK : pliant_fail_memory("the homogenized stiffness");
}

pliant_status pliant_homogenize(pliant_system *system, const pliant_scene *scene, const pliant_mesh *fine,
                                const uint8_t *fine_fixed, const pliant_tet_material *fine_material,
                                const int32_t *coarse_of_fine, pliant_progress progress)
{
    const int32_t count = system->mesh->num_tets;
    const bool schur = scene->model.method == PLIANT_SCHUR;
    const pliant_submesh_extent extent = schur ? scene->model.submesh : PLIANT_SUBMESH_OVERLAP;
    pliant_submesh_lists lists = {0};
    homogenization work = {.system = system, .lists = &lists};
    pliant_status status = pliant_submesh_list(fine, coarse_of_fine, count, extent, &lists);
    if (status == PLIANT_OK) status = reserve_capacity(&work, schur);
    if (status == PLIANT_OK) status = homogenize_all(&work, fine_fixed, fine_material, progress);
    if (status == PLIANT_OK) {
        if (!schur) ground(system);
        if (work.galerkin > 0)
            pliant_log(PLIANT_LOG_INFO,
                       "homogenize: %d of %d coarse tetrahedra hold loose fragments and follow their corners linearly",
                       work.galerkin, count);
        status = schur ? pliant_shapes_sort(system, 4, work.shapes) : pliant_upsample_linear(system, coarse_of_fine);
    }
    if (status == PLIANT_OK) system->upsample->still = fine_fixed;
    pliant_shapes_free(work.shapes, count);
    pliant_submesh_lists_free(&lists);
    return status;
}
