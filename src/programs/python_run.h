/* Python programs, run where their packages are. */
#ifndef PLIANT_TOOLS_PYTHON_RUN_H
#define PLIANT_TOOLS_PYTHON_RUN_H

#ifdef __cplusplus
extern "C" {
#endif

/* The python3 that has these packages ("numpy, pyarrow"): the first on the path, or the distribution's; NULL: none. */
const char *python_find(const char *packages);
/* Runs a program with its arguments, the last NULL. Returns its exit code; 127 when there is none of this name. */
int python_run(const char *const *words);

#ifdef __cplusplus
}
#endif
#endif
