/* What the programs' command lines have in common. */
#ifndef PLIANT_TOOLS_COMMAND_LINE_H
#define PLIANT_TOOLS_COMMAND_LINE_H

#include "pliant/scene.h"

#include <getopt.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { EXIT_OK = 0, EXIT_FAILED = 1, EXIT_USAGE = 2, EXIT_STOPPED = 130 };

/* The scene: the file first, if one is named, then what every --set group/name=value changes, wherever they stand. To be called when
 * getopt_long has gone through all; it begins anew.
 *  @param options, set those of the program, and the value of its --set
 *  @return false after a message on stderr, with *exit_code */
bool command_line_scene(int argc, char **argv, const struct option *options, int set, pliant_scene *scene, int *exit_code);

/* The folder for results and those above it, where they are missing. Errors: FILE. */
pliant_status command_line_folder(const char *folder);

#ifdef __cplusplus
}
#endif
#endif
