/* Writes volumes, label maps and vector fields to a file in the target's folder, which is renamed when it is
 * complete. */
#include "scan/write.h"

#include "base/fail.h"
#include "base/replace.h"
#include "base/memory.h"

#include <errno.h>
#include <limits.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
               "voxels are written in the byte order of the machine: little-endian");

typedef enum file_format { FORMAT_NONE, FORMAT_NIFTI, FORMAT_NIFTI_GZ, FORMAT_NRRD, FORMAT_METAIMAGE } file_format;

/* The image to write: a volume without scale, labels, or vectors. */
typedef struct image_data {
    const pliant_geometry *geometry;
    int type; /* index in the table below */
    const void *voxels;
    bool is_vector; /* three numbers per voxel, in NIfTI one component after the other */
} image_data;

enum { TYPE_UINT8, TYPE_INT16, TYPE_UINT16, TYPE_FLOAT32 };
static const struct type_names {
    size_t size;
    int16_t nifti;
    const char *nrrd, *metaimage;
} types[] = {{1, 2, "uchar", "MET_UCHAR"},
             {2, 4, "short", "MET_SHORT"},
             {2, 512, "ushort", "MET_USHORT"},
             {4, 16, "float", "MET_FLOAT"}};

static file_format format_of(const char *path)
{
    static const struct { const char *ending; file_format format; } endings[] = {
        {".nii", FORMAT_NIFTI}, {".nii.gz", FORMAT_NIFTI_GZ}, {".nrrd", FORMAT_NRRD}, {".mha", FORMAT_METAIMAGE}};
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    size_t length = strlen(name);
    for (size_t n = 0; n < sizeof endings / sizeof *endings; n++) {
        size_t ending = strlen(endings[n].ending);
        if (length > ending && strcasecmp(name + length - ending, endings[n].ending) == 0) return endings[n].format;
    }
    return FORMAT_NONE;
}

/* --- headers --- */

enum { NIFTI_HEADER = 352, HEADER_SIZE = 2048 };

static void put_short(unsigned char *header, size_t at, int value)
{
    int16_t number = (int16_t)value;
    memcpy(header + at, &number, sizeof number);
}

static void put_float(unsigned char *header, size_t at, double value)
{
    float number = (float)value;
    memcpy(header + at, &number, sizeof number);
}

/* Compute the unit quaternion (a >= 0) of a proper rotation, starting with the largest component for accuracy (S. W.
 * Shepperd, Quaternion from rotation matrix, 1978). */
static void quaternion_of(const double r[9], double q[4])
{
    double squares[4] = {1 + r[0] + r[4] + r[8], 1 + r[0] - r[4] - r[8], 1 - r[0] + r[4] - r[8],
                         1 - r[0] - r[4] + r[8]};
    int largest = 0;
    for (int n = 1; n < 4; n++)
        if (squares[n] > squares[largest]) largest = n;
    double s = 0.5 / sqrt(squares[largest]);
    const double table[4][4] = {{squares[0], r[7] - r[5], r[2] - r[6], r[3] - r[1]},
                                {r[7] - r[5], squares[1], r[1] + r[3], r[2] + r[6]},
                                {r[2] - r[6], r[1] + r[3], squares[2], r[5] + r[7]},
                                {r[3] - r[1], r[2] + r[6], r[5] + r[7], squares[3]}};
    double sign = table[largest][0] < 0 ? -1 : 1;
    for (int n = 0; n < 4; n++) q[n] = sign * s * table[largest][n];
}

