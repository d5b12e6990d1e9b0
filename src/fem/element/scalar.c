/* Numbers for people to look at: stress, energy, volume of the fine tetrahedra, brought to the nodes. */
#include "base/fail.h"
#include "fem/element/hexahedra.h"
#include "fem/element/law.h"
#include "fem/element/rotation.h"
#include "state/data.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

/* F at the middle of the cube of a tetrahedron, where that is a hexahedron; f stays elsewhere. Five tetrahedra of nearly incompressible tissue change
 * their volumes against each other where the cube does not. */
static void cube_deformation(const pliant_mesh *mesh, const double *positions, int32_t tet, double f[9])
{
    const double middle[3] = {0.5, 0.5, 0.5};
    double x[8][3], gradient[8][3];
    pliant_cube cube;
    if (!pliant_cube_of(mesh, tet, &cube)) return;
    for (int v = 0; v < 8; v++) memcpy(x[v], mesh->rest + 3 * cube.node[v], sizeof x[v]);
    pliant_cube_gradients(x, middle, gradient);
    for (int m = 0; m < 9; m++) f[m] = 0;
    for (int v = 0; v < 8; v++)
        for (int m = 0; m < 9; m++) f[m] += (positions[3 * cube.node[v] + m / 3] - positions[3 * cube.node[0] + m / 3]) * gradient[v][m % 3];
}

/* rest volume, and F */
static double deformation_of(const pliant_mesh *mesh, const double *positions, int32_t tet, double f[9])
{
    double gradients[12], x[12], volume = pliant_mesh_gradients(mesh, tet, gradients);
    for (int v = 0; v < 4; v++) memcpy(x + 3 * v, positions + 3 * mesh->tets[4 * tet + v], 3 * sizeof *x);
    pliant_deformation(x, gradients, f);
    return volume;
}

/* stress in the element's frame, energy density e : s / 2; nothing of what is asked for depends on the frame */
static double corotational(const double f[9], const pliant_tet_material *material, double stress[6])
{
    double r[9], e[6];
    pliant_rotation_signed_svd(f, r);
    pliant_corotational_strain(f, r, e);
    pliant_corotational_stress(e, material->lambda, material->mu, stress);
    double trace = e[0] + e[1] + e[2], shear = e[3] * e[3] + e[4] * e[4] + e[5] * e[5];
    return material->mu * (e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + 2 * shear) + 0.5 * material->lambda * trace * trace;
}

/* sqrt(3/2 dev : dev) */
static double von_mises(const double stress[6])
{
    double mean = (stress[0] + stress[1] + stress[2]) / 3, sum = 0;
    for (int m = 0; m < 3; m++) sum += pow(stress[m] - mean, 2) + 2 * stress[3 + m] * stress[3 + m];
    return sqrt(1.5 * sum);
}

/* [C] 13, M = V / J, calls this a mass change ratio. With the volume of now for V it would be the rest volume, always; so it is read with
 * the rest volume: density over that at rest, times the rest volume. */
static double mass_change(double volume, double ratio)
{
    const double least = 1e-3; /* flat and inverted elements have none */
    return volume / fmax(ratio, least);
}

/* the same of the element that it is part of */
static double element_deformation(const pliant_scene *scene, const pliant_mesh *mesh, const double *positions, int32_t tet, double f[9])
{
    double volume = deformation_of(mesh, positions, tet, f);
    if (scene->element.kind == PLIANT_HEXAHEDRA && mesh->lattice_of_tet) cube_deformation(mesh, positions, tet, f);
    return volume;
}

static double measure(const pliant_scene *scene, const double f[9], double volume, const pliant_tet_material *material, pliant_scalar scalar)
{
    double stress[6], values[3], energy;
    if (scalar == PLIANT_SCALAR_VOLUME_RATIO) return pliant_determinant(f);
    if (scalar == PLIANT_SCALAR_MASS_CHANGE) return mass_change(volume, pliant_determinant(f));
    if (scene->solver.kind == PLIANT_TLED) {
        energy = pliant_law_response(scene->tled.law, material->lambda, material->mu, f, NULL);
        pliant_law_cauchy(scene->tled.law, material->lambda, material->mu, f, stress);
    } else {
        energy = corotational(f, material, stress);
    }
    if (scalar == PLIANT_SCALAR_STRAIN_ENERGY) return energy;
    if (scalar == PLIANT_SCALAR_VON_MISES) return von_mises(stress);
    pliant_symmetric_eigenvalues(stress, values);
    return values[2];
}

void pliant_data_tet_scalar(const pliant_model *model, const pliant_body *body, const double *positions, pliant_scalar scalar, float *out)
{
    const pliant_mesh *mesh = &body->fine;
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        double f[9], volume = element_deformation(&model->scene, mesh, positions, t, f);
        out[t] = scalar == PLIANT_SCALAR_NONE || scalar == PLIANT_SCALAR_CONTACT_FORCE ? 0 : (float)measure(&model->scene, f, volume, body->fine_material + t, scalar);
    }
}

pliant_status pliant_data_scalar(const pliant_model *model, const pliant_body *body, const double *positions, pliant_scalar scalar, float *out)
{
    const pliant_mesh *mesh = &body->fine;
    if (scalar == PLIANT_SCALAR_CONTACT_FORCE)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "contact_force is of a simulation, not of positions: pliant_data_get_scalar tells it");
    double *sum = pliant_calloc((size_t)mesh->num_nodes, 2 * sizeof *sum);
    if (!sum) return pliant_fail_memory("the scalar");
    for (int32_t t = 0; t < mesh->num_tets && scalar != PLIANT_SCALAR_NONE; t++) {
        double f[9], volume = element_deformation(&model->scene, mesh, positions, t, f);
        double value = measure(&model->scene, f, volume, body->fine_material + t, scalar);
        for (int v = 0; v < 4; v++) {
            sum[2 * mesh->tets[4 * t + v]] += volume * value;
            sum[2 * mesh->tets[4 * t + v] + 1] += volume;
        }
    }
    for (int32_t n = 0; n < mesh->num_nodes; n++) out[n] = sum[2 * n + 1] > 0 ? (float)(sum[2 * n] / sum[2 * n + 1]) : 0;
    pliant_free(sum);
    return PLIANT_OK;
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
