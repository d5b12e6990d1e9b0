/* List the candidates of a choice of settings: methods on meshes. */
#include "report/choice.h"
#include "scene/scene.h"

#include <stdio.h>
#include <string.h>

/* Alternatives to the scene's method, most accurate first. */
static const choice_method methods[CHOICE_METHODS] = {
    {PLIANT_FINE, PLIANT_SUBMESH_OVERLAP, 0},
    {PLIANT_AVERAGED, PLIANT_SUBMESH_OVERLAP, 0.05},
    {PLIANT_AVERAGED, PLIANT_SUBMESH_OVERLAP, 0},
    {PLIANT_COARSE, PLIANT_SUBMESH_OVERLAP, 0},
    {PLIANT_LOD, PLIANT_SUBMESH_OVERLAP, 0},
    {PLIANT_SCHUR, PLIANT_SUBMESH_OVERLAP, 0},
    {PLIANT_SCHUR, PLIANT_SUBMESH_FACE, 0},
};
const int32_t choice_budgets[CHOICE_BUDGETS] = {1, 2, 3, 4, 6, 8, 12, 18, 30};

#define NAME(name, yaml) #yaml,
static const char *const method_names[] = {PLIANT_METHOD_LIST(NAME)};
static const char *const submesh_names[] = {PLIANT_SUBMESH_EXTENT_LIST(NAME)};
#undef NAME

const char *choice_method_name(const choice_candidate *candidate) { return method_names[candidate->by.method]; }

const char *choice_submesh_name(const choice_candidate *candidate)
{
    return candidate->by.method == PLIANT_SCHUR ? submesh_names[candidate->by.submesh] : "";
}

static double lattice_tetrahedra(const pliant_scene *scene, int32_t ratio)
{
    double cells = 5;
    for (int d = 0; d < 3; d++) cells *= (double)scene->mesh.coarse_cells[d] * ratio;
    return cells;
}

int32_t choice_reference_ratio(const pliant_scene *scene, double limit)
{
    int32_t refined = 2 * scene->mesh.ratio;
    bool varies = scene->choose.ratio || scene->choose.coarse_cells;
    return varies && refined <= 8 && lattice_tetrahedra(scene, refined) <= limit ? refined : scene->mesh.ratio;
}

/* List cells and ratios whose mesh is not finer than the reference's, coarse ones first. */
static int list_meshes(const pliant_scene *scene, int32_t finest, choice_mesh out[CHOICE_MESHES])
{
    int count = 0;
    for (int32_t part = 8; part >= 1; part /= 2)
        for (int32_t factor = 1; factor <= (scene->choose.coarse_cells ? 2 : 1); factor++) {
            int32_t ratio = finest / part, largest = 0;
            if (!scene->choose.ratio) ratio = scene->mesh.ratio;
            for (int d = 0; d < 3; d++)
                largest = scene->mesh.coarse_cells[d] > largest ? scene->mesh.coarse_cells[d] : largest;
            bool known = ratio < 1 || factor * ratio > finest || factor * largest > 256;
            for (int m = 0; m < count; m++) known = known || (out[m].cells_factor == factor && out[m].ratio == ratio);
            if (!known && count < CHOICE_MESHES) out[count++] = (choice_mesh){factor, ratio};
        }
    return count;
}

static bool is_listed(const choice_mesh *meshes, int count, int32_t factor, int32_t ratio)
{
    for (int m = 0; m < count; m++)
        if (meshes[m].cells_factor == factor && meshes[m].ratio == ratio) return true;
    return false;
}

static bool same_method(const choice_method *a, const choice_method *b)
{
    bool patched = a->method != PLIANT_FINE; /* the fine method has no patches */
    return a->method == b->method && a->submesh == b->submesh && (!patched || a->patch == b->patch);
}

