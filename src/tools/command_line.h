/* What the programs' command lines have in common. */
#ifndef PLIANT_TOOLS_COMMAND_LINE_H
#define PLIANT_TOOLS_COMMAND_LINE_H

#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* --set group/name=value; false after a message on stderr. */
bool command_line_set(pliant_scene *scene, const char *text);

/* The folder for results and those above it, where they are missing. Errors: FILE. */
pliant_status command_line_folder(const char *folder);

#ifdef __cplusplus
}
#endif
#endif
