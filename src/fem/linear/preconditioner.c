#include "base/fail.h"
#include "fem/linear/multigrid.h"
#include "fem/linear/basis.h"
#include "fem/linear/carried_preconditioner.h"
#include "fem/system.h"
#include "base/memory.h"

#include <string.h>

/* Maximum number of free nodes for a factor. Above it, a V-cycle is faster than the two triangular solves
 * (test/bench/bench_budget, bench_elements). A factor of hexahedra has twice as many values (NUMERICS.md). */
enum { LARGEST_DIRECT = 8000, LARGEST_DIRECT_HEXAHEDRA = 4000, COARSEST = 1000 };
/* At cuts, fragments on coarser levels can be very thin, so the hierarchy has one level less (NUMERICS.md). FEWER_NEAR:
 * minimum ratio of all unknowns to the unknowns near cuts, for a local factor. */
enum { COARSEST_OF_FRAGMENTS = 8000, FEWER_NEAR = 4 };

struct pliant_preconditioner {
    pliant_system system;      /* view of the constant system, with this preconditioner's number of threads */
    pliant_factor *factor;     /* direct */
    double *values;            /* (pattern.num_values) work array for the matrix; direct */
    pliant_hierarchy *hierarchy; /* shared by clones */
    pliant_multigrid *multigrid;
    pliant_subdomain *near;    /* Nullable: with the multigrid, around opened cuts */
    double *rest, *left;       /* (3 num_free) work arrays for near */
    const pliant_basis *basis; /* borrowed */
    pliant_reduction *reduction; /* of it */
    pliant_carried *carried;   /* carried over from before a cut */
};

static pliant_status create_direct(pliant_preconditioner *preconditioner, const int32_t *order)
{
    const pliant_pattern *pattern = &preconditioner->system.pattern;
    preconditioner->values = pliant_calloc((size_t)pattern->num_values, sizeof *preconditioner->values);
    return preconditioner->values ? pliant_factor_analyze_in(pattern, order, &preconditioner->factor)
                                  : pliant_fail_memory("the stiffness matrix");
}

static bool has_fragments(const pliant_system *system) { return system->graded || system->divided; }

/* Find the number of element rings around opened unknowns. Next to coarse elements, which otherwise have a factor, it
 * is the width of a coarse cube in fine cells. On the fine mesh it is one ring, or 0 if even one ring contains too
 * large a fraction of all unknowns. Its factor would then take longer than the V-cycle. */
static pliant_status find_rings(const pliant_system *system, const uint8_t *opened, int32_t *rings)
{
    *rings = 1;
    for (int d = 0; d < 3; d++)
        *rings = system->fine->cells[d] / system->mesh->cells[d] > *rings
                     ? system->fine->cells[d] / system->mesh->cells[d]
                     : *rings;
    if (system->graded) return PLIANT_OK;
    uint8_t *inner = pliant_calloc((size_t)system->num_free, 1);
    int32_t *list = pliant_calloc((size_t)system->num_free, sizeof *list);
    if (inner && list) {
        memcpy(inner, opened, (size_t)system->num_free);
        *rings = pliant_subdomain_inner(system, 1, inner, list) <= system->num_free / FEWER_NEAR;
    }
    pliant_status status = inner && list ? PLIANT_OK : pliant_fail_memory("the preconditioner");
    pliant_free(inner);
    pliant_free(list);
    return status;
}

/* Create the local inverse around opened cuts. The smoother is inaccurate for fragments as thin as one node, and the
 * next level's cubes do not resolve the tip of a cut. The V-cycle therefore includes the local inverse, as in
 * carried_preconditioner.h. */
static pliant_status create_near(pliant_preconditioner *preconditioner)
{
    const pliant_system *system = &preconditioner->system;
    if (!has_fragments(system)) return PLIANT_OK;
    int32_t rings = 0;
    uint8_t *opened = pliant_calloc((size_t)system->num_free, 1);
    pliant_status status = opened ? pliant_hierarchy_mark_copies(preconditioner->hierarchy, opened)
                                  : pliant_fail_memory("the preconditioner");
    if (status == PLIANT_OK) status = find_rings(system, opened, &rings);
    if (status == PLIANT_OK && rings > 0)
        status = pliant_subdomain_create(system, opened, rings, NULL, NULL, &preconditioner->near);
    pliant_free(opened);
    if (!preconditioner->near) return status;
    preconditioner->rest = pliant_calloc((size_t)system->num_free, 3 * sizeof *preconditioner->rest);
    preconditioner->left = pliant_calloc((size_t)system->num_free, 3 * sizeof *preconditioner->left);
    return preconditioner->rest && preconditioner->left ? status : pliant_fail_memory("the preconditioner");
}

