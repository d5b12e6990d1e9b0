/* Files of VTK's XML formats: .vtu and .vtp. */
#ifndef PLIANT_BASE_VTK_FILE_H
#define PLIANT_BASE_VTK_FILE_H

#include "pliant/status.h"

typedef enum vtk_type { VTK_UINT8, VTK_UINT16, VTK_INT32, VTK_FLOAT32, VTK_FLOAT64 } vtk_type;
typedef enum vtk_section { VTK_POINTS, VTK_CELLS, VTK_POINT_DATA, VTK_CELL_DATA } vtk_section;

/* Values of all points or cells. */
typedef struct vtk_array {
    vtk_section section;
    const char *name;
    vtk_type type;
    int components;
    size_t count;     /* number of points or cells, or of connectivity values */
    const void *data; /* borrowed */
} vtk_array;

/* Write a VTK file: appended binary data, with the arrays sorted by section. The file is complete or absent.
 * @param is_surface  True: .vtp with triangles (arrays connectivity, offsets); false: .vtu (and types).
 * @param comment     Without "--".
 * Errors: FILE. */
pliant_status pliant_vtk_write(const char *path, bool is_surface, const char *comment, size_t points, size_t cells,
                               const vtk_array *arrays, int num_arrays);

#endif
