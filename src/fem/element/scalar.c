/* Scalar fields for display: stress, energy and volume of the fine tetrahedra, averaged at the nodes. */
#include "base/fail.h"
#include "fem/element/hexahedra.h"
#include "fem/element/law.h"
#include "fem/element/rotation.h"
#include "fem/element/scalar.h"
#include "fem/element/tensors.h"
#include "fem/element/volume_change.h"
#include "mesh/mesh.h"
#include "model_data/data.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

/* Input of the scalar fields. */
typedef struct view {
    const pliant_scene *scene;
    const pliant_mesh *mesh;
    const double *positions;
    int32_t (*corner)[8]; /* (leaves) of an octree's hexahedra, -1 of other leaves; NULL: no octree of hexahedra */
    /* (num_tets) Nullable: tetrahedra with pressures: their moduli, and the volume change on which the pressure acts */
    pliant_tet_material *soft;
    double *change;
} view;

static void view_free(view *look)
{
    pliant_free(look->corner);
    pliant_free(look->soft);
    pliant_free(look->change);
}

static pliant_status find_pressures(view *look, const pliant_tet_material *material)
{
    const pliant_scene *scene = look->scene;
    const bool fine = scene->model.method == PLIANT_FINE;
    if (!fine || scene->solver.kind == PLIANT_TLED || scene->element.kind == PLIANT_HEXAHEDRA) return PLIANT_OK;
    const pliant_status status = pliant_soft_materials(material, look->mesh->num_tets, &look->soft);
    return look->soft ? pliant_group_changes(look->mesh, look->positions, scene->element.law, &look->change) : status;
}

static pliant_status find_corners(view *look)
{
    const pliant_mesh *mesh = look->mesh;
    pliant_cube *cube;
    int32_t *size, count;
    if (look->scene->element.kind != PLIANT_HEXAHEDRA || !mesh->leaf_of_cell) return PLIANT_OK;
    if (look->scene->solver.kind != PLIANT_TLED) return pliant_octree_corners_find(mesh, &look->corner);
    look->corner = pliant_calloc((size_t)mesh->num_leaves, sizeof *look->corner);
    if (!look->corner) return pliant_fail_memory("the hexahedra");
    memset(look->corner, 0xff, (size_t)mesh->num_leaves * sizeof *look->corner);
    pliant_status status = pliant_octree_cubes_find(mesh, &cube, &size, &count);
    for (int32_t c = 0; status == PLIANT_OK && c < count; c++)
        memcpy(look->corner[pliant_cell_of_tet(mesh, cube[c].tet[0])], cube[c].node, sizeof *look->corner);
    pliant_free(cube);
    pliant_free(size);
    return status;
}

/* Compute F at the middle of a hexahedron. Its five tetrahedra would have opposite changes of volume in nearly
 * incompressible tissue. */
static void cube_deformation(const view *look, const int32_t node[8], double f[9])
{
    const double middle[3] = {0.5, 0.5, 0.5};
    double x[8][3], gradient[8][3];
    for (int v = 0; v < 8; v++) memcpy(x[v], look->mesh->rest + 3 * node[v], sizeof x[v]);
    pliant_cube_gradients(x, middle, gradient);
    for (int m = 0; m < 9; m++) f[m] = 0;
    for (int v = 0; v < 8; v++)
        for (int m = 0; m < 9; m++)
            f[m] += (look->positions[3 * node[v] + m / 3] - look->positions[3 * node[0] + m / 3]) * gradient[v][m % 3];
}

/* Return the rest volume of a tetrahedron, and compute F. */
static double deformation_of(const pliant_mesh *mesh, const double *positions, int32_t tet, double f[9])
{
    double gradients[12], x[12], volume = pliant_mesh_gradients(mesh, tet, gradients);
    for (int v = 0; v < 4; v++) memcpy(x + 3 * v, positions + 3 * mesh->tets[4 * tet + v], 3 * sizeof *x);
    pliant_deformation(x, gradients, f);
    return volume;
}