static size_t nifti_header(const image_data *image, unsigned char *header)
{
    const pliant_geometry *geometry = image->geometry;
    const struct type_names *type = &types[image->type];
    double ras[9], spacing[3], origin[3], q[4];
    for (int row = 0; row < 3; row++) {
        double sign = row < 2 ? -1 : 1; /* LPS to RAS */
        for (int axis = 0; axis < 3; axis++) ras[3 * row + axis] = sign * geometry->direction[3 * row + axis];
        origin[row] = sign * 1e3 * geometry->origin[row];
        spacing[row] = 1e3 * geometry->spacing[row];
    }
    memset(header, 0, NIFTI_HEADER);
    const int32_t size = 348;
    memcpy(header, &size, sizeof size);
    put_short(header, 40, 3);
    for (size_t d = 0; d < 3; d++) put_short(header, 42 + 2 * d, geometry->size[d]);
    for (size_t d = 4; d < 8; d++) put_short(header, 40 + 2 * d, 1);
    if (image->is_vector) { /* as ITK writes a displacement field: components along the fifth axis, in LPS */
        const int nifti_intent_vector = 1007;
        put_short(header, 40, 5);
        put_short(header, 50, 3);
        put_short(header, 68, nifti_intent_vector);
    }
    put_short(header, 70, type->nifti);
    put_short(header, 72, (int)(8 * type->size));

    double determinant = ras[0] * (ras[4] * ras[8] - ras[5] * ras[7]) - ras[1] * (ras[3] * ras[8] - ras[5] * ras[6]) +
                         ras[2] * (ras[3] * ras[7] - ras[4] * ras[6]);
    double handedness = determinant < 0 ? -1 : 1;
    put_float(header, 76, handedness);
    for (size_t d = 0; d < 3; d++) put_float(header, 80 + 4 * d, spacing[d]);
    put_float(header, 108, NIFTI_HEADER);
    put_float(header, 112, 1.0); /* scl_slope */
    header[123] = 2;             /* millimetres */
    put_short(header, 252, 1);   /* qform and sform: scanner axes */
    put_short(header, 254, 1);
    double rotation[9];
    for (int n = 0; n < 9; n++) rotation[n] = n % 3 == 2 ? handedness * ras[n] : ras[n];
    quaternion_of(rotation, q);
    for (size_t n = 0; n < 3; n++) put_float(header, 256 + 4 * n, q[n + 1]);
    for (size_t n = 0; n < 3; n++) put_float(header, 268 + 4 * n, origin[n]);
    for (size_t row = 0; row < 3; row++) {
        for (size_t axis = 0; axis < 3; axis++)
            put_float(header, 280 + 16 * row + 4 * axis, ras[3 * row + axis] * spacing[axis]);
        put_float(header, 280 + 16 * row + 12, origin[row]);
    }
    memcpy(header + 344, "n+1", 4);
    return NIFTI_HEADER;
}

/* Write a text header with decimal points, independent of the process's locale. */
static size_t text_header(const image_data *image, file_format format, char *header)
{
    const pliant_geometry *g = image->geometry;
    const bool vector = image->is_vector;
    double d[9], spacing[3], origin[3]; /* [mm]; d: axis after axis */
    for (int axis = 0; axis < 3; axis++) {
        spacing[axis] = 1e3 * g->spacing[axis];
        origin[axis] = 1e3 * g->origin[axis];
        for (int row = 0; row < 3; row++)
            d[3 * axis + row] = g->direction[3 * row + axis] * (format == FORMAT_NRRD ? spacing[axis] : 1.0);
    }
    locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0), old = uselocale(c);
    int length;
    if (format == FORMAT_NRRD)
        length =
            snprintf(header, HEADER_SIZE,
                     "NRRD0004\ntype: %s\ndimension: %s\nspace: left-posterior-superior\nsizes: %s%d %d %d\n"
                     "space directions: %s(%.17g,%.17g,%.17g) (%.17g,%.17g,%.17g) (%.17g,%.17g,%.17g)\n"
                     "kinds: %sdomain domain domain\nendian: little\nencoding: raw\nspace units: \"mm\" \"mm\" \"mm\"\n"
                     "space origin: (%.17g,%.17g,%.17g)\n\n",
                     types[image->type].nrrd, vector ? "4" : "3", vector ? "3 " : "", g->size[0], g->size[1],
                     g->size[2], vector ? "none " : "", d[0], d[1], d[2], d[3], d[4], d[5], d[6], d[7], d[8],
                     vector ? "vector " : "", origin[0], origin[1], origin[2]);
    else
        length = snprintf(
            header, HEADER_SIZE,
            "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n"
            "TransformMatrix = %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g\nOffset = %.17g %.17g %.17g\n"
            "CenterOfRotation = 0 0 0\nElementSpacing = %.17g %.17g %.17g\nDimSize = %d %d %d\n%sElementType = %s\n"
            "ElementDataFile = LOCAL\n",
            d[0], d[1], d[2], d[3], d[4], d[5], d[6], d[7], d[8], origin[0], origin[1], origin[2], spacing[0],
            spacing[1], spacing[2], g->size[0], g->size[1], g->size[2], vector ? "ElementNumberOfChannels = 3\n" : "",
            types[image->type].metaimage);
    uselocale(old);
    if (c) freelocale(c);
    return (size_t)length;
}

/* --- files --- */

/* Write a file and close it. Return whether all data is in the file. */
static bool write_plain(int file, const void *header, size_t header_size, const void *data, size_t data_size)
{
    FILE *stream = fdopen(file, "wb");
    if (!stream) {
        close(file);
        return false;
    }
    bool done =
        fwrite(header, 1, header_size, stream) == header_size && fwrite(data, 1, data_size, stream) == data_size;
    return fclose(stream) == 0 && done;
}

static bool write_compressed(int file, const void *header, size_t header_size, const void *data, size_t data_size)
{
    gzFile stream = gzdopen(file, "wb5");
    if (!stream) {
        close(file);
        return false;
    }
    bool done = gzwrite(stream, header, (unsigned)header_size) == (int)header_size;
    const size_t block = (size_t)1 << 24;
    for (size_t at = 0; done && at < data_size; at += block) {
        unsigned bytes = (unsigned)(data_size - at < block ? data_size - at : block);
        done = gzwrite(stream, (const char *)data + at, bytes) == (int)bytes;
    }
    return gzclose(stream) == Z_OK && done;
}

