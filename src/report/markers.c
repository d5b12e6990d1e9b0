/* Read measured displacements of markers from a table. */
#include "base/fail.h"
#include "base/memory.h"
#include "mesh/mesh.h"
#include "report/cells.h"
#include "report/validation.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

enum { LINE = 4096, MAX_CELLS = 8, MIN_CELLS = 7 };
static const char *const columns[MAX_CELLS] = {"load", "x", "y", "z", "moved_x", "moved_y", "moved_z", "deviation"};
/* maximum of a position, displacement or deviation; a larger value is probably in millimetres [m] */
static const double longest = 10;

/* Read one marker from the cells of a line. Return NULL, or the error. */
static const char *read_marker(int count, char *const *cells, double deviation, pliant_marker *out, char *reason,
                               size_t size)
{
    double value[MAX_CELLS] = {[MAX_CELLS - 1] = deviation};
    if (count < MIN_CELLS || count > MAX_CELLS) {
        snprintf(reason, size,
                 "it has %s%d cells; write load,x,y,z,moved_x,moved_y,moved_z and, if known, the deviation",
                 count > MAX_CELLS ? "more than " : "", count > MAX_CELLS ? MAX_CELLS : count);
        return reason;
    }
    for (int c = 0; c < count; c++) {
        if (c == MAX_CELLS - 1 && cells[c][0] == '\0') continue; /* a separator at the end of the line */
        if (!cells_number(cells[c], &value[c])) {
            snprintf(reason, size,
                     "%s is '%.40s', not a finite number; correct it, or delete the line of a lost marker", columns[c],
                     cells[c]);
            return reason;
        }
        if (c > 0 && fabs(value[c]) > longest) {
            snprintf(
                reason, size,
                "%s is %g m; lengths are in metres, and this looks like millimetres: divide x, y, z, moved_x, moved_y, "
                "moved_z and the deviation by 1000",
                columns[c], value[c]);
            return reason;
        }
    }
    if (!(value[0] >= 1 && value[0] <= 1e6) || value[0] != floor(value[0])) {
        snprintf(reason, size, "load is %g; use a whole number from 1", value[0]);
        return reason;
    }
    if (!(value[MAX_CELLS - 1] > 0)) {
        snprintf(reason, size, "deviation is %g; use a number above 0 [m]", value[MAX_CELLS - 1]);
        return reason;
    }
    *out = (pliant_marker){.load = (int32_t)value[0] - 1, .deviation = value[MAX_CELLS - 1]};
    memcpy(out->rest, value + 1, sizeof out->rest);
    memcpy(out->moved, value + 4, sizeof out->moved);
    return NULL;
}

static pliant_status add(const pliant_marker *marker, int32_t *capacity, int32_t *count, pliant_marker **markers)
{
    if (*count == *capacity) {
        pliant_marker *larger = pliant_resize(*markers, 2 * (size_t)*capacity + 16, sizeof *larger);
        if (!larger) return pliant_fail_memory("the markers");
        *markers = larger;
        *capacity = 2 * *capacity + 16;
    }
    (*markers)[(*count)++] = *marker;
    return PLIANT_OK;
}

static pliant_status read_lines(FILE *file, const char *path, double deviation, int32_t *count, pliant_marker **markers)
{
    char line[LINE], reason[256], *cells[MAX_CELLS + 1], separator = 0;
    int32_t capacity = 0, at = 0;
    pliant_status status = PLIANT_OK;
    while (status >= 0 && fgets(line, sizeof line, file)) {
        const char *text = cells_text(line);
        at++;
        if (strlen(line) + 1 == sizeof line)
            return pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: longer than %d characters", path, at, LINE - 2);
        if (text[strspn(text, " ,;\t\r\n")] == '\0' || text[0] == '#') continue;
        const bool first = separator == 0;
        if (first) separator = cells_separator(line);
        const int num_cells = cells_split(line, separator, MAX_CELLS + 1, cells);
        if (first && strncasecmp(cells[0], "load", 4) == 0) continue;
        pliant_marker one;
        if (read_marker(num_cells, cells, deviation, &one, reason, sizeof reason))
            return pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: %s", path, at, reason);
        one.line = at;
        status = add(&one, &capacity, count, markers);
    }
    return status;
}

