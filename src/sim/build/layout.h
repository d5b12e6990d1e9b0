/* Where the fields of public structs lie, for bindings of other languages (src/python/pliant_library.py): they ask the library that runs
 *  instead of repeating its headers.
 */
#ifndef PLIANT_SIM_LAYOUT_H
#define PLIANT_SIM_LAYOUT_H

#include "base/export.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/** One field; count numbers of a kind one after the other. */
typedef struct pliant_field_layout {
    const char *of, *name; /**< "pliant_body", "fine.rest" */
    char kind;             /**< d double, f float, i int32_t or an enumeration, I uint32_t, Q uint64_t, H uint16_t, B uint8_t, ? bool, N size_t,
                            *   P pointer, s text that ends with 0, x a struct of its own
                            *   (Python's struct module calls them so) */
    size_t offset, count;  /**< [bytes], of that kind */
} pliant_field_layout;

/** All that are told. Static. */
PLIANT_INTERNAL const pliant_field_layout *pliant_layout_fields(size_t *count);
/** Of a struct that is told of, or that callers must make room for (pliant_scene, pliant_labels, ...) [bytes]; 0: another name. */
PLIANT_INTERNAL size_t pliant_layout_size(const char *of);

#ifdef __cplusplus
}
#endif
#endif