/* Return the energy density e : s / 2 and compute the stress in the element's frame. The scalar fields do not depend on
 * the frame. */
static double corotational(const double f[9], double lambda, double mu, double stress[6])
{
    double r[9], e[6];
    pliant_rotation_signed_svd(f, r);
    pliant_corotational_strain(f, r, e);
    pliant_corotational_stress(e, lambda, mu, stress);
    double trace = e[0] + e[1] + e[2], shear = e[3] * e[3] + e[4] * e[4] + e[5] * e[5];
    return mu * (e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + 2 * shear) + 0.5 * lambda * trace * trace;
}

/* Return sqrt(3/2 dev : dev). */
static double von_mises(const double stress[6])
{
    double mean = (stress[0] + stress[1] + stress[2]) / 3, sum = 0;
    for (int m = 0; m < 3; m++) sum += pow(stress[m] - mean, 2) + 2 * stress[3 + m] * stress[3 + m];
    return sqrt(1.5 * sum);
}

/* Return the mass change ratio of [C] 13, M = V / J. With the present volume for V it would always be the rest volume.
 * Here V is the rest volume: the ratio of density to rest density, times the rest volume. */
static double mass_change(double volume, double ratio)
{
    const double minimum = 1e-3; /* flat and inverted elements have no ratio */
    return volume / fmax(ratio, minimum);
}

/* Compute F of the element that contains a tetrahedron, and return its volume. */
static double element_deformation(const view *look, int32_t tet, double f[9])
{
    const pliant_mesh *mesh = look->mesh;
    const double volume = deformation_of(mesh, look->positions, tet, f);
    pliant_cube cube;
    if (look->corner) {
        const int32_t *node = look->corner[pliant_cell_of_tet(mesh, tet)];
        if (node[0] >= 0) cube_deformation(look, node, f);
    } else if (look->scene->element.kind == PLIANT_HEXAHEDRA && mesh->lattice_of_tet &&
               pliant_cube_of(mesh, tet, &cube)) {
        cube_deformation(look, cube.node, f);
    }
    return volume;
}

/* Minimum fraction of tissue in an element. Below it, the empty part contributes significantly to the element's
 * moduli. */
static const double min_part = 0.01;

/* Compute stress and energy density of the scene's elements. The stress of the corotational law is in the element's
 * axes, others are in world axes. */
static double respond(const view *look, int32_t tet, const double f[9], const pliant_tet_material *material,
                      double stress[6])
{
    const pliant_scene *scene = look->scene;
    const bool tled = scene->solver.kind == PLIANT_TLED;
    const pliant_law law = tled ? scene->tled.law : PLIANT_LAW_NEO_HOOKEAN;
    const double lambda = look->soft ? look->soft[tet].lambda : material->lambda;
    const double pressure = look->soft ? (material->lambda - lambda) * look->change[tet] : 0;
    double energy;
    if (!tled && scene->element.law == PLIANT_ELASTICITY_COROTATIONAL) {
        energy = corotational(f, lambda, material->mu, stress);
    } else {
        pliant_law_cauchy(law, lambda, material->mu, f, stress);
        energy = pliant_law_response(law, lambda, material->mu, f, NULL);
    }
    if (!look->soft) return energy;
    for (int d = 0; d < 3; d++) stress[d] += pressure;
    return energy + 0.5 * pressure * look->change[tet];
}

/* Return the fraction of the tissue's moduli that an element has: it may hold air, or be a fragment. */
static double tissue_part(const pliant_tet_material *material)
{
    return material->tissue > 0 ? fmax(material->tissue, min_part) : 1;
}

static_assert(PLIANT_COUNT_OF(PLIANT_SCALAR_LIST) == 7, "a new scalar needs its value in measure()");

