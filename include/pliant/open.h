/** @file open.h
 *  Check of every path before a file is read, for programs that receive paths from others.
 *
 *  A scan, a label map or a material table may name further files: a data file, or the images of a folder. A link may
 *  lead anywhere.
 */
#ifndef PLIANT_OPEN_H
#define PLIANT_OPEN_H

#include "pliant/version.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Decide whether a file or folder may be read. real_path is absolute, with links resolved and without "..".
 *  @return NULL to allow. Otherwise the reason in a few words, valid until the next call: the reader ends with FILE. */
typedef const char *(*pliant_open_function)(const char *real_path, void *user);

/** Check of paths. */
typedef struct pliant_open_check {
    pliant_open_function function; /**< Nullable: every file may be read (the default) */
    void *user;                    /**< passed to every call */
} pliant_open_check;

/** Set the check of the calling thread. It applies to all functions that read a file by its path, such as
 *  pliant_volume_read, pliant_labels_read, pliant_material_table_read, pliant_scene_read and pliant_inputs_read. The
 *  file stays open between the check and the reading, so that nobody can replace it. This needs Linux's /proc: without
 *  it, a set check refuses every file.
 *  @param check Copied; its user pointer is borrowed until another check is set.
 *  @return The previous check of the thread. */
PLIANT_API pliant_open_check pliant_set_open_check(pliant_open_check check);

#ifdef __cplusplus
}
#endif
#endif
