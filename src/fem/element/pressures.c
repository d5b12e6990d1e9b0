#include "fem/element/volume_change.h"

#include "base/fail.h"
#include "base/memory.h"
#include "base/buffer.h"
#include "fem/element/deformation.h"
#include "fem/element/hexahedra.h"
#include "fem/element/macro_element.h"
#include "fem/element/pressure_rules.h"
#include "fem/element/rotation.h"
#include "fem/element/tensors.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

/* Air has no pressure. */
static double soft_lambda(const pliant_tet_material *material)
{
    const bool splits = material->tissue > 0 && material->lambda > PLIANT_PRESSURE_RATIO * material->mu;
    return splits ? PLIANT_SOFT_RATIO * material->mu : material->lambda;
}

static bool any_splits(const pliant_tet_material *material, int32_t count)
{
    for (int32_t t = 0; t < count; t++)
        if (soft_lambda(material + t) < material[t].lambda) return true;
    return false;
}

pliant_status pliant_soft_materials(const pliant_tet_material *material, int32_t count, pliant_tet_material **out)
{
    *out = NULL;
    if (!any_splits(material, count)) return PLIANT_OK;
    pliant_tet_material *soft = *out = pliant_copy_block(material, (size_t)count, sizeof *soft);
    if (!soft) return pliant_fail_memory("the elements");
    for (int32_t t = 0; t < count; t++) soft[t].lambda = soft_lambda(material + t);
    return PLIANT_OK;
}

void pliant_pressures_free(pliant_pressures *pressures)
{
    if (!pressures) return;
    void *blocks[] = {pressures->volume, pressures->compliance, pressures->gain,          pressures->cell,
                      pressures->of_element, pressures->element_volume, pressures};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
}

/* ---- Groups. */

static bool has_cells(const pliant_mesh *mesh)
{
    return mesh->lattice_of_tet || (mesh->leaf_of_cell && mesh->lattice_of_node);
}

/* An element: moduli times volume, and the tetrahedra of a hexahedron. */
typedef struct moduli {
    double volume, missing_lambda, soft, tet_volume[5];
    int32_t tets, tet[5], cell;
} moduli;

pliant_status pliant_find_whole_cells(const pliant_mesh *mesh, uint8_t **whole)
{
    const size_t cells = pliant_count_cells(mesh);
    uint8_t *slots = *whole = pliant_calloc(cells, 1);
    int32_t *tets = pliant_calloc(cells, sizeof *tets);
    if (!slots || !tets) {
        pliant_free(tets);
        return pliant_fail_memory("the pressures");
    }
    bool lattice = mesh->lattice_of_tet != NULL;
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        const int32_t cell = pliant_cell_of_tet(mesh, t), slot = lattice ? 1 << mesh->lattice_of_tet[t] % 5 : 0;
        if (slots[cell] & slot) slots[cell] |= 0x80;
        slots[cell] |= (uint8_t)slot;
        tets[cell]++;
    }
    for (size_t c = 0; c < cells; c++)
        slots[c] = lattice ? !(slots[c] & 0x80) : tets[c] == mesh->leaf_start[c + 1] - mesh->leaf_start[c];
    pliant_free(tets);
    return PLIANT_OK;
}

/* A hexahedron's lambda includes the stiffness of its empty part. */
static void complete_hexahedra(const pliant_system *system, const uint8_t *whole, const pliant_tet_material *soft,
                               const pliant_tet_material *complete, moduli *of)
{
    for (int32_t e = 0; system->macros && e < system->macros->count; e++) {
        if (of[e].tets != 5) continue;
        pliant_cube cube = {.part = !whole[of[e].cell]};
        memcpy(cube.tet, of[e].tet, sizeof cube.tet);
        of[e].missing_lambda = of[e].volume * pliant_cube_missing_lambda(&cube, of[e].tet_volume, soft, complete);
    }
}

/* Find the moduli and the cell of every element. Errors: MEMORY. */
static pliant_status find_moduli(const pliant_system *system, const pliant_tet_material *soft,
                                 const pliant_tet_material *complete, moduli *of)
{
    const pliant_mesh *mesh = system->mesh;
    int32_t *element = NULL;
    pliant_status status =
        system->macros ? pliant_hexahedra_of_tets(mesh, system->macros, &element) : PLIANT_OK;
    for (int32_t t = 0; status == PLIANT_OK && t < mesh->num_tets; t++) {
        moduli *one = of + (element ? element[t] : t);
        double gradients[12];
        const double volume = pliant_mesh_gradients(mesh, t, gradients);
        if (one->tets < 5) one->tet[one->tets] = t, one->tet_volume[one->tets] = volume;
        one->tets++;
        one->volume += volume;
        one->missing_lambda += volume * (complete[t].lambda - soft[t].lambda);
        one->soft += volume * (soft[t].lambda + 4.0 / 3 * soft[t].mu);
        one->cell = has_cells(mesh) ? pliant_cell_of_tet(mesh, t) : -1;
    }
    pliant_free(element);
    return status;
}

