/* Tool shapes in YAML files. */
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
    char *name, **offset; /* a built-in shape and its offset, or parts */
    pliant_part_text *parts;
    uint32_t num_parts;
    char **joint, **axis;
} pliant_shape_text;

extern const cyaml_schema_field_t pliant_shape_fields[];

/* Build a shape. Relative paths start at the folder of the file `base_file`. Free with pliant_tool_shape_free. Return
 * false with "shape/FIELD: error" in reason; an empty reason means that memory is exhausted. */
bool pliant_shape_from_text(const pliant_shape_text *text, const char *base_file, pliant_tool_shape *out, char *reason,
                            size_t size);

#endif
