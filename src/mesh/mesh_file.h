/* Tetrahedral meshes of other programs: VTK's .vtu and Gmsh's .msh. */
#ifndef PLIANT_MESH_MESH_FILE_H
#define PLIANT_MESH_MESH_FILE_H

#include "pliant/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* How a file describes regions. */
typedef enum mesh_regions {
    MESH_REGIONS_NONE,      /* nothing */
    MESH_REGIONS_NUMBERED,  /* a number per tetrahedron, optionally with a name: like labels of a label map */
    MESH_REGIONS_MATERIALS  /* numbers are indices in the material table (the array `material` of pliant_mesh_save) */
} mesh_regions;

typedef struct mesh_region_name {
    int64_t number;
    char name[64];
} mesh_region_name;

typedef struct mesh_file {
    int32_t num_nodes, num_tets;
    double *nodes;          /* (num_nodes x 3) [m] */
    int32_t *tets;          /* (num_tets x 4) */
    mesh_regions regions;
    int64_t *region;        /* (num_tets) of each tetrahedron; NULL: none */
    int32_t num_names;
    mesh_region_name *name; /* (num_names) */
} mesh_file;

/* Read a mesh file by the extension of its path. Tetrahedra are oriented positively, and unused nodes are dropped.
 * unit: unit of lengths in the file [m]. Free the result with mesh_file_free. Errors (*out unchanged): FILE, FORMAT
 * (with the remedy), MEMORY. */
pliant_status pliant_mesh_file_read(const char *path, double unit, mesh_file *out);
void pliant_mesh_file_free(mesh_file *file); /* Nullable */

/* A complete file in memory, followed by a 0. */
typedef struct file_text {
    const char *path;
    char *data;
    size_t size;
} file_text;

/* Parse a format: connectivity, nodes and regions as in the file. *out is zeroed before; the caller frees it, also
 * after an error. */
pliant_status pliant_mesh_parse_msh(const file_text *text, mesh_file *out);
pliant_status pliant_mesh_parse_vtu(const file_text *text, mesh_file *out);

/* Build the fine mesh of a file. Its tetrahedra are sorted into cells by their centres, so that pliant_mesh_locate
 * finds points.
 * @param scan       Its box must overlap the mesh.
 * @param material   (file's num_tets); empty tetrahedra are left out unless keep_air.
 * @param materials  Out: (out's num_tets), freed with pliant_free.
 * Errors: SCENE, MEMORY. */
pliant_status pliant_mesh_of_file(const char *path, const mesh_file *file, const pliant_geometry *scan,
                                  const uint8_t *material, bool keep_air, const pliant_material_table *table,
                                  pliant_mesh *out, pliant_tet_material **materials);

#ifdef __cplusplus
}
#endif
#endif