/* Number the groups. Tetrahedra share the group of their whole cell. first: Nullable: (cells) scratch, all -1. */
static void number_groups(const pliant_system *system, const moduli *of, const uint8_t *whole, int32_t *first,
                          pliant_pressures *out)
{
    for (int32_t e = 0; e < pliant_element_count(system); e++) {
        const int32_t cell = of[e].cell;
        const bool shares = first && whole[cell];
        out->of_element[e] = -1;
        out->element_volume[e] = of[e].volume;
        if (!(of[e].missing_lambda > 0)) continue;
        const int32_t p = shares && first[cell] >= 0 ? first[cell] : out->count++;
        if (shares) first[cell] = p;
        out->of_element[e] = p;
        out->cell[p] = cell;
        out->volume[p] += of[e].volume;
        out->compliance[p] += of[e].missing_lambda; /* sums; finish() divides */
        out->gain[p] += of[e].soft;
    }
}

static void finish(pliant_pressures *out)
{
    for (int32_t p = 0; p < out->count; p++) {
        const double missing_lambda = out->compliance[p];
        out->compliance[p] = out->volume[p] / missing_lambda;
        out->gain[p] = 1 / (out->volume[p] / out->gain[p] + out->compliance[p]);
    }
}

static bool allocate(size_t elements, pliant_pressures *out)
{
    return (out->volume = pliant_calloc(elements, sizeof *out->volume)) &&
           (out->compliance = pliant_calloc(elements, sizeof *out->compliance)) &&
           (out->gain = pliant_calloc(elements, sizeof *out->gain)) &&
           (out->cell = pliant_calloc(elements, sizeof *out->cell)) &&
           (out->of_element = pliant_calloc(elements, sizeof *out->of_element)) &&
           (out->element_volume = pliant_calloc(elements, sizeof *out->element_volume));
}

/* Create the pressures of elements whose own lambda is `soft`. Errors: MEMORY. */
static pliant_status create(const pliant_system *system, const pliant_tet_material *soft,
                            const pliant_tet_material *complete, pliant_pressures *out)
{
    const size_t elements = (size_t)pliant_element_count(system),
                 cells = has_cells(system->mesh) ? pliant_count_cells(system->mesh) : 0;
    moduli *of = pliant_calloc(elements, sizeof *of);
    int32_t *first = cells && !system->macros ? pliant_malloc(cells, sizeof *first) : NULL;
    uint8_t *whole = NULL;
    pliant_status status = of && (first || !cells || system->macros) && allocate(elements, out)
                               ? PLIANT_OK
                               : pliant_fail_memory("the pressures");
    if (status == PLIANT_OK) status = find_moduli(system, soft, complete, of);
    if (status == PLIANT_OK && cells) status = pliant_find_whole_cells(system->mesh, &whole);
    if (status == PLIANT_OK) {
        complete_hexahedra(system, whole, soft, complete, of);
        for (size_t c = 0; first && c < cells; c++) first[c] = -1;
        number_groups(system, of, whole, first, out);
        finish(out);
    }
    pliant_free(of);
    pliant_free(first);
    pliant_free(whole);
    return status;
}

pliant_status pliant_pressures_create(const pliant_system *system, const pliant_tet_material *material,
                                      pliant_pressures **out)
{
    pliant_tet_material *soft;
    *out = NULL;
    pliant_status status = pliant_soft_materials(material, system->mesh->num_tets, &soft);
    if (status != PLIANT_OK || !soft) return status;
    pliant_pressures *made = pliant_calloc(1, sizeof *made);
    status = made ? create(system, soft, material, made) : pliant_fail_memory("the pressures");
    pliant_free(soft);
    if (status != PLIANT_OK) pliant_pressures_free(made);
    else *out = made;
    return status;
}

/* ---- Changes of volume. */

PLIANT_VECTORIZED static void deformations_of(double x[12][LANES], double g[12][LANES], double f[9][LANES])
{
    deformation_of(x, g, f);
}

/* Compute the derivative of the volume change by F: R, or of the neo-Hookean law cof F. */
PLIANT_VECTORIZED static void derivatives_of(pliant_elasticity law, double f[9][LANES], double out[9][LANES])
{
    if (law == PLIANT_ELASTICITY_COROTATIONAL) {
        pliant_rotations(f, out);
        return;
    }
    for (int l = 0; l < LANES; l++) {
        double one[9], cofactor[9];
        for (int m = 0; m < 9; m++) one[m] = f[m][l];
        pliant_cofactor(one, cofactor);
        for (int m = 0; m < 9; m++) out[m][l] = cofactor[m];
    }
}

