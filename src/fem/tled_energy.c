/* Energies of the whole body, in double, for checks and reports. */
#include "fem/tled.h"

#include <string.h>

static void deformation_of(const pliant_tled *tled, int32_t tet, double f[9], double *volume)
{
    const pliant_mesh *mesh = tled->system->mesh;
    const int32_t *nodes = mesh->tets + 4 * (size_t)tet;
    double g[12];
    *volume = pliant_tet_gradients(mesh->rest + 3 * nodes[0], mesh->rest + 3 * nodes[1], mesh->rest + 3 * nodes[2],
                                   mesh->rest + 3 * nodes[3], g);
    for (int m = 0; m < 9; m++) f[m] = m % 4 == 0;
    for (int v = 1; v < 4; v++)
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) f[3 * r + c] += (tled->u[3 * nodes[v] + r] - tled->u[3 * nodes[0] + r]) * g[3 * v + c];
}

void pliant_tled_energies(const pliant_tled *tled, const pliant_tet_material *material, double *kinetic, double *strain)
{
    const pliant_tled_system *system = tled->system;
    *kinetic = *strain = 0;
    for (int32_t n = 0; n < system->mesh->num_nodes; n++) {
        if (system->inverse_mass[n] == 0) continue;
        const double *d = tled->d + 3 * (size_t)n;
        double square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        *kinetic += 0.5 * square / (system->inverse_mass[n] * tled->time_step * tled->time_step);
    }
    for (int32_t t = 0; t < system->mesh->num_tets; t++) {
        double f[9], volume;
        deformation_of(tled, t, f, &volume);
        *strain += volume * pliant_law_response(system->law, material[t].lambda, material[t].mu, f, NULL);
    }
}
