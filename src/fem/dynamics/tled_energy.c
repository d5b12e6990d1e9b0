/* Energies of the whole body in double precision, for checks and reports. */
#include "fem/dynamics/tled_cubes.h"
#include "fem/dynamics/tled_pressure.h"
#include "mesh/mesh.h"

/* Return the materials of the elements, without the part of lambda that acts as pressures. */
static const pliant_tet_material *own_material(const pliant_tled *tled, const pliant_tet_material *material)
{
    return tled->system->groups ? tled->system->groups->soft : material;
}

/* @param back  Number of increments to subtract: 0 or 1. */
static void deformation_of(const pliant_tled *tled, const int32_t nodes[4], const double g[12], double back,
                           double f[9])
{
    for (int m = 0; m < 9; m++) f[m] = m % 4 == 0;
    for (int v = 0; v < 4; v++)
        for (int r = 0; r < 3; r++) {
            double u = tled->u[3 * nodes[v] + r] - back * tled->d[3 * nodes[v] + r];
            for (int c = 0; c < 3; c++) f[3 * r + c] += u * g[3 * v + c];
        }
}

/* Compute F of a cube and its hourglass modes. */
static void modes_of(const pliant_tled *tled, int32_t index, double back, double f[9], double w[8][3])
{
    const pliant_tled_cubes *cubes = tled->system->cubes;
    const pliant_cube *cube = cubes->cube + index;
    for (int m = 0; m < 8; m++)
        for (int r = 0; r < 3; r++) {
            w[m][r] = 0;
            for (int v = 0; v < 8; v++) {
                double sign = 1, u = tled->u[3 * cube->node[v] + r] - back * tled->d[3 * cube->node[v] + r];
                for (int d = 0; d < 3; d++) sign *= m >> d & 1 ? (v >> d & 1 ? 1 : -1) : 1;
                w[m][r] += sign * u;
            }
        }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            f[3 * r + c] = r == c;
            for (int axis = 0; axis < 3; axis++)
                f[3 * r + c] +=
                    w[1 << axis][r] * cubes->gradient[3 * axis + c] / (cubes->size ? cubes->size[index] : 1);
        }
}

/* Return the energy of the modes that F does not contain, divided by V mu finer^2 (cube_bending.h). force: out: its
 * derivative by w, and by the modes along the axes. */
static double bending_energy(const pliant_tled_cubes *cubes, int32_t index, double w[8][3], double force[8][3])
{
    const pliant_cube_bending *bending = &cubes->bending;
    double f[9], y[9], q[9], energy = 0;
    for (int m = 0; m < 9; m++)
        f[m] = bending->direction[m] +
               0.25 * bending->edge[m / 3] * w[1 << m / 3][m % 3] / (cubes->size ? cubes->size[index] : 1);
    for (int m = 0; m < 9; m++) {
        y[m] = 0;
        for (int r = 0; r < 3; r++) y[m] += f[3 * (m % 3) + r] * w[7 ^ 1 << m / 3][r];
    }
    pliant_cube_bending_double(bending, (double)cubes->moduli[index / LANES][2][index % LANES], y, q);
    for (int m = 0; m < 9; m++) energy += 0.5 * q[m] * y[m];
    for (int r = 0; r < 3; r++) {
        force[0][r] = 0;
        force[7][r] = (double)bending->twist * w[7][r];
        energy += 0.5 * force[7][r] * w[7][r];
        for (int k = 0; k < 3; k++) {
            const int mode = 7 ^ 1 << k;
            force[mode][r] = (double)bending->minimum * w[mode][r];
            energy += 0.5 * force[mode][r] * w[mode][r];
            for (int a = 0; a < 3; a++) force[mode][r] += q[3 * k + a] * f[3 * a + r];
            force[1 << k][r] = 0;
            for (int other = 0; other < 3; other++) force[1 << k][r] += q[3 * other + k] * w[7 ^ 1 << other][r];
            force[1 << k][r] *= 0.25 * bending->edge[k] / (cubes->size ? cubes->size[index] : 1);
        }
    }
    return energy;
}

/* State of an element, at present or one increment ago. mode: hourglass modes of a hexahedron; force: gradient of their
 * energy by all modes. */
typedef struct element_state {
    double energy, f[9], stress[9], mode[8][3], force[8][3];
} element_state;

/* Constants of a hexahedron. bent: V mu divided by the squared edge in smallest cells. */
typedef struct cube_constants {
    double volume, lambda, mu, bent;
} cube_constants;

static cube_constants constants_of(const pliant_tled_system *system, const pliant_tet_material *material, int32_t index)
{
    const double finer = 1.0 / (system->cubes->size ? system->cubes->size[index] : 1);
    cube_constants out;
    double density;
    out.volume =
        pliant_tled_cube_mean(system->mesh, system->cubes->cube + index, material, &out.lambda, &out.mu, &density);
    out.bent = out.volume * out.mu * finer * finer;
    return out;
}

static void cube_state(const pliant_tled *tled, const cube_constants *constants, int32_t index, double back,
                       element_state *out)
{
    const pliant_tled_system *system = tled->system;
    modes_of(tled, index, back, out->f, out->mode);
    out->energy =
        constants->volume * pliant_law_response(system->law, constants->lambda, constants->mu, out->f, out->stress);
    out->energy += constants->bent * bending_energy(system->cubes, index, out->mode, out->force);
}

static double tet_state(const pliant_tled *tled, const pliant_tet_material *material, int32_t tet, double back,
                        double g[12], element_state *out)
{
    const double volume = pliant_mesh_gradients(tled->system->mesh, tet, g);
    deformation_of(tled, tled->system->mesh->tets + 4 * (size_t)tet, g, back, out->f);
    out->energy =
        volume * pliant_law_response(tled->system->law, material[tet].lambda, material[tet].mu, out->f, out->stress);
    return volume;
}

