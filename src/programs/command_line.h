/* Functions shared by the command lines of the programs. */
#ifndef PLIANT_TOOLS_COMMAND_LINE_H
#define PLIANT_TOOLS_COMMAND_LINE_H

#include "pliant/scene.h"

#include <getopt.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { EXIT_OK = 0, EXIT_FAILED = 1, EXIT_USAGE = 2, EXIT_STOPPED = 130 };

/* Set an option of a scene from the value of --set, group/name=value. Return false after a message on stderr. */
bool command_line_set(pliant_scene *scene, const char *text);

/* Read the scene: first the scene file, if given, then every --set group/name=value, in any order on the command line.
 * Call it after getopt_long has processed all arguments; it processes them again from the start.
 * @param options, set the program's options, and the value of its --set
 * @return false after a message on stderr, with *exit_code */
bool command_line_scene(int argc, char **argv, const struct option *options, int set, pliant_scene *scene,
                        int *exit_code);

/* Read the value "X,Y,Z" of an option. Return false after a message on stderr. */
bool command_line_point(const char *option, const char *text, double out[3]);

/* Create the folder for results and its parents if they are missing. Errors: FILE. */
pliant_status command_line_folder(const char *folder);

#ifdef __cplusplus
}
#endif
#endif