/* Return whether a method supports the scene's elements. */
static bool has_elements(const pliant_scene *scene, const choice_method *by)
{
    pliant_scene other = *scene;
    if (pliant_scene_element_kind(scene, NULL) == PLIANT_LINEAR) return true;
    other.element.kind = PLIANT_ELEMENT_AUTO;
    other.model.method = by->method;
    other.model.patch = by->patch;
    return pliant_scene_element_kind(&other, NULL) == PLIANT_HEXAHEDRA;
}

int choice_list_candidates(const pliant_scene *scene, int32_t finest, choice_candidate out[CHOICE_CANDIDATES])
{
    choice_mesh meshes[CHOICE_MESHES];
    int num_meshes = list_meshes(scene, finest, meshes), count = 0;
    const pliant_method method = scene->model.method;
    const choice_method own = {method, method == PLIANT_SCHUR ? scene->model.submesh : PLIANT_SUBMESH_OVERLAP,
                               scene->model.patch};
    out[count++] = (choice_candidate){own, {1, scene->mesh.ratio}};
    for (int n = -1; n < (scene->choose.method ? CHOICE_METHODS : 0); n++) {
        const choice_method *by = n < 0 ? &own : methods + n;
        if (n >= 0 && (same_method(by, &own) || !has_elements(scene, by))) continue;
        for (int m = 0; m < num_meshes; m++) {
            bool fine = by->method == PLIANT_FINE;
            choice_mesh mesh = meshes[m];
            if (n < 0 && mesh.cells_factor == 1 && mesh.ratio == scene->mesh.ratio) continue;
            /* coarse cells do not affect the fine method; other methods need a coarser mesh */
            if (fine && mesh.cells_factor > 1 && is_listed(meshes, num_meshes, 1, mesh.cells_factor * mesh.ratio))
                continue;
            if (!fine && mesh.ratio == 1 && scene->choose.ratio) continue;
            out[count++] = (choice_candidate){*by, mesh};
        }
    }
    return count;
}

pliant_status choice_scene(const pliant_scene *scene, const choice_candidate *candidate, pliant_scene *out)
{
    *out = *scene;
    out->element.kind = pliant_scene_element_kind(scene, NULL); /* a candidate uses the scene's elements */
    out->model.method = candidate->by.method;
    out->model.submesh = candidate->by.submesh;
    out->model.patch = candidate->by.patch;
    out->mesh.ratio = candidate->mesh.ratio;
    for (int d = 0; d < 3; d++) out->mesh.coarse_cells[d] *= candidate->mesh.cells_factor;
    return pliant_scene_check(out);
}

const char *choice_describe(const choice_candidate *candidate, const pliant_scene *scene, char out[PLIANT_CHOICE_TEXT])
{
    const choice_method *by = &candidate->by;
    const char *submesh = choice_submesh_name(candidate);
    int32_t factor = candidate->mesh.cells_factor;
    const int32_t *cells = scene->mesh.coarse_cells;
    snprintf(out, PLIANT_CHOICE_TEXT, "model/method=%s%s%s mesh/coarse_cells=%d,%d,%d mesh/ratio=%d",
             method_names[by->method], submesh[0] ? " model/submesh=" : "", submesh, factor * cells[0],
             factor * cells[1], factor * cells[2], candidate->mesh.ratio);
    size_t used = strlen(out);
    if (by->patch != scene->model.patch) snprintf(out + used, PLIANT_CHOICE_TEXT - used, " model/patch=%g", by->patch);
    return out;
}

void choice_name_variant(const choice_candidate *candidate, const pliant_scene *scene, char out[CHOICE_VARIANT])
{
    int32_t factor = candidate->mesh.cells_factor;
    const int32_t *cells = scene->mesh.coarse_cells;
    const choice_method *by = &candidate->by;
    int used = 0;
    out[0] = '\0';
    if (factor > 1)
        used = snprintf(out, CHOICE_VARIANT, "mesh/coarse_cells=%d,%d,%d", factor * cells[0], factor * cells[1],
                        factor * cells[2]);
    if (by->patch != scene->model.patch)
        snprintf(out + used, (size_t)(CHOICE_VARIANT - used), "%smodel/patch=%g", used ? " " : "", by->patch);
}
