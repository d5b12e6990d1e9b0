/* A tool's shape as it stands in a YAML file. */
#ifndef PLIANT_INTERACT_SHAPE_TEXT_H
#define PLIANT_INTERACT_SHAPE_TEXT_H

#include "pliant/contact.h"
#include "scene/yaml.h"

typedef struct pliant_part_text {
    char *kind, *moves, *radius, *cuts, **from, **to;
    char *file, *unit, *resolution, **rpy, ***points; /* of solids */
    uint32_t num_points;
} pliant_part_text;

typedef struct pliant_shape_text {
    char *name, **offset; /* a built-in one, or: */
    pliant_part_text *parts;
    uint32_t num_parts;
    char **joint, **axis;
} pliant_shape_text;

extern const cyaml_schema_field_t pliant_shape_fields[];

/* Files lie relative to that which the text is from. Free with pliant_tool_shape_free. false: "shape/FIELD: what is wrong" in reason, nothing
 * where it is memory */
bool pliant_shape_from_text(const pliant_shape_text *text, const char *beside, pliant_tool_shape *out, char *reason, size_t size);

#endif