pliant_status pliant_markers_read(const char *path, double deviation, int32_t *count, pliant_marker **out)
{
    pliant_marker *markers = NULL;
    int32_t number = 0;
    FILE *file = fopen(path, "r");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be opened: %s", path, strerror(errno));
    pliant_status status = read_lines(file, path, deviation, &number, &markers);
    if (status >= 0 && ferror(file))
        status = pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be read: %s", path, strerror(errno));
    fclose(file);
    if (status >= 0 && number == 0)
        status = pliant_fail(PLIANT_ERROR_FORMAT,
                             "%s: holds no marker; write a line load,x,y,z,moved_x,moved_y,moved_z for each [m]", path);
    if (status < 0) {
        pliant_free(markers);
        return status;
    }
    *count = number;
    *out = markers;
    return PLIANT_OK;
}

/* ---- comparison with the tissue */

/* Write "marker 3 (line 4)" to out. */
static const char *name_of(const pliant_marker *marker, int32_t index, char *out, size_t size)
{
    char line[32] = "";
    if (marker->line > 0) snprintf(line, sizeof line, " (line %d)", marker->line);
    snprintf(out, size, "marker %d%s", index + 1, line);
    return out;
}

static bool is_inside(const double low[3], const double high[3], const double *at, double unit)
{
    bool inside = true;
    for (int d = 0; d < 3; d++) inside = inside && unit * at[d] >= low[d] && unit * at[d] <= high[d];
    return inside;
}

pliant_status report_markers_check(const pliant_mesh *mesh, int32_t num_markers, const pliant_marker *markers)
{
    const double far = 10, millimetre = 1e-3;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, across = 0;
    for (int32_t n = 0; n < 3 * mesh->num_nodes; n++) {
        low[n % 3] = fmin(low[n % 3], mesh->rest[n]);
        high[n % 3] = fmax(high[n % 3], mesh->rest[n]);
    }
    for (int d = 0; d < 3; d++) across += pow(high[d] - low[d], 2);
    across = sqrt(across);
    for (int32_t m = 0; m < num_markers; m++) {
        const double *at = markers[m].rest, *moved = markers[m].moved;
        double barycentric[4];
        char name[64];
        name_of(markers + m, m, name, sizeof name);
        if (pliant_mesh_locate(mesh, at, barycentric) < 0)
            return pliant_fail(
                PLIANT_ERROR_ARGUMENT,
                "%s: there is no tissue at (%.4f %.4f %.4f) m; at rest it lies between (%.4f %.4f %.4f) and "
                "(%.4f %.4f %.4f) m%s",
                name, at[0], at[1], at[2], low[0], low[1], low[2], high[0], high[1], high[2],
                is_inside(low, high, at, 1) || !is_inside(low, high, at, millimetre)
                    ? ""
                    : ": the point seems to be in millimetres; divide all lengths by 1000");
        const double length = sqrt(moved[0] * moved[0] + moved[1] * moved[1] + moved[2] * moved[2]);
        if (length > far * across)
            return pliant_fail(
                PLIANT_ERROR_ARGUMENT,
                "%s: it moved by %g m, and the tissue is %g m across: moved_x, moved_y and moved_z seem to be in "
                "millimetres; divide them by 1000",
                name, length, across);
    }
    return PLIANT_OK;
}

/* Return whether displacements are probably positions, because displacements are much shorter. */
static bool look_like_positions(int32_t num_markers, const pliant_marker *markers)
{
    double as_displacements = 0, as_positions = 0;
    for (int32_t m = 0; m < num_markers; m++)
        for (int d = 0; d < 3; d++) {
            as_displacements += pow(markers[m].moved[d], 2);
            as_positions += pow(markers[m].moved[d] - markers[m].rest[d] - markers[m].offset[d], 2);
        }
    return as_positions < 0.25 * as_displacements;
}

void report_markers_warn(int32_t num_markers, const pliant_marker *markers, const pliant_moduli *found)
{
    const double maximum = 9;
    if (!(found->misfit > maximum)) return;
    pliant_log(PLIANT_LOG_WARNING,
               "the fit leaves markers %.3g mm off (root mean square), %.3g times their deviation: "
               "do not trust these moduli%s",
               1e3 * found->rms, sqrt(found->misfit),
               look_like_positions(num_markers, markers)
                   ? "; moved_x, moved_y and moved_z look like positions: give displacements, "
                     "which are the deformed minus the rest position"
                   : "; check the markers (displacements in metres, LPS), the loads and what is fixed, "
                     "or give the deviation that the measurement has");
}
