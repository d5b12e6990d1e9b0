/* The table of every scene option, as the README shows it. */
#ifndef PLIANT_TOOLS_OPTIONS_TABLE_H
#define PLIANT_TOOLS_OPTIONS_TABLE_H

#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Markdown, one row an option, in the order of pliant_scene_options. */
void options_table_print(FILE *file);

#ifdef __cplusplus
}
#endif
#endif
