/* Energies of the whole body, in double, for checks and reports. */
#include "fem/dynamics/tled_cubes.h"

/* @param back how many increments ago: 0 or 1 */
static void deformation_of(const pliant_tled *tled, const int32_t nodes[4], const double g[12], double back, double f[9])
{
    for (int m = 0; m < 9; m++) f[m] = m % 4 == 0;
    for (int v = 0; v < 4; v++)
        for (int r = 0; r < 3; r++) {
            double u = tled->u[3 * nodes[v] + r] - back * tled->d[3 * nodes[v] + r];
            for (int c = 0; c < 3; c++) f[3 * r + c] += u * g[3 * v + c];
        }
}

/* F of a cube, and its hourglass modes */
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
            for (int axis = 0; axis < 3; axis++) f[3 * r + c] += w[1 << axis][r] * cubes->gradient[3 * axis + c] / (cubes->size ? cubes->size[index] : 1);
        }
}

/* Energy of the modes that F does not see, over V mu finer^2 (cube_bending.h); what it has against w, and against the modes along the axes. */
static double bending_energy(const pliant_tled_cubes *cubes, int32_t index, double w[8][3], double force[8][3])
{
    const pliant_cube_bending *bending = &cubes->bending;
    double f[9], y[9], q[9], energy = 0;
    for (int m = 0; m < 9; m++) f[m] = bending->direction[m] + 0.25 * bending->edge[m / 3] * w[1 << m / 3][m % 3] / (cubes->size ? cubes->size[index] : 1);
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
            force[mode][r] = (double)bending->least * w[mode][r];
            energy += 0.5 * force[mode][r] * w[mode][r];
            for (int a = 0; a < 3; a++) force[mode][r] += q[3 * k + a] * f[3 * a + r];
            force[1 << k][r] = 0;
            for (int other = 0; other < 3; other++) force[1 << k][r] += q[3 * other + k] * w[7 ^ 1 << other][r];
            force[1 << k][r] *= 0.25 * bending->edge[k] / (cubes->size ? cubes->size[index] : 1);
        }
    }
    return energy;
}

static void cube_energies(const pliant_tled *tled, const pliant_tet_material *material, int32_t index, double *strain, double *before, double *work)
{
    const pliant_tled_system *system = tled->system;
    const pliant_cube *cube = system->cubes->cube + index;
    const double finer = 1.0 / (system->cubes->size ? system->cubes->size[index] : 1);
    double volume[5], lambda[5], mu[5], g[12], f[2][9], stress[2][9], w[2][8][3], force[2][8][3], whole = 0, mean[2] = {0, 0};
    for (int slot = 0; slot < 5; slot++) volume[slot] = pliant_mesh_gradients(system->mesh, cube->tet[slot], g);
    pliant_cube_moduli(cube, volume, material, lambda, mu);
    for (int slot = 0; slot < 5; slot++) {
        whole += volume[slot];
        mean[0] += volume[slot] * lambda[slot];
        mean[1] += volume[slot] * mu[slot];
    }
    for (int back = 0; back < 2; back++) {
        double *sum = back ? before : strain;
        modes_of(tled, index, back, f[back], w[back]);
        *sum += whole * pliant_law_response(system->law, mean[0] / whole, mean[1] / whole, f[back], stress[back]);
        *sum += mean[1] * finer * finer * bending_energy(system->cubes, index, w[back], force[back]);
    }
    for (int m = 0; m < 9; m++) *work += whole * (stress[0][m] - stress[1][m]) * (f[0][m] - f[1][m]);
    for (int m = 0; m < 8; m++)
        for (int r = 0; r < 3; r++) *work += mean[1] * finer * finer * (force[0][m][r] - force[1][m][r]) * (w[0][m][r] - w[1][m][r]);
}

static void tet_energies(const pliant_tled *tled, const pliant_tet_material *material, int32_t tet, double *strain, double *before, double *work)
{
    const pliant_tled_system *system = tled->system;
    double g[12], f[2][9], stress[2][9];
    const double volume = pliant_mesh_gradients(system->mesh, tet, g);
    for (int back = 0; back < 2; back++) {
        deformation_of(tled, system->mesh->tets + 4 * (size_t)tet, g, back, f[back]);
        *(back ? before : strain) += volume * pliant_law_response(system->law, material[tet].lambda, material[tet].mu, f[back], stress[back]);
    }
    for (int m = 0; m < 9; m++) *work += volume * (stress[0][m] - stress[1][m]) * (f[0][m] - f[1][m]);
}

/* Strain energies now and one increment ago, and the work of the change between. cell: Nullable: those to look at */
static void strain_energies(const pliant_tled *tled, const pliant_tet_material *material, const uint8_t *cell, double *strain, double *before, double *work)
{
    const pliant_mesh *mesh = tled->system->mesh;
    const pliant_tled_cubes *cubes = tled->system->cubes;
    *strain = *before = *work = 0;
    for (int32_t c = 0; cubes && c < cubes->count; c++)
        if (!cell || cell[pliant_cell_of_tet(mesh, cubes->cube[c].tet[0])]) cube_energies(tled, material, c, strain, before, work);
    for (int32_t e = 0; e < (cubes ? cubes->num_tets : mesh->num_tets); e++) {
        const int32_t tet = cubes ? cubes->tet[e] : e;
        if (!cell || cell[pliant_cell_of_tet(mesh, tet)]) tet_energies(tled, material, tet, strain, before, work);
    }
}

double pliant_tled_strain_energy(const pliant_tled *tled, const pliant_tet_material *material, const uint8_t *cell)
{
    double strain, before, work;
    strain_energies(tled, material, cell, &strain, &before, &work);
    return strain;
}

/* Central differences keep 1/2 v M v + 1/2 u- K u of a linear body, v half way between. With energies W and forces F of both ends,
 * 1/2 u- K u = (W- + W) / 2 - d (F - F-) / 4, and d F is the sum of V P : (F - F-) over elements. */
void pliant_tled_energies(const pliant_tled *tled, const pliant_tet_material *material, double *kinetic, double *strain, double *kept)
{
    double before, work;
    *kinetic = 0;
    for (int32_t n = 0; n < tled->system->mesh->num_nodes; n++) {
        if (tled->inverse_mass[n] == 0) continue;
        const double *d = tled->d + 3 * (size_t)n;
        double square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        *kinetic += 0.5 * square / (tled->inverse_mass[n] * tled->time_step * tled->time_step);
    }
    strain_energies(tled, material, NULL, strain, &before, &work);
    *kept = *kinetic + 0.5 * (*strain + before) - 0.25 * work;
}