static pliant_status create_multigrid(pliant_preconditioner *preconditioner)
{
    const pliant_system *system = &preconditioner->system;
    pliant_status status = pliant_hierarchy_create(
        system, true, has_fragments(system) ? COARSEST_OF_FRAGMENTS : COARSEST, &preconditioner->hierarchy);
    if (status != PLIANT_OK) return status;
    if (!preconditioner->hierarchy) {
        pliant_log(PLIANT_LOG_INFO, "this lattice cannot be coarsened for multigrid; it is factored");
        return PLIANT_OK;
    }
    status = pliant_multigrid_create(preconditioner->hierarchy, system->num_threads, &preconditioner->multigrid);
    return status == PLIANT_OK ? create_near(preconditioner) : status;
}

pliant_status pliant_preconditioner_create(const pliant_system *system, pliant_preconditioner_choice choice,
                                           const int32_t *order, pliant_preconditioner **out)
{
    pliant_preconditioner *preconditioner = pliant_calloc(1, sizeof *preconditioner);
    if (!preconditioner) return pliant_fail_memory("the preconditioner");
    preconditioner->system = *system;
    pliant_status status = PLIANT_OK;
    int32_t largest = system->macros ? LARGEST_DIRECT_HEXAHEDRA : LARGEST_DIRECT;
    bool layered = choice == PLIANT_MULTIGRID || (choice == PLIANT_PRECONDITIONER_AUTO && system->num_free > largest);
    if (layered) status = create_multigrid(preconditioner);
    if (status == PLIANT_OK && !preconditioner->hierarchy) status = create_direct(preconditioner, order);
    if (status != PLIANT_OK) {
        pliant_preconditioner_free(preconditioner);
        return status;
    }
    *out = preconditioner;
    return PLIANT_OK;
}

pliant_status pliant_preconditioner_create_in_basis(const pliant_basis *basis, const pliant_system *system,
                                                    pliant_preconditioner **out)
{
    pliant_preconditioner *preconditioner = pliant_calloc(1, sizeof *preconditioner);
    if (!preconditioner) return pliant_fail_memory("the preconditioner");
    preconditioner->system = *system;
    preconditioner->basis = basis;
    pliant_status status = pliant_reduction_create(basis, NULL, &preconditioner->reduction);
    if (status != PLIANT_OK) {
        pliant_preconditioner_free(preconditioner);
        return status;
    }
    *out = preconditioner;
    return PLIANT_OK;
}

pliant_status pliant_preconditioner_clone(const pliant_preconditioner *source, int num_threads,
                                          pliant_preconditioner **out)
{
    pliant_preconditioner *preconditioner = pliant_calloc(1, sizeof *preconditioner);
    if (!preconditioner) return pliant_fail_memory("a second preconditioner");
    preconditioner->basis = source->basis;
    preconditioner->system = source->system;
    preconditioner->system.num_threads = num_threads;
    if (source->hierarchy) preconditioner->hierarchy = pliant_hierarchy_retain(source->hierarchy);
    pliant_status status = PLIANT_OK;
    if (source->basis) {
        status = pliant_reduction_create(source->basis, source->reduction, &preconditioner->reduction);
    } else if (source->multigrid) {
        status = pliant_multigrid_create(source->hierarchy, num_threads, &preconditioner->multigrid);
        if (status == PLIANT_OK) status = pliant_multigrid_copy(preconditioner->multigrid, source->multigrid);
        if (status == PLIANT_OK) status = create_near(preconditioner);
        if (status == PLIANT_OK && preconditioner->near)
            status = pliant_subdomain_copy(preconditioner->near, source->near);
    } else {
        preconditioner->values =
            pliant_calloc((size_t)source->system.pattern.num_values, sizeof *preconditioner->values);
        status = preconditioner->values ? pliant_factor_clone(source->factor, &preconditioner->factor)
                                        : pliant_fail_memory("the stiffness matrix");
    }
    if (status != PLIANT_OK) {
        pliant_preconditioner_free(preconditioner);
        return status;
    }
    *out = preconditioner;
    return PLIANT_OK;
}