/* F of a hexahedron, or of a tetrahedron next to a cut. */
static void deformation_of_macro(const pliant_system *system, int32_t element, const double *positions, double f[9])
{
    const pliant_macros *macros = system->macros;
    pliant_macro_frame frame;
    pliant_macro_find_frame(macros->own + 8 * (size_t)element, macros->gradient + 24 * (size_t)element, positions,
                            macros->rest ? macros->rest : system->mesh->rest, f, &frame);
}

static void write_rows(const double derivative[9], double volume, int32_t corners, const double *gradient, double *rows)
{
    for (int32_t v = 0; v < corners; v++) pliant_volume_row(derivative, volume, gradient + 3 * v, rows + 3 * v);
}

void pliant_pressures_find(const pliant_pressures *pressures, const pliant_system *system, const double *positions,
                           double *change, double *rows)
{
    const int32_t count = pliant_element_count(system);
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t first = 0; first < count; first += LANES) {
        double x[12][LANES], f[9][LANES], r[9][LANES];
        if (!system->macros) {
            load_corners(system, positions, first / LANES, x);
            deformations_of(x, system->gradients[first / LANES], f);
        } else {
            for (int l = 0; l < LANES; l++) {
                double one[9];
                deformation_of_macro(system, first + l < count ? first + l : first, positions, one);
                for (int m = 0; m < 9; m++) f[m][l] = one[m];
            }
        }
        derivatives_of(system->law, f, r);
        for (int l = 0; l < LANES && first + l < count; l++) {
            const int32_t e = first + l, begin = pliant_element_begin(system, e);
            double one[9], turned[9], gradient[12];
            if (pressures->of_element[e] < 0) continue;
            for (int m = 0; m < 9; m++) one[m] = f[m][l], turned[m] = r[m][l];
            for (int m = 0; m < 12 && !system->macros; m++) gradient[m] = system->gradients[first / LANES][m][l];
            change[e] = pliant_volume_change(system->law, one, turned);
            write_rows(turned, pressures->element_volume[e], pliant_element_begin(system, e + 1) - begin,
                       system->macros ? system->macros->gradient + 24 * (size_t)e : gradient,
                       rows + 3 * (size_t)begin);
        }
    }
}

void pliant_pressures_add(const pliant_pressures *pressures, const pliant_system *system, const double *rows,
                          const double *p, double *out)
{
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t n = 0; n < system->num_free; n++)
        for (int32_t c = system->corner_start[n]; c < system->corner_end[n]; c++) {
            const int32_t corner = system->corner[c],
                          of = pressures->of_element[pliant_element_of_corner(system, corner)];
            for (int d = 0; d < 3 && of >= 0; d++)
                out[3 * (size_t)n + (size_t)d] += p[of] * rows[3 * (size_t)corner + (size_t)d];
        }
}

/* Return the rest volume of a tetrahedron, and compute its volume change. */
static double change_of(const pliant_mesh *mesh, const double *positions, pliant_elasticity law, int32_t tet,
                        double *change)
{
    double gradients[12], x[12], f[9], r[9], e[6];
    const double volume = pliant_mesh_gradients(mesh, tet, gradients);
    for (int v = 0; v < 4; v++) memcpy(x + 3 * v, positions + 3 * mesh->tets[4 * tet + v], 3 * sizeof *x);
    pliant_deformation(x, gradients, f);
    pliant_rotation_signed_svd(f, r);
    pliant_corotational_strain(f, r, e);
    *change = law == PLIANT_ELASTICITY_COROTATIONAL ? e[0] + e[1] + e[2] : pliant_determinant(f) - 1;
    return volume;
}

pliant_status pliant_group_changes(const pliant_mesh *mesh, const double *positions, pliant_elasticity law,
                                   double **out)
{
    const size_t cells = has_cells(mesh) ? pliant_count_cells(mesh) : 0;
    double *change = *out = pliant_calloc((size_t)mesh->num_tets, sizeof *change);
    double *sum = pliant_calloc(2 * cells + 1, sizeof *sum);
    uint8_t *whole = NULL;
    pliant_status status = change && sum ? PLIANT_OK : pliant_fail_memory("the pressures");
    if (status == PLIANT_OK && cells) status = pliant_find_whole_cells(mesh, &whole);
    for (int32_t t = 0; status == PLIANT_OK && t < mesh->num_tets; t++) {
        const double volume = change_of(mesh, positions, law, t, change + t);
        if (!cells) continue;
        sum[2 * pliant_cell_of_tet(mesh, t)] += volume * change[t];
        sum[2 * pliant_cell_of_tet(mesh, t) + 1] += volume;
    }
    for (int32_t t = 0; status == PLIANT_OK && cells && t < mesh->num_tets; t++) {
        const int32_t cell = pliant_cell_of_tet(mesh, t);
        if (whole[cell]) change[t] = sum[2 * cell] / sum[2 * cell + 1];
    }
    pliant_free(sum);
    pliant_free(whole);
    return status;
}
