/* Files of VTK's XML formats. */
#include "base/vtk_file.h"

#include "base/fail.h"
#include "base/replace.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
               "arrays are written in the byte order of the machine: little-endian");

static const struct {
    const char *name;
    size_t size;
} types[] = {{"UInt8", 1}, {"UInt16", 2}, {"Int32", 4}, {"Float32", 4}, {"Float64", 8}};

static uint64_t bytes_of(const vtk_array *array)
{
    return (uint64_t)(array->count * (size_t)array->components * types[array->type].size);
}

/* Write the headers of a section's arrays, with their offsets in the appended data. */
static void write_section(FILE *file, vtk_section section, const char *name, const vtk_array *arrays, int num_arrays)
{
    uint64_t offset = 0;
    fprintf(file, "      <%s>\n", name);
    for (int n = 0; n < num_arrays; n++) {
        const vtk_array *array = arrays + n;
        if (array->section == section) {
            fprintf(file, "        <DataArray type=\"%s\" Name=\"%s\"", types[array->type].name, array->name);
            if (array->components > 1) fprintf(file, " NumberOfComponents=\"%d\"", array->components);
            fprintf(file, " format=\"appended\" offset=\"%" PRIu64 "\"/>\n", offset);
        }
        offset += sizeof(uint64_t) + bytes_of(array);
    }
    fprintf(file, "      </%s>\n", name);
}

static void write_header(FILE *file, bool is_surface, const char *comment, size_t points, size_t cells,
                         const vtk_array *arrays, int num_arrays)
{
    const char *grid = is_surface ? "PolyData" : "UnstructuredGrid";
    fprintf(file, "<?xml version=\"1.0\"?>\n<!-- %s -->\n", comment);
    fprintf(file, "<VTKFile type=\"%s\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n  <%s>\n",
            grid, grid);
    fprintf(file, "    <Piece NumberOfPoints=\"%zu\" %s=\"%zu\">\n", points,
            is_surface ? "NumberOfPolys" : "NumberOfCells", cells);
    write_section(file, VTK_POINTS, "Points", arrays, num_arrays);
    write_section(file, VTK_CELLS, is_surface ? "Polys" : "Cells", arrays, num_arrays);
    write_section(file, VTK_POINT_DATA, "PointData", arrays, num_arrays);
    write_section(file, VTK_CELL_DATA, "CellData", arrays, num_arrays);
    fprintf(file, "    </Piece>\n  </%s>\n  <AppendedData encoding=\"raw\">\n_", grid);
}

static bool write_all(FILE *file, const vtk_array *arrays, int num_arrays)
{
    bool done = true;
    for (int n = 0; done && n < num_arrays; n++) {
        const uint64_t bytes = bytes_of(arrays + n);
        done = fwrite(&bytes, sizeof bytes, 1, file) == 1 &&
               fwrite(arrays[n].data, 1, (size_t)bytes, file) == (size_t)bytes;
    }
    fputs("\n  </AppendedData>\n</VTKFile>\n", file);
    return done && !ferror(file);
}

pliant_status pliant_vtk_write(const char *path, bool is_surface, const char *comment, size_t points, size_t cells,
                               const vtk_array *arrays, int num_arrays)
{
    char temporary[PATH_MAX];
    const int descriptor = pliant_open_temporary(path, temporary);
    if (descriptor < 0)
        return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be written: no file can be created in its folder: %s", path,
                           strerror(errno));
    FILE *file = fdopen(descriptor, "wb");
    if (!file) close(descriptor);
    bool done = file != NULL;
    errno = 0;
    if (done) write_header(file, is_surface, comment, points, cells, arrays, num_arrays);
    done = done && write_all(file, arrays, num_arrays);
    if (file && fclose(file) != 0) done = false;
    if (done && rename(temporary, path) == 0) return PLIANT_OK;
    const int reason = errno;
    unlink(temporary);
    return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be written: %s", path,
                       reason ? strerror(reason) : "is the disk full?");
}
