/** @file open.h
 *  Who may decide what is read: a scan, a label map or a table may name further files (a data file, the images of a
 *  folder), and a link may lead anywhere. Whoever takes paths from strangers sets a check.
 */
#ifndef PLIANT_OPEN_H
#define PLIANT_OPEN_H

#include "pliant/version.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Asked before a file or folder is read.
 *  @param real_path absolute, links followed, without "..": of the very thing that will be read.
 *  @return NULL: it may be read; otherwise the reason why not, a few words, valid until the next call. The reader then
 *          ends with PLIANT_ERROR_FILE. */
typedef const char *(*pliant_open_function)(const char *real_path, void *user);

typedef struct pliant_open_check {
    pliant_open_function function; /**< Nullable: everything may be read (the default) */
    void *user;
} pliant_open_check;

/** Set the check of the calling thread, for every function that reads a file by its path (pliant_volume_read,
 *  pliant_labels_read, pliant_material_table_read, pliant_scene_read, pliant_inputs_read and the like). With a check,
 *  a file is held open between the question and the reading, so that nothing can be put in its place; this takes
 *  Linux's /proc, and without it everything is refused.
 *  @return the check that was set before. */
PLIANT_API pliant_open_check pliant_set_open_check(pliant_open_check check);

#ifdef __cplusplus
}
#endif
#endif
