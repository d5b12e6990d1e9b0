#include "scene/elements.h"

#include "base/fail.h"
#include "scene/scene.h"

#include <stddef.h>

/* A feature that requires tetrahedra. */
typedef struct tetrahedral {
    bool is_requested;
    const char *what;    /* option and reason */
    const char *instead; /* alternative with hexahedra; NULL: hexahedra work, but tetrahedra are more robust */
} tetrahedral;

/* Return the first such feature that a scene requests; .what NULL: none.
 * alone: only features that do not work with hexahedra */
static tetrahedral first_tetrahedral(const pliant_scene *scene, bool alone)
{
    const bool tled = scene->solver.kind == PLIANT_TLED;
    const tetrahedral all[] = {
        {scene->cut.kind == PLIANT_CUT_SUBDIVIDE, "cut/kind: subdivide cuts tetrahedra", "sever"},
        {scene->mesh.file[0] != 0, "mesh/file is a mesh of tetrahedra", "an empty text"},
        {scene->contact.self || scene->contact.obstacles[0] || scene->obstacles.num_boxes > 0 ||
             scene->obstacles.num_planes > 0,
         "contact/self, obstacles: thin sheets of hexahedra fold over what presses them", NULL},
        {tled && scene->tled.nodal_pressure,
         "tled/nodal_pressure: hexahedra have one change of volume each and need none", "false"},
    };
    for (size_t n = 0; n < sizeof all / sizeof *all; n++)
        if (all[n].is_requested && (all[n].instead || !alone)) return all[n];
    return (tetrahedral){false, NULL, NULL};
}

pliant_element_kind pliant_scene_element_kind(const pliant_scene *scene, const char **why)
{
    const bool is_auto = scene->element.kind == PLIANT_ELEMENT_AUTO;
    const char *what = is_auto ? first_tetrahedral(scene, false).what : NULL;
    if (why) *why = what;
    if (!is_auto) return scene->element.kind;
    return what ? PLIANT_LINEAR : PLIANT_HEXAHEDRA;
}

void pliant_scene_for_shapes(pliant_scene *scene)
{
    if (scene->element.kind == PLIANT_ELEMENT_AUTO) scene->element.kind = PLIANT_LINEAR;
}

pliant_status pliant_scene_check_elements(const pliant_scene *scene)
{
    if (scene->element.kind != PLIANT_HEXAHEDRA) return PLIANT_OK;
    const tetrahedral first = first_tetrahedral(scene, true);
    return first.what ? pliant_fail(PLIANT_ERROR_SCENE, "%s; set it to %s, or element/kind to auto or linear",
                                    first.what, first.instead)
                      : PLIANT_OK;
}
