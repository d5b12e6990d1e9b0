/* YAML through libcyaml: text in, struct out, one message per mistake that names file, line and key.
   Numbers are read as text and converted here, because libcyaml takes "3x" for 3 and "maybe" for true. */
#ifndef PLIANT_SCENE_YAML_H
#define PLIANT_SCENE_YAML_H

#include "pliant/status.h"

#include <cyaml/cyaml.h>

/* The whole of a text file, with a 0 at its end. Free with pliant_free. Errors: FILE, FORMAT (not text, or longer than 64 MiB),
   MEMORY. */
pliant_status pliant_text_read(const char *path, char **text);

/* A document by its schema, whose top level is a CYAML_FLAG_POINTER mapping. *out is NULL for an empty document.
   Free with pliant_yaml_free. Errors: FORMAT (name, line, key and what would be right), MEMORY. */
pliant_status pliant_yaml_load(const char *text, const char *name, const cyaml_schema_value_t *schema, void **out);
void pliant_yaml_free(const cyaml_schema_value_t *schema, void *data); /* Nullable */

/* Line, from 1, of the occurrence-th (from 0) place where text has `key:`, behind line `from`. 0: nowhere. */
int pliant_yaml_line(const char *text, const char *key, int occurrence, int from);

/* Conversions that take the whole of the text or nothing, whatever the locale. */
bool pliant_parse_real(const char *text, double *out); /* finite */
bool pliant_parse_integer(const char *text, int64_t *out);
bool pliant_parse_bool(const char *text, bool *out); /* true yes on 1, false no off 0 */

/* And back: text that is written where there is room, and counted whether or not. */
typedef struct pliant_text_out {
    char *out; /* Nullable */
    size_t room, length;
} pliant_text_out;
void pliant_text_add(pliant_text_out *text, const char *words);
void pliant_text_add_real(pliant_text_out *text, double value); /* the fewest digits that are read as the same number */
void pliant_text_add_quoted(pliant_text_out *text, const char *words);
/* "[a, b, c]" */
void pliant_text_add_reals(pliant_text_out *text, const double *values, int count);

#endif