void pliant_preconditioner_threads(pliant_preconditioner *preconditioner, int num_threads)
{
    preconditioner->system.num_threads = num_threads;
    if (preconditioner->multigrid) pliant_multigrid_threads(preconditioner->multigrid, num_threads);
    if (preconditioner->carried && preconditioner->carried->base)
        pliant_preconditioner_threads(preconditioner->carried->base, num_threads);
}

pliant_status pliant_preconditioner_carry(const pliant_system *system, const pliant_discretization *of,
                                          const pliant_system *of_base, int32_t *source, const double *positions,
                                          const double *axes, pliant_preconditioner **out)
{
    pliant_preconditioner *preconditioner = pliant_calloc(1, sizeof *preconditioner);
    if (!preconditioner) {
        pliant_free(source);
        return pliant_fail_memory("the preconditioner");
    }
    preconditioner->system = *system;
    pliant_status status =
        pliant_carried_create(system, of, of_base, source, positions, axes, &preconditioner->carried);
    if (status != PLIANT_OK) {
        pliant_preconditioner_free(preconditioner);
        return status;
    }
    *out = preconditioner;
    return PLIANT_OK;
}

pliant_status pliant_preconditioner_correct(pliant_preconditioner *preconditioner, const double *positions,
                                            const double *axes)
{
    if (!preconditioner->carried) return PLIANT_OK;
    return pliant_carried_correct(&preconditioner->system, positions, axes, preconditioner->carried);
}

void pliant_preconditioner_take_base(pliant_preconditioner *carried, pliant_preconditioner **base)
{
    carried->carried->base = *base;
    *base = NULL;
}

pliant_preconditioner **pliant_preconditioner_base(pliant_preconditioner *preconditioner)
{
    return preconditioner->carried ? &preconditioner->carried->base : NULL;
}

const pliant_discretization *pliant_preconditioner_source(const pliant_preconditioner *preconditioner,
                                                          const int32_t **source)
{
    *source = preconditioner->carried ? preconditioner->carried->source : NULL;
    return preconditioner->carried ? preconditioner->carried->of : NULL;
}

bool pliant_preconditioner_is_multigrid(const pliant_preconditioner *preconditioner)
{
    return preconditioner->hierarchy != NULL;
}

int32_t pliant_preconditioner_order(const pliant_preconditioner *preconditioner, int32_t *order)
{
    return preconditioner->factor ? pliant_factor_order(preconditioner->factor, order) : 0;
}

pliant_status pliant_preconditioner_numeric(pliant_preconditioner *preconditioner, const pliant_tangent *tangents)
{
    if (preconditioner->basis)
        return pliant_reduction_numeric(preconditioner->basis, tangents, preconditioner->reduction);
    if (preconditioner->multigrid) {
        pliant_status status = pliant_multigrid_numeric(preconditioner->multigrid, tangents);
        return status == PLIANT_OK && preconditioner->near ? pliant_subdomain_numeric(preconditioner->near, tangents)
                                                           : status;
    }
    pliant_system_assemble(&preconditioner->system, tangents, preconditioner->values);
    return pliant_factor_numeric(preconditioner->factor, preconditioner->values);
}

static pliant_status solve_carried(pliant_carried *carried, const double *right, double *out)
{
    pliant_status status = pliant_carried_restrict(carried, right);
    if (status == PLIANT_OK) status = pliant_preconditioner_solve(carried->base, 1, carried->right, carried->left);
    return status == PLIANT_OK ? pliant_carried_extend(carried, out) : status;
}

/* Apply S + E V E', E = I - S K. */
static pliant_status solve_multigrid(pliant_preconditioner *preconditioner, const double *right, double *out)
{
    if (!preconditioner->near) return pliant_multigrid_solve(preconditioner->multigrid, right, out);
    const size_t n = 3 * (size_t)preconditioner->system.num_free;
    double *rest = preconditioner->rest, *left = preconditioner->left;
    memcpy(rest, right, n * sizeof *rest);
    memset(out, 0, n * sizeof *out);
    pliant_status status = pliant_subdomain_solve(preconditioner->near, rest, out, rest);
    if (status == PLIANT_OK) status = pliant_multigrid_solve(preconditioner->multigrid, rest, left);
    if (status == PLIANT_OK) status = pliant_subdomain_extend(preconditioner->near, left, out);
    for (size_t i = 0; i < n; i++) out[i] += left[i];
    return status;
}

