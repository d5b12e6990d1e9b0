/* Table of all scene options: their offset in the struct, their type and their range. */
#ifndef PLIANT_SCENE_OPTIONS_H
#define PLIANT_SCENE_OPTIONS_H

#include "pliant/scene.h"

typedef enum pliant_option_kind {
    PLIANT_OPTION_BOOL,
    PLIANT_OPTION_INT,
    PLIANT_OPTION_INT3,
    PLIANT_OPTION_REAL,
    PLIANT_OPTION_REAL3,
    PLIANT_OPTION_LENGTH, /* a real number, or auto */
    PLIANT_OPTION_STRING,
    PLIANT_OPTION_CHOICE
} pliant_option_kind;

typedef struct pliant_option {
    const char *group, *name, *unit, *text, *string_value;
    pliant_option_kind kind;
    size_t offset;             /* in pliant_scene */
    double value, low, high;   /* default and range of a number; default of a bool or an enumeration */
    const char *const *names;  /* of an enumeration; ends with NULL */
} pliant_option;

const pliant_option *pliant_option_table(size_t *count);

/* Return the option with the path "group/name"; NULL: unknown. */
const pliant_option *pliant_option_find(const char *path);

/* Read `number` words to the option's value in the scene, which is unchanged on failure. Return NULL, or an error
 * message in reason (at most size characters). */
const char *pliant_option_read(const pliant_option *option, const char *const *words, int number, pliant_scene *scene,
                               char *reason, size_t size);

/* Return NULL, or an error message about the option's value in the scene. */
const char *pliant_option_check(const pliant_option *option, const pliant_scene *scene, char *reason, size_t size);

/* Return NULL, or an error message about a fixed region. */
const char *pliant_fixed_box_check(const pliant_fixed_box *box, char *reason, size_t size);
const char *pliant_fixed_plane_check(const pliant_fixed_plane *plane, char *reason, size_t size);

/* Return whether an option of these groups (NULL at the end) differs from its default. names: "a/b, a/c". */
bool pliant_scene_changed(const pliant_scene *scene, const char *const *groups, char *names, size_t size);

/* Return whether an option differs from the other scene. names: "group/name differs, group/name differs". */
bool pliant_scene_differs(const pliant_scene *scene, const pliant_scene *other, char *names, size_t size);

void pliant_option_set_default(const pliant_option *option, pliant_scene *scene);

#endif
