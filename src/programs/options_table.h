/* Print the table of all scene options. */
#ifndef PLIANT_TOOLS_OPTIONS_TABLE_H
#define PLIANT_TOOLS_OPTIONS_TABLE_H

#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Print Markdown, one row per option, in the order of pliant_scene_options. */
void options_table_print(FILE *file);

#ifdef __cplusplus
}
#endif
#endif
