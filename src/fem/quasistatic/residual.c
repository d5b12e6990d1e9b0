/* Elastic forces and residual of a state, and products over the unknowns. */
#include "base/dot.h"
#include "fem/linear/basis.h"
#include "fem/quasistatic/pressure.h"

#include <math.h>

enum { PRODUCT_PARTS = 32 };

/* The parts do not depend on the number of threads, so the sum is reproducible. */
double pliant_solver_product(const pliant_solver *solver, const double *a, const double *b)
{
    const size_t n = pliant_solver_unknowns(solver);
    if (solver->system->num_free < PLIANT_NODES_FOR_THREADS) return pliant_dot(n, a, b);
    double parts[PRODUCT_PARTS], sum = 0;
#pragma omp parallel for schedule(static) num_threads(solver->system->num_threads)
    for (int p = 0; p < PRODUCT_PARTS; p++) {
        size_t from = n * (size_t)p / PRODUCT_PARTS, to = n * (size_t)(p + 1) / PRODUCT_PARTS;
        parts[p] = pliant_dot(to - from, a + from, b + from);
    }
    for (int p = 0; p < PRODUCT_PARTS; p++) sum += parts[p];
    return sum;
}

void pliant_solver_find_residual(const pliant_solver *solver, pliant_iterate *at)
{
    const pliant_system *system = solver->system;
    const int parts = system->num_free < PLIANT_NODES_FOR_THREADS ? 1 : PRODUCT_PARTS;
    double work[PRODUCT_PARTS], elastic[PRODUCT_PARTS], farthest[PRODUCT_PARTS];
#pragma omp parallel for schedule(static) num_threads(system->num_threads) if (parts > 1)
    for (int p = 0; p < parts; p++) {
        work[p] = elastic[p] = farthest[p] = 0;
        const int32_t to = (int32_t)((int64_t)system->num_free * (p + 1) / parts);
        for (int32_t f = (int32_t)((int64_t)system->num_free * p / parts); f < to; f++) {
            const size_t node = 3 * (size_t)system->node_of_free[f];
            double squares = 0;
            for (int d = 0; d < 3; d++) {
                double u = at->x[node + (size_t)d] - system->mesh->rest[node + (size_t)d];
                /* The load that holds an undeformed patch, which is not work of its tools. */
                double base = system->basis ? solver->load[3 * f + d] : 0;
                work[p] += u * (at->residual[3 * f + d] - base);
                elastic[p] += u * (at->elastic[3 * f + d] - base);
                squares += u * u;
                at->residual[3 * f + d] -= at->elastic[3 * f + d];
            }
            farthest[p] = fmax(farthest[p], squares);
            pliant_into_node_axes(solver->rotations, f, at->residual + 3 * f);
        }
    }
    for (int p = 1; p < parts; p++) {
        work[0] += work[p];
        elastic[0] += elastic[p];
        farthest[0] = fmax(farthest[0], farthest[p]);
    }
    at->scale = fmax(sqrt(fmax(fabs(work[0]), fabs(elastic[0]))), solver->smallest_scale);
    at->displacement = sqrt(farthest[0]);
}

void pliant_solver_elastic_forces(pliant_solver *solver, pliant_iterate *at)
{
    const pliant_system *system = solver->system;
    pliant_system_element_forces(system, at->x, solver->element_forces);
    pliant_system_gather(system, solver->element_forces, at->elastic);
    pliant_pressure_forces(solver, at, at->elastic);
    if (system->basis) pliant_basis_far_forces(system->basis, at->x, at->elastic);
}