static pliant_status write_image(const char *path, file_format format, const image_data *image)
{
    const int32_t *size = image->geometry->size;
    unsigned char header[HEADER_SIZE];
    char temporary[PATH_MAX];
    bool nifti = format == FORMAT_NIFTI || format == FORMAT_NIFTI_GZ;
    if (nifti && (size[0] > INT16_MAX || size[1] > INT16_MAX || size[2] > INT16_MAX))
        return pliant_fail(PLIANT_ERROR_FORMAT,
                           "%s: %d x %d x %d voxels: NIfTI holds at most 32767 along an axis; use .nrrd or .mha", path,
                           size[0], size[1], size[2]);
    struct stat status;
    if (stat(path, &status) == 0 && S_ISDIR(status.st_mode))
        return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be written: it is a folder", path);

    int file = pliant_open_temporary(path, temporary);
    if (file < 0)
        return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be written: no file can be created in its folder: %s", path,
                           strerror(errno));
    size_t header_size = nifti ? nifti_header(image, header) : text_header(image, format, (char *)header);
    size_t data_size = pliant_geometry_voxels(image->geometry) * types[image->type].size * (image->is_vector ? 3 : 1);
    errno = 0;
    bool written = format == FORMAT_NIFTI_GZ ? write_compressed(file, header, header_size, image->voxels, data_size)
                                             : write_plain(file, header, header_size, image->voxels, data_size);
    if (!written || rename(temporary, path) != 0) {
        int reason = errno;
        unlink(temporary);
        return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be written: %s", path,
                           reason ? strerror(reason) : "is the disk full?");
    }
    return PLIANT_OK;
}

static pliant_status check_target(const char *path, const void *voxels, file_format *format)
{
    if (!path || !*path) return pliant_fail(PLIANT_ERROR_ARGUMENT, "writing a volume: no path given");
    if (!voxels) return pliant_fail(PLIANT_ERROR_ARGUMENT, "%s: the volume to write has no voxels", path);
    *format = format_of(path);
    if (*format == FORMAT_NONE)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "%s: unknown file extension; use .nii, .nii.gz, .nrrd or .mha", path);
    return PLIANT_OK;
}

pliant_status pliant_volume_write(const char *path, const pliant_volume *volume)
{
    file_format format;
    pliant_status status = check_target(path, volume->voxels, &format);
    if (status != PLIANT_OK) return status;

    image_data image = {&volume->geometry, TYPE_FLOAT32, volume->voxels, false};
    if (volume->slope == 1.0f && volume->intercept == 0.0f) {
        if (volume->encoding == PLIANT_UINT8) image.type = TYPE_UINT8;
        if (volume->encoding == PLIANT_INT16) image.type = TYPE_INT16;
        return write_image(path, format, &image);
    }
    size_t count = pliant_geometry_voxels(&volume->geometry);
    float *values = pliant_calloc(count, sizeof *values);
    if (!values) return pliant_fail(PLIANT_ERROR_MEMORY, "%s: out of memory for its values", path);
    for (size_t n = 0; n < count; n++) values[n] = pliant_volume_value(volume, n);
    image.voxels = values;
    status = write_image(path, format, &image);
    pliant_free(values);
    return status;
}

pliant_status pliant_labels_write(const char *path, const pliant_labels *labels)
{
    file_format format;
    pliant_status status = check_target(path, labels->voxels, &format);
    if (status != PLIANT_OK) return status;
    image_data image = {&labels->geometry, TYPE_UINT16, labels->voxels, false};
    return write_image(path, format, &image);
}

pliant_status pliant_vectors_write(const char *path, const pliant_geometry *geometry, double factor,
                                   const float *vectors)
{
    file_format format;
    pliant_status status = check_target(path, vectors, &format);
    if (status != PLIANT_OK) return status;
    const size_t count = pliant_geometry_voxels(geometry);
    const bool nifti = format == FORMAT_NIFTI || format == FORMAT_NIFTI_GZ;
    const size_t voxel_step = nifti ? 1 : 3, component_step = nifti ? count : 1;
    float *values = pliant_calloc(count, 3 * sizeof *values);
    if (!values) return pliant_fail(PLIANT_ERROR_MEMORY, "%s: out of memory for its vectors", path);
    for (size_t n = 0; n < count; n++)
        for (size_t d = 0; d < 3; d++)
            values[n * voxel_step + d * component_step] = (float)(factor * (double)vectors[3 * n + d]);
    image_data image = {geometry, TYPE_FLOAT32, values, true};
    status = write_image(path, format, &image);
    pliant_free(values);
    return status;
}