static void cube_energies(const pliant_tled *tled, const pliant_tet_material *material, int32_t index, double *strain,
                          double *before, double *work)
{
    const cube_constants constants = constants_of(tled->system, material, index);
    element_state now, was;
    cube_state(tled, &constants, index, 0, &now);
    cube_state(tled, &constants, index, 1, &was);
    *strain += now.energy;
    *before += was.energy;
    for (int m = 0; m < 9; m++) *work += constants.volume * (now.stress[m] - was.stress[m]) * (now.f[m] - was.f[m]);
    for (int m = 0; m < 8; m++)
        for (int r = 0; r < 3; r++)
            *work += constants.bent * (now.force[m][r] - was.force[m][r]) * (now.mode[m][r] - was.mode[m][r]);
}

static void tet_energies(const pliant_tled *tled, const pliant_tet_material *material, int32_t tet, double *strain,
                         double *before, double *work)
{
    double g[12];
    element_state now, was;
    const double volume = tet_state(tled, material, tet, 0, g, &now);
    tet_state(tled, material, tet, 1, g, &was);
    *strain += now.energy;
    *before += was.energy;
    for (int m = 0; m < 9; m++) *work += volume * (now.stress[m] - was.stress[m]) * (now.f[m] - was.f[m]);
}

/* Compute minus the gradient of a hexahedron's energy. */
static void cube_force(const pliant_tled_cubes *cubes, const cube_constants *constants, int32_t index,
                       const element_state *state, double force[8][3])
{
    const double edge = cubes->size ? cubes->size[index] : 1;
    for (int r = 0; r < 3; r++)
        for (int v = 0; v < 8; v++) {
            double slope = 0;
            for (int m = 0; m < 8; m++) {
                double sign = 1, along = constants->bent * state->force[m][r];
                for (int d = 0; d < 3; d++) sign *= m >> d & 1 ? (v >> d & 1 ? 1 : -1) : 1;
                for (int axis = 0; axis < 3; axis++)
                    for (int c = 0; c < 3 && m == 1 << axis; c++)
                        along +=
                            constants->volume * state->stress[3 * r + c] * (double)cubes->gradient[3 * axis + c] / edge;
                slope += sign * along;
            }
            force[v][r] = -slope;
        }
}

double pliant_tled_element_energy(const pliant_tled *tled, const pliant_tet_material *material, int32_t element,
                                  double force[8][3])
{
    element_state state;
    material = own_material(tled, material);
    if (element < 0) {
        const cube_constants constants = constants_of(tled->system, material, ~element);
        cube_state(tled, &constants, ~element, 0, &state);
        if (force) cube_force(tled->system->cubes, &constants, ~element, &state, force);
        return state.energy;
    }
    double g[12];
    const double volume = tet_state(tled, material, element, 0, g, &state);
    for (int v = 0; v < 4 && force; v++)
        for (int r = 0; r < 3; r++) {
            const double *p = state.stress + 3 * r;
            force[v][r] = -volume * (p[0] * g[3 * v] + p[1] * g[3 * v + 1] + p[2] * g[3 * v + 2]);
        }
    return state.energy;
}

const int32_t *pliant_tled_element_nodes(const pliant_tled_system *system, int32_t element, int *corners)
{
    *corners = element < 0 ? 8 : 4;
    return element < 0 ? system->cubes->cube[~element].node : system->mesh->tets + 4 * (size_t)element;
}

int32_t pliant_tled_element_count(const pliant_tled_system *system)
{
    return system->cubes ? system->cubes->num_tets + system->cubes->count : system->mesh->num_tets;
}

int32_t pliant_tled_element(const pliant_tled_system *system, int32_t index)
{
    if (!system->cubes) return index;
    return index < system->cubes->num_tets ? system->cubes->tet[index] : ~(index - system->cubes->num_tets);
}

/* Compute strain energies at present and one increment ago, and the work of the change between them. */
static void strain_energies(const pliant_tled *tled, const pliant_tet_material *material, double *strain,
                            double *before, double *work)
{
    const pliant_tled_cubes *cubes = tled->system->cubes;
    *strain = *before = *work = 0;
    for (int32_t c = 0; cubes && c < cubes->count; c++) cube_energies(tled, material, c, strain, before, work);
    for (int32_t e = 0; e < (cubes ? cubes->num_tets : tled->system->mesh->num_tets); e++)
        tet_energies(tled, material, cubes ? cubes->tet[e] : e, strain, before, work);
}

/* Central differences conserve 1/2 v M v + 1/2 u- K u of a linear body, with v at half a step. With energies W and
 * forces F at both ends, 1/2 u- K u = (W- + W) / 2 - d (F - F-) / 4. d F is the sum of V P : (F - F-) over the
 * elements. */
void pliant_tled_energies(const pliant_tled *tled, const pliant_tet_material *material, double *kinetic, double *strain,
                          double *kept)
{
    double before, work;
    *kinetic = 0;
    for (int32_t n = 0; n < tled->system->mesh->num_nodes; n++) {
        if (tled->inverse_mass[n] == 0) continue;
        const double *d = tled->d + 3 * (size_t)n;
        double square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        *kinetic += 0.5 * square / (tled->inverse_mass[n] * tled->time_step * tled->time_step);
    }
    strain_energies(tled, own_material(tled, material), strain, &before, &work);
    const double pressures = pliant_tled_pressure_energy(tled);
    *kept = *kinetic + 0.5 * (*strain + before) - 0.25 * work + pressures;
    *strain += pressures;
}
