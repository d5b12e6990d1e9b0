/* Offsets of the fields of public structs, for bindings of other languages (src/python/pliant_library.py). The
 * bindings query the loaded library instead of repeating its headers. */
#ifndef PLIANT_SIM_BUILD_STRUCT_LAYOUT_H
#define PLIANT_SIM_BUILD_STRUCT_LAYOUT_H

#include "base/export.h"

#include <stddef.h>

/** One field: `count` consecutive numbers of one kind. */
typedef struct pliant_field_layout {
    const char *of, *name; /**< "pliant_body", "fine.rest" */
    /** kind, as in Python's struct module: d double, f float, i int32_t or an enumeration, I uint32_t, Q uint64_t, H
     * uint16_t, B uint8_t, ? bool, N size_t, P pointer, s zero-terminated text; in addition x: a struct */
    char kind;
    size_t offset, count;  /**< offset [bytes]; number of values */
} pliant_field_layout;

/** Return all fields that are listed. The array is static. */
PLIANT_INTERNAL const pliant_field_layout *pliant_layout_fields(size_t *count);
/** Return the size of a listed struct, or of a struct that callers must allocate (pliant_scene, pliant_labels, ...)
 * [bytes]; 0: unknown name. */
PLIANT_INTERNAL size_t pliant_layout_size(const char *of);

#endif
