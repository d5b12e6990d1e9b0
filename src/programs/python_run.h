/* Run Python programs with an interpreter that has the required packages. */
#ifndef PLIANT_TOOLS_PYTHON_RUN_H
#define PLIANT_TOOLS_PYTHON_RUN_H

#ifdef __cplusplus
extern "C" {
#endif

/* Return a python3 that has these packages ("numpy, pyarrow"): the first on the path, or the distribution's; NULL:
 * none. */
const char *python_find(const char *packages);
/* Run a program with its arguments, terminated by NULL. Return its exit code; 127 if it does not exist. */
int python_run(const char *const *words);

#ifdef __cplusplus
}
#endif
#endif