static double measure(const view *look, int32_t tet, const double f[9], double volume,
                      const pliant_tet_material *material, pliant_scalar scalar)
{
    double stress[6], values[3];
    if (scalar == PLIANT_SCALAR_VOLUME_RATIO) return pliant_determinant(f);
    if (scalar == PLIANT_SCALAR_MASS_CHANGE) return mass_change(volume, pliant_determinant(f));
    const double energy = respond(look, tet, f, material, stress);
    if (scalar == PLIANT_SCALAR_STRAIN_ENERGY) return energy;
    if (scalar == PLIANT_SCALAR_VON_MISES) return von_mises(stress) / tissue_part(material);
    pliant_symmetric_eigenvalues(stress, values);
    return values[2] / tissue_part(material);
}

/* Convert xx yy zz xy xz yz to nine numbers, rotated by r. */
static void turn(const double stress[6], const double r[9], float out[9])
{
    const double t[9] = {stress[0], stress[3], stress[4], stress[3], stress[1],
                         stress[5], stress[4], stress[5], stress[2]};
    for (int m = 0; m < 9; m++) {
        double sum = 0;
        for (int a = 0; a < 9; a++) sum += r[3 * (m / 3) + a / 3] * t[a] * r[3 * (m % 3) + a % 3];
        out[m] = (float)sum;
    }
}

