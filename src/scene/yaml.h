/* Read YAML with libcyaml into structs. An error message names file, line and key. Numbers are read as text and
 * converted here, because libcyaml accepts "3x" as 3 and "maybe" as true. */
#ifndef PLIANT_SCENE_YAML_H
#define PLIANT_SCENE_YAML_H

#include "pliant/status.h"

#include <cyaml/cyaml.h>

/* Read a whole text file, terminated by 0. Free with pliant_free. Errors: FILE, FORMAT (not text, or longer than 64
 * MiB), MEMORY. */
pliant_status pliant_text_read(const char *path, char **text);

/* Read a document by its schema, whose top level is a CYAML_FLAG_POINTER mapping. *out is NULL for an empty document.
 * Free with pliant_yaml_free. Errors: FORMAT (name, line, key and the accepted values), MEMORY. */
pliant_status pliant_yaml_load(const char *text, const char *name, const cyaml_schema_value_t *schema, void **out);
void pliant_yaml_free(const cyaml_schema_value_t *schema, void *data); /* Nullable */

/* Return the line, from 1, of an occurrence (from 0) of `key:` in text after line `from`; 0: not found. */
int pliant_yaml_line(const char *text, const char *key, int occurrence, int from);

/* Convert a complete text independently of the locale. Return false if any part cannot be converted. */
bool pliant_parse_real(const char *text, double *out); /* finite */
bool pliant_parse_integer(const char *text, int64_t *out);
bool pliant_parse_bool(const char *text, bool *out); /* true yes on 1, false no off 0 */

/* Output buffer. Text is written up to its capacity; the length counts all text. */
typedef struct pliant_text_out {
    char *out; /* Nullable */
    size_t capacity, length;
} pliant_text_out;
void pliant_text_add(pliant_text_out *text, const char *words);
/* with the minimum number of digits that reproduces the number */
void pliant_text_add_real(pliant_text_out *text, double value);
void pliant_text_add_quoted(pliant_text_out *text, const char *words);
/* write "[a, b, c]" */
void pliant_text_add_reals(pliant_text_out *text, const double *values, int count);

#endif
