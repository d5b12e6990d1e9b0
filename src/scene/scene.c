#include "pliant/scene.h"

#include "base/fail.h"
#include "scene/options.h"
#include "scene/scene.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { REASON_SIZE = 320 };

void pliant_scene_defaults(pliant_scene *scene)
{
    size_t count;
    const pliant_option *options = pliant_option_table(&count);
    memset(scene, 0, sizeof *scene);
    for (size_t i = 0; i < count; ++i) pliant_option_set_default(&options[i], scene);
}

/* Split "[7, 7, 7]" or "7 7 7" into words, in place. Return the number of words; at most three are stored. */
static int split(char *text, const char *words[3])
{
    static const char between[] = " ,\t[]";
    int number = 0;
    for (char *c = text; *(c += strspn(c, between));) {
        if (number < 3) words[number] = c;
        ++number;
        c += strcspn(c, between);
        if (*c) *c++ = 0;
    }
    return number;
}

pliant_status pliant_scene_set(pliant_scene *scene, const char *path, const char *value)
{
    char text[256], reason[REASON_SIZE];
    const char *words[3] = {value, "", ""};
    int number = 1;
    const pliant_option *option = pliant_option_find(path);
    if (!option) {
        const char *removed = pliant_scene_removed_option(path);
        return pliant_fail(PLIANT_ERROR_SCENE, "%s: %s", path, removed ? removed : "is not an option of a scene");
    }
    if (option->kind == PLIANT_OPTION_INT3 || option->kind == PLIANT_OPTION_REAL3) {
        if (strlen(value) >= sizeof text)
            return pliant_fail(PLIANT_ERROR_SCENE, "%s: '%.32s ...' is longer than %zu characters; use three numbers",
                               path, value, sizeof text - 1);
        strcpy(text, value);
        number = split(text, words);
    }
    if (pliant_option_read(option, words, number, scene, reason, sizeof reason))
        return pliant_fail(PLIANT_ERROR_SCENE, "%s: %s", path, reason);
    return PLIANT_OK;
}

const char *pliant_fixed_box_check(const pliant_fixed_box *box, char *reason, size_t size)
{
    for (int d = 0; d < 3; ++d) {
        if (isfinite(box->low[d]) && isfinite(box->high[d]) && box->low[d] < box->high[d]) continue;
        snprintf(reason, size, "axis %d: low %g must be less than high %g", d, box->low[d], box->high[d]);
        return reason;
    }
    return NULL;
}

const char *pliant_fixed_plane_check(const pliant_fixed_plane *plane, char *reason, size_t size)
{
    double length = 0, point = 0;
    for (int d = 0; d < 3; ++d) {
        length += plane->normal[d] * plane->normal[d];
        point += fabs(plane->point[d]);
    }
    if (length > 0 && isfinite(length) && isfinite(point)) return NULL;
    snprintf(reason, size, "normal [%g, %g, %g] must not be zero, and it and the point finite", plane->normal[0],
             plane->normal[1], plane->normal[2]);
    return reason;
}

static pliant_status check_regions(const pliant_regions *regions, const char *name)
{
    char reason[REASON_SIZE];
    if (regions->num_boxes > PLIANT_MAX_FIXED || regions->num_planes > PLIANT_MAX_FIXED)
        return pliant_fail(PLIANT_ERROR_SCENE, "%s: more than %d boxes or planes", name, PLIANT_MAX_FIXED);
    for (uint32_t i = 0; i < regions->num_boxes; ++i)
        if (pliant_fixed_box_check(&regions->boxes[i], reason, sizeof reason))
            return pliant_fail(PLIANT_ERROR_SCENE, "%s/boxes: number %u: %s", name, i + 1, reason);
    for (uint32_t i = 0; i < regions->num_planes; ++i)
        if (pliant_fixed_plane_check(&regions->planes[i], reason, sizeof reason))
            return pliant_fail(PLIANT_ERROR_SCENE, "%s/planes: number %u: %s", name, i + 1, reason);
    return PLIANT_OK;
}

static bool same_value(const pliant_option *option, const pliant_scene *a, const pliant_scene *b)
{
    const void *x = (const char *)a + option->offset, *y = (const char *)b + option->offset;
    switch (option->kind) {
    case PLIANT_OPTION_BOOL: return memcmp(x, y, sizeof(bool)) == 0;
    case PLIANT_OPTION_INT: return memcmp(x, y, sizeof(int32_t)) == 0;
    case PLIANT_OPTION_INT3: return memcmp(x, y, 3 * sizeof(int32_t)) == 0;
    case PLIANT_OPTION_REAL:
    case PLIANT_OPTION_LENGTH: return memcmp(x, y, sizeof(double)) == 0;
    case PLIANT_OPTION_REAL3: return memcmp(x, y, 3 * sizeof(double)) == 0;
    case PLIANT_OPTION_STRING: return strcmp(x, y) == 0;
    /* all enumerations have the same size */
    case PLIANT_OPTION_CHOICE: return memcmp(x, y, sizeof(pliant_method)) == 0;
    }
    return true;
}

static size_t append_name(const pliant_option *option, const char *words, char *names, size_t length, size_t size)
{
    if (length >= size) return length;
    return length + (size_t)snprintf(names + length, size - length, "%s%s/%s%s", length ? ", " : "", option->group,
                                     option->name, words);
}

bool pliant_scene_differs(const pliant_scene *scene, const pliant_scene *other, char *names, size_t size)
{
    size_t count, length = 0;
    const pliant_option *options = pliant_option_table(&count);
    names[0] = '\0';
    for (size_t i = 0; i < count; ++i)
        if (!same_value(&options[i], scene, other)) length = append_name(&options[i], " differs", names, length, size);
    return length > 0;
}

bool pliant_scene_changed(const pliant_scene *scene, const char *const *groups, char *names, size_t size)
{
    size_t count, length = 0;
    const pliant_option *options = pliant_option_table(&count);
    pliant_scene defaults;
    pliant_scene_defaults(&defaults);
    names[0] = '\0';
    for (; *groups; ++groups)
        for (size_t i = 0; i < count; ++i) {
            if (strcmp(options[i].group, *groups) != 0 || same_value(&options[i], scene, &defaults)) continue;
            length = append_name(&options[i], "", names, length, size);
        }
    return length > 0;
}

pliant_status pliant_scene_check(const pliant_scene *scene)
{
    size_t count;
    char reason[REASON_SIZE];
    const pliant_option *options = pliant_option_table(&count);
    for (size_t i = 0; i < count; ++i)
        if (pliant_option_check(&options[i], scene, reason, sizeof reason))
            return pliant_fail(PLIANT_ERROR_SCENE, "%s/%s: %s", options[i].group, options[i].name, reason);
    if (scene->contact.response == PLIANT_RESPONSE_PAPER &&
        (scene->solver.kind != PLIANT_TLED || scene->tled.quasi_static))
        return pliant_fail(
            PLIANT_ERROR_SCENE,
            "contact/response: paper needs explicit dynamics; set solver/kind: tled and tled/quasi_static: false");
    pliant_status status = check_regions(&scene->fixed, "fixed");
    return status == PLIANT_OK ? check_regions(&scene->obstacles, "obstacles") : status;
}