pliant_status pliant_tet_tensors(const pliant_model *model, const pliant_body *body, const double *positions,
                                 float *stress, float *strain)
{
    const pliant_mesh *mesh = &body->fine;
    view look = {.scene = &model->scene, .mesh = mesh, .positions = positions};
    pliant_status status = find_corners(&look);
    if (status == PLIANT_OK) status = find_pressures(&look, body->fine_material);
    for (int32_t t = 0; status == PLIANT_OK && t < mesh->num_tets; t++) {
        const pliant_tet_material *material = body->fine_material + t;
        double f[9], r[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, s[6];
        element_deformation(&look, t, f);
        respond(&look, t, f, material, s);
        for (int m = 0; m < 6; m++) s[m] /= tissue_part(material);
        if (model->scene.solver.kind != PLIANT_TLED) pliant_rotation_signed_svd(f, r);
        turn(s, r, stress + 9 * (size_t)t);
        for (int m = 0; m < 9; m++) {
            double e = m % 4 == 0 ? -1 : 0;
            for (int a = 0; a < 3; a++) e += f[3 * a + m / 3] * f[3 * a + m % 3];
            strain[9 * (size_t)t + (size_t)m] = (float)(0.5 * e);
        }
    }
    view_free(&look);
    return status;
}

/* Convert nodes from the order of corner bits to VTK's order, where the first four nodes are below the others. */
static void order_hexahedron(const pliant_mesh *mesh, const int32_t node[8], int32_t out[8])
{
    static const int right_handed[8] = {0, 1, 3, 2, 4, 5, 7, 6}, left_handed[8] = {0, 2, 3, 1, 4, 6, 7, 5};
    const bool left = pliant_determinant(mesh->direction) < 0;
    for (int v = 0; v < 8; v++) out[v] = node[left ? left_handed[v] : right_handed[v]];
}

pliant_status pliant_tet_hexahedra(const pliant_model *model, const pliant_body *body, int32_t (*out)[8])
{
    const pliant_mesh *mesh = &body->fine;
    view look = {.scene = &model->scene, .mesh = mesh};
    pliant_status status = find_corners(&look);
    uint8_t *visited = look.corner ? pliant_calloc((size_t)mesh->num_leaves, 1) : NULL;
    if (status == PLIANT_OK && look.corner && !visited) status = pliant_fail_memory("the hexahedra");
    for (int32_t t = 0; status == PLIANT_OK && t < mesh->num_tets; t++) {
        const bool lattice = look.scene->element.kind == PLIANT_HEXAHEDRA && mesh->lattice_of_tet;
        const int32_t leaf = look.corner ? pliant_cell_of_tet(mesh, t) : -1;
        pliant_cube cube;
        out[t][0] = PLIANT_IS_TETRAHEDRON;
        if (leaf >= 0 && look.corner[leaf][0] >= 0) {
            if (visited[leaf]) out[t][0] = PLIANT_IN_HEXAHEDRON;
            else order_hexahedron(mesh, look.corner[leaf], out[t]);
            visited[leaf] = 1;
        } else if (lattice && pliant_cube_of(mesh, t, &cube)) {
            int32_t first = t;
            for (int slot = 0; slot < 5; slot++) first = cube.tet[slot] < first ? cube.tet[slot] : first;
            if (first < t) out[t][0] = PLIANT_IN_HEXAHEDRON;
            else order_hexahedron(mesh, cube.node, out[t]);
        }
    }
    pliant_free(visited);
    view_free(&look);
    return status;
}

pliant_status pliant_data_tet_scalar(const pliant_model *model, const pliant_body *body, const double *positions,
                                     pliant_scalar scalar, float *out)
{
    const pliant_mesh *mesh = &body->fine;
    const bool none = scalar == PLIANT_SCALAR_NONE || scalar == PLIANT_SCALAR_CONTACT_FORCE;
    view look = {.scene = &model->scene, .mesh = mesh, .positions = positions};
    pliant_status status = none ? PLIANT_OK : find_corners(&look);
    if (status == PLIANT_OK && !none) status = find_pressures(&look, body->fine_material);
    for (int32_t t = 0; status == PLIANT_OK && t < mesh->num_tets; t++) {
        double f[9], volume = none ? 0 : element_deformation(&look, t, f);
        out[t] = none ? 0 : (float)measure(&look, t, f, volume, body->fine_material + t, scalar);
    }
    view_free(&look);
    return status;
}

pliant_status pliant_data_scalar(const pliant_model *model, const pliant_body *body, const double *positions,
                                 pliant_scalar scalar, float *out)
{
    const pliant_mesh *mesh = &body->fine;
    if (scalar == PLIANT_SCALAR_CONTACT_FORCE)
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "contact_force needs a simulation, not only positions: use pliant_data_get_scalar");
    view look = {.scene = &model->scene, .mesh = mesh, .positions = positions};
    double *sum = pliant_calloc((size_t)mesh->num_nodes, 2 * sizeof *sum);
    pliant_status status = sum ? PLIANT_OK : pliant_fail_memory("the scalar");
    if (status == PLIANT_OK && scalar != PLIANT_SCALAR_NONE) status = find_corners(&look);
    if (status == PLIANT_OK && scalar != PLIANT_SCALAR_NONE) status = find_pressures(&look, body->fine_material);
    for (int32_t t = 0; status == PLIANT_OK && t < mesh->num_tets && scalar != PLIANT_SCALAR_NONE; t++) {
        double f[9], volume = element_deformation(&look, t, f);
        double value = measure(&look, t, f, volume, body->fine_material + t, scalar);
        const bool stress = scalar == PLIANT_SCALAR_VON_MISES || scalar == PLIANT_SCALAR_PRINCIPAL_STRESS;
        /* Average over the tissue's volume. */
        if (stress && body->fine_material[t].tissue > 0) volume *= body->fine_material[t].tissue;
        for (int v = 0; v < 4; v++) {
            sum[2 * mesh->tets[4 * t + v]] += volume * value;
            sum[2 * mesh->tets[4 * t + v] + 1] += volume;
        }
    }
    for (int32_t n = 0; status == PLIANT_OK && n < mesh->num_nodes; n++)
        out[n] = sum[2 * n + 1] > 0 ? (float)(sum[2 * n] / sum[2 * n + 1]) : 0;
    view_free(&look);
    pliant_free(sum);
    return status;
}

int32_t pliant_mesh_inverted(const pliant_mesh *mesh, const double *positions)
{
    int32_t count = 0;
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        double f[9];
        deformation_of(mesh, positions, t, f);
        count += !(pliant_determinant(f) > 0);
    }
    return count;
}
