/* Write a scene as YAML that scene_yaml.c reads. */
#include "scene/options.h"
#include "scene/scene.h"
#include "scene/yaml.h"

#include <stdio.h>
#include <string.h>

static void add_whole(pliant_text_out *text, int32_t value)
{
    char digits[16];
    snprintf(digits, sizeof digits, "%d", value);
    pliant_text_add(text, digits);
}

static void add_value(pliant_text_out *text, const pliant_option *option, const pliant_scene *scene)
{
    const void *value = (const char *)scene + option->offset;
    const int32_t *whole = value;
    switch (option->kind) {
    case PLIANT_OPTION_BOOL: pliant_text_add(text, *(const bool *)value ? "true" : "false"); break;
    case PLIANT_OPTION_INT: add_whole(text, *whole); break;
    case PLIANT_OPTION_INT3:
        for (int d = 0; d < 3; ++d) {
            pliant_text_add(text, d ? ", " : "[");
            add_whole(text, whole[d]);
        }
        pliant_text_add(text, "]");
        break;
    case PLIANT_OPTION_LENGTH:
        if (*(const double *)value == PLIANT_AUTO_LENGTH) pliant_text_add(text, "auto");
        else pliant_text_add_real(text, *(const double *)value);
        break;
    case PLIANT_OPTION_REAL: pliant_text_add_real(text, *(const double *)value); break;
    case PLIANT_OPTION_REAL3: pliant_text_add_reals(text, value, 3); break;
    case PLIANT_OPTION_STRING: pliant_text_add_quoted(text, value); break;
    case PLIANT_OPTION_CHOICE: pliant_text_add(text, option->names[*(const int *)value]); break;
    }
}

static void add_pair(pliant_text_out *text, const char *first, const double a[3], const char *second, const double b[3])
{
    pliant_text_add(text, "    - {");
    pliant_text_add(text, first);
    pliant_text_add_reals(text, a, 3);
    pliant_text_add(text, second);
    pliant_text_add_reals(text, b, 3);
    pliant_text_add(text, "}\n");
}

static void add_regions(pliant_text_out *text, const char *name, const pliant_regions *regions)
{
    if (regions->num_boxes + regions->num_planes == 0) return;
    pliant_text_add(text, name);
    if (regions->num_boxes > 0) pliant_text_add(text, "  boxes:\n");
    for (uint32_t b = 0; b < regions->num_boxes; ++b)
        add_pair(text, "low: ", regions->boxes[b].low, ", high: ", regions->boxes[b].high);
    if (regions->num_planes > 0) pliant_text_add(text, "  planes:\n");
    for (uint32_t p = 0; p < regions->num_planes; ++p)
        add_pair(text, "point: ", regions->planes[p].point, ", normal: ", regions->planes[p].normal);
}

size_t pliant_scene_text(const pliant_scene *scene, size_t capacity, char *out)
{
    pliant_text_out text = {out, capacity, 0};
    size_t count;
    const pliant_option *options = pliant_option_table(&count);
    if (capacity > 0) out[0] = '\0';
    for (size_t i = 0; i < count; ++i) {
        if (i == 0 || strcmp(options[i].group, options[i - 1].group) != 0) {
            pliant_text_add(&text, options[i].group);
            pliant_text_add(&text, ":\n");
        }
        pliant_text_add(&text, "  ");
        pliant_text_add(&text, options[i].name);
        pliant_text_add(&text, ": ");
        add_value(&text, &options[i], scene);
        pliant_text_add(&text, "\n");
    }
    add_regions(&text, "fixed:\n", &scene->fixed);
    add_regions(&text, "obstacles:\n", &scene->obstacles);
    return text.length;
}