pliant_status pliant_preconditioner_solve(pliant_preconditioner *preconditioner, int32_t columns, const double *right,
                                          double *out)
{
    if (preconditioner->factor) return pliant_factor_solve(preconditioner->factor, columns, right, out);
    size_t n = 3 * (size_t)preconditioner->system.num_free;
    for (int32_t c = 0; c < columns; c++) {
        const double *from = right + n * (size_t)c;
        double *to = out + n * (size_t)c;
        pliant_status status = preconditioner->basis
                                   ? pliant_reduction_solve(preconditioner->basis, preconditioner->reduction, from, to)
                               : preconditioner->carried ? solve_carried(preconditioner->carried, from, to)
                                                         : solve_multigrid(preconditioner, from, to);
        if (status != PLIANT_OK) return status;
    }
    return PLIANT_OK;
}

pliant_factor *pliant_preconditioner_factor(pliant_preconditioner *preconditioner) { return preconditioner->factor; }

bool pliant_preconditioner_can_fail(const pliant_preconditioner *preconditioner)
{
    return !preconditioner->multigrid && !preconditioner->carried;
}

double pliant_preconditioner_condition(pliant_preconditioner *preconditioner)
{
    return preconditioner->factor ? pliant_factor_condition(preconditioner->factor) : 0;
}

double pliant_preconditioner_operations(const pliant_preconditioner *preconditioner)
{
    if (preconditioner->carried) return pliant_preconditioner_operations(preconditioner->carried->base);
    if (preconditioner->basis) return pliant_reduction_operations(preconditioner->basis);
    if (preconditioner->hierarchy)
        return pliant_hierarchy_operations(preconditioner->hierarchy) +
               (preconditioner->near ? pliant_factor_operations(preconditioner->near->factor) : 0);
    return pliant_factor_operations(preconditioner->factor) +
           (preconditioner->system.macros ? pliant_macro_operations(&preconditioner->system) : 0);
}

/* Factor: one multiplication and addition per value, forward and backward. V-cycle: about twelve products with the
 * matrix. */
double pliant_preconditioner_apply_operations(const pliant_preconditioner *preconditioner)
{
    if (preconditioner->carried) return pliant_preconditioner_apply_operations(preconditioner->carried->base);
    if (preconditioner->factor) return 4 * pliant_factor_values(preconditioner->factor);
    return 12 * 4 * (double)preconditioner->system.pattern.num_values;
}

double pliant_preconditioner_solve_operations(const pliant_preconditioner *preconditioner)
{
    const int cycles = preconditioner->factor ? 1 : 8;
    return cycles * pliant_preconditioner_apply_operations(preconditioner);
}

size_t pliant_preconditioner_bytes(const pliant_preconditioner *preconditioner)
{
    if (preconditioner && preconditioner->carried) return pliant_preconditioner_bytes(preconditioner->carried->base);
    return preconditioner && preconditioner->factor ? pliant_factor_bytes(preconditioner->factor) : 0;
}

void pliant_preconditioner_free(pliant_preconditioner *preconditioner)
{
    if (!preconditioner) return;
    pliant_factor_free(preconditioner->factor);
    pliant_free(preconditioner->values);
    pliant_multigrid_free(preconditioner->multigrid);
    pliant_reduction_free(preconditioner->reduction);
    pliant_hierarchy_free(preconditioner->hierarchy);
    pliant_subdomain_free(preconditioner->near);
    pliant_free(preconditioner->rest);
    pliant_free(preconditioner->left);
    if (preconditioner->carried) pliant_preconditioner_free(preconditioner->carried->base);
    pliant_carried_free(preconditioner->carried);
    pliant_free(preconditioner);
}

void pliant_system_free(pliant_system *system)
{
    if (!system) return;
    pliant_preconditioner_free(system->preconditioner);
    pliant_system_clear(system);
    pliant_free(system);
}
