/* Read measured bodies from the files in a folder. */
#define _POSIX_C_SOURCE 200809L
#include "report/validation.h"

#include "base/fail.h"
#include "base/memory.h"
#include "pliant/pliant.h"
#include "report/cells.h"
#include "report/rows.h"

#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

enum { MAX_CELLS = 3 * (MAX_STATES + 2), LINE = 8192 };

void measured_body_free(measured_body *body)
{
    for (int32_t s = 0; s < body->num_states; s++) pliant_path_free(&body->load[s]);
    pliant_volume_free(&body->scan);
    pliant_labels_free(&body->labels);
    pliant_material_table_free(&body->materials);
    pliant_free(body->markers);
    *body = (measured_body){.num_states = 0};
}

/* ---- a silicone block with a plate on it */

typedef struct silicone {
    double box[3], young, poisson, density;
    int cells[3], plate; /* number of cells along each axis; the last `plate` layers along z are stiff */
} silicone;

static void name_material(pliant_material *material, int index, const char *name, double young, double poisson,
                          double density)
{
    memset(material, 0, sizeof *material);
    snprintf(material->name, sizeof material->name, "%s", name);
    material->young_modulus = young;
    material->poisson_ratio = poisson;
    material->density = density;
    material->toughness = PLIANT_DEFAULT_TOUGHNESS;
    material->num_range = 2;
    material->range[0] = index - 0.5;
    material->range[1] = index + 0.5;
}

/* Create the body with two voxels per cell along each axis. */
static pliant_status make_silicone(const silicone *what, measured_body *out)
{
    const double stiffer = 1e4;
    pliant_geometry geometry = {.size = {0}};
    for (int d = 0; d < 3; d++) {
        geometry.size[d] = 2 * what->cells[d];
        geometry.spacing[d] = what->box[d] / geometry.size[d];
        geometry.origin[d] = 0.5 * geometry.spacing[d];
        geometry.direction[4 * d] = 1;
    }
    pliant_scene_defaults(&out->scene);
    for (int d = 0; d < 3; d++) out->scene.mesh.coarse_cells[d] = what->cells[d];
    out->scene.mesh.ratio = 1;
    out->scene.model.method = PLIANT_FINE;
    out->scene.element.kind = PLIANT_HEXAHEDRA; /* tetrahedra of this size would require a modulus one third too low */
    out->scene.solver.backend = PLIANT_CPU;
    pliant_status status = pliant_volume_create(&geometry, PLIANT_UINT8, &out->scan);
    if (status < 0) return status;
    out->scan.slope = 1;
    uint8_t *voxel = out->scan.voxels;
    const size_t layer = (size_t)geometry.size[0] * (size_t)geometry.size[1];
    for (int k = 0; k < geometry.size[2]; k++)
        memset(voxel + layer * (size_t)k, k >= geometry.size[2] - 2 * what->plate, layer);
    out->materials.materials = pliant_calloc(2, sizeof *out->materials.materials);
    if (!out->materials.materials) return pliant_fail_memory("the materials");
    out->materials.num_materials = what->plate ? 2 : 1;
    name_material(out->materials.materials, 0, "silicone", what->young, what->poisson, what->density);
    if (what->plate) name_material(out->materials.materials + 1, 1, "plate", stiffer * what->young, 0.3, what->density);
    return PLIANT_OK;
}

static pliant_status add_marker(measured_body *body, int32_t *capacity, const pliant_marker *marker)
{
    if (body->num_markers == *capacity) {
        pliant_marker *larger = pliant_resize(body->markers, 2 * (size_t)*capacity + 64, sizeof *larger);
        if (!larger) return pliant_fail_memory("the markers");
        body->markers = larger;
        *capacity = 2 * *capacity + 64;
    }
    body->markers[body->num_markers++] = *marker;
    return PLIANT_OK;
}

/* Return whether a text contains a word, ignoring case. */
static bool has(const char *text, const char *word)
{
    for (const size_t length = strlen(word); *text; text++)
        if (strncasecmp(text, word, length) == 0) return true;
    return false;
}

/* ---- a beam released under its own weight */

static const double beam_size[3] = {0.1, 0.03, 0.03}; /* the frame's x is -0.1 at the clamp and 0 at the tip */

typedef struct beam_line {
    char recording[48], marker[32];
    bool end;
    int line;
    double at[3]; /* relative to the corner of the block [m] */
} beam_line;

enum { RECORDING, MARKER, STATE, PLACE, WANTED = PLACE + 3 }; /* columns */

/* Find the columns by their names. -1: there is no recording. Errors: FORMAT: another column is missing. */
static pliant_status find_columns(const char *path, int line, int num_cells, char *const *cells, int column[WANTED])
{
    static const char *const wanted[WANTED] = {"recording", "marker", "state", "beam_x", "beam_y", "beam_z"};
    pliant_status status = PLIANT_OK;
    for (int w = 0; w < WANTED; w++) {
        column[w] = -1;
        for (int c = 0; c < num_cells; c++)
            if (strcmp(cells[c], wanted[w]) == 0) column[w] = c;
        if (column[w] < 0 && w != RECORDING)
            status = pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: there is no column %s", path, line, wanted[w]);
    }
    return status;
}

/* Read the lines of markers on the silicone. Errors: FORMAT: a column is missing or not a number. */
static pliant_status read_beam_lines(const char *path, int32_t *count, beam_line **out)
{
    int column[WANTED], at = 0;
    char line[LINE], *cells[MAX_CELLS], separator = ',';
    int32_t capacity = 0;
    pliant_status status = PLIANT_OK;
    FILE *file = fopen(path, "r");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    *count = 0;
    *out = NULL;
    for (bool header = true; status >= 0 && fgets(line, sizeof line, file);) {
        beam_line one = {.end = false};
        at++;
        const char *text = cells_text(line);
        if (text[0] == '#' || text[strspn(text, " ,;\t\r\n")] == '\0') continue;
        if (header) separator = cells_separator(line);
        const int num_cells = cells_split(line, separator, MAX_CELLS, cells);
        if (header) {
            status = find_columns(path, at, num_cells, cells, column);
            header = false;
            continue;
        }
        bool good = true;
        for (int w = 0; w < WANTED; w++) good = good && column[w] < num_cells;
        for (int d = 0; good && d < 3; d++) good = cells_number(cells[column[PLACE + d]], &one.at[d]);
        if (!good) {
            status = pliant_fail(PLIANT_ERROR_FORMAT,
                                 "%s: line %d: expected a recording, a marker, a state and three coordinates in metres",
                                 path, at);
            break;
        }
        if (strncmp(cells[column[MARKER]], "Base", 4) == 0) continue; /* on the clamp */
        if (strcmp(cells[column[STATE]], "rest") != 0 && strcmp(cells[column[STATE]], "end") != 0) {
            pliant_log(PLIANT_LOG_WARNING, "%s: line %d: state %s is ignored: the load is known only for rest and end",
                       path, at, cells[column[STATE]]);
            continue;
        }
        snprintf(one.recording, sizeof one.recording, "%s",
                 column[RECORDING] < 0 ? "recording" : cells[column[RECORDING]]);
        snprintf(one.marker, sizeof one.marker, "%s", cells[column[MARKER]]);
        one.end = strcmp(cells[column[STATE]], "end") == 0;
        one.at[0] += beam_size[0];
        one.line = at;
        if (*count == capacity) {
            beam_line *larger = pliant_resize(*out, 2 * (size_t)capacity + 64, sizeof *larger);
            if (!larger) {
                status = pliant_fail_memory("the markers");
                break;
            }
            *out = larger;
            capacity = 2 * capacity + 64;
        }
        (*out)[(*count)++] = one;
    }
    fclose(file);
    return status;
}

static int32_t state_of(measured_body *body, const char *name)
{
    for (int32_t s = 0; s < body->num_states; s++)
        if (strncmp(body->state[s], name, sizeof body->state[s] - 1) == 0) return s;
    if (body->num_states == MAX_STATES) return -1;
    snprintf(body->state[body->num_states], sizeof body->state[0], "%s", name);
    return body->num_states++;
}

static pliant_status read_beam(const char *path, measured_body *out)
{
    const silicone dragon_skin = {{beam_size[0], beam_size[1], beam_size[2]}, 150e3, 0.499, 1070, {20, 6, 6}, 0};
    int32_t count = 0, capacity = 0;
    beam_line *lines = NULL;
    snprintf(out->name, sizeof out->name, "silicone beam");
    pliant_status status = make_silicone(&dragon_skin, out);
    if (status >= 0) status = read_beam_lines(path, &count, &lines);
    out->scene.fixed.planes[out->scene.fixed.num_planes++] = (pliant_fixed_plane){{1e-6, 0, 0}, {1, 0, 0}};
    out->scene.model.gravity[2] = -9.807;
    out->recordings = true;
    for (int32_t e = 0; status >= 0 && e < count; e++) {
        const beam_line *end = lines + e, *rest = NULL;
        for (int32_t r = 0; end->end && r < count; r++)
            if (!lines[r].end && strcmp(lines[r].recording, end->recording) == 0 &&
                strcmp(lines[r].marker, end->marker) == 0)
                rest = lines + r;
        if (!rest) continue;
        pliant_marker marker = {.load = state_of(out, end->recording),
                                .deviation = 1e-3 /* the tip was held before, to within that */};
        if (marker.load < 0) {
            status = pliant_fail(PLIANT_ERROR_FORMAT, "%s: more than %d recordings", path, MAX_STATES);
            break;
        }
        for (int d = 0; d < 3; d++) {
            marker.rest[d] = fmin(fmax(rest->at[d], 0), beam_size[d]); /* the point below the ball */
            marker.offset[d] = rest->at[d] - marker.rest[d];
            marker.moved[d] = end->at[d] - rest->at[d];
            if (status >= 0 && fmax(fabs(marker.offset[d]), fabs(marker.moved[d])) > beam_size[0])
                status = pliant_fail(
                    PLIANT_ERROR_FORMAT,
                    "%s: line %d: marker %s is farther from the beam than its length; use metres in the frame of the "
                    "beam, with the clamp at x -0.1 and the tip at 0",
                    path, fabs(marker.offset[d]) > beam_size[0] ? rest->line : end->line, end->marker);
        }
        if (status >= 0) status = add_marker(out, &capacity, &marker);
    }
    pliant_free(lines);
    if (status >= 0 && out->num_markers == 0)
        status = pliant_fail(PLIANT_ERROR_FORMAT, "%s: no marker on the silicone has both states, rest and end", path);
    return status;
}

/* ---- a cube between plates */

/* Lower a plate by `shortened` within a second. It is held at many points, so it stays flat. */
static pliant_status press(double edge, double plate, double shortened, pliant_path *out)
{
    enum { ACROSS = 2 };
    out->tools = pliant_calloc(ACROSS * ACROSS, sizeof *out->tools);
    if (!out->tools) return pliant_fail_memory("the load");
    for (int n = 0; n < ACROSS * ACROSS; n++) {
        pliant_path_tool *tool = out->tools + out->num_tools++;
        snprintf(tool->name, sizeof tool->name, "plate %d", n + 1);
        tool->drive = PLIANT_DRIVE_RIGID;
        tool->grasp[0] = (n % ACROSS + 0.5) / ACROSS * edge;
        tool->grasp[1] = (n / ACROSS + 0.5) / ACROSS * edge;
        tool->grasp[2] = edge + 0.5 * plate;
        tool->motion = pliant_calloc(2, sizeof *tool->motion);
        if (!tool->motion) return pliant_fail_memory("the load");
        tool->num_motion = 2;
        tool->motion[1] = (pliant_path_key){1, {0, 0, -shortened}};
    }
    return PLIANT_OK;
}

/* Find the columns in the header: 'no strain' (-1: missing), and 'N% strain' where each compression begins. */
static int cube_columns(int count, char *const cells[], double strain[MAX_STATES], int column[MAX_STATES], int *rest)
{
    int states = 0;
    *rest = -1;
    for (int c = 0; c < count; c++) {
        char *end;
        const double percent = strtod(cells[c], &end);
        if (has(cells[c], "no strain") || (end != cells[c] && percent == 0 && has(end, "strain"))) *rest = c;
        else if (end != cells[c] && strchr(end, '%') && has(end, "strain") && percent > 0 && percent < 90 &&
                 states < MAX_STATES) {
            strain[states] = 0.01 * percent;
            column[states++] = c;
        }
    }
    return states;
}

static bool three_numbers(int count, char *const cells[], int first, double out[3])
{
    bool good = first >= 0 && first + 3 <= count;
    for (int d = 0; good && d < 3; d++) good = cells_number(cells[first + d], &out[d]);
    return good;
}

/* Read a bead from each line with a rest position; it counts in the states in which it was found. */
static pliant_status read_beads(FILE *file, const char *path, double edge, measured_body *out,
                                double strain[MAX_STATES], double centre[3])
{
    enum { MIN_BEADS = 4 /* their rigid motion alone has six unknowns */ };
    double low[3], high[3], span = 0;
    char line[LINE], *cells[MAX_CELLS], separator = ',';
    int column[MAX_STATES], rest = -1, beads[MAX_STATES] = {0}, lines = 0;
    int32_t capacity = 0;
    for (int d = 0; d < 3; d++) centre[d] = 0, low[d] = INFINITY, high[d] = -INFINITY;
    while (fgets(line, sizeof line, file)) {
        if (out->num_states == 0) separator = cells_separator(line);
        const int count = cells_split(line, separator, MAX_CELLS, cells);
        pliant_marker bead = {.deviation = 5e-4};
        double at[3], moved[3];
        if (out->num_states == 0) {
            out->num_states = cube_columns(count, cells, strain, column, &rest);
            if (rest < 0) out->num_states = 0;
            continue;
        }
        if (!three_numbers(count, cells, rest, at)) continue;
        lines++;
        for (int d = 0; d < 3; d++) {
            centre[d] += bead.rest[d] = 1e-3 * at[d];
            low[d] = fmin(low[d], bead.rest[d]);
            high[d] = fmax(high[d], bead.rest[d]);
        }
        for (int s = 0; s < out->num_states; s++) {
            if (!three_numbers(count, cells, column[s], moved)) continue;
            bead.load = s;
            for (int d = 0; d < 3; d++) bead.moved[d] = 1e-3 * (moved[d] - at[d]);
            pliant_status status = add_marker(out, &capacity, &bead);
            if (status < 0) return status;
            beads[s]++;
        }
    }
    if (out->num_states == 0)
        return pliant_fail(
            PLIANT_ERROR_FORMAT,
            "%s: no line names the states, as in ',,,no strain,,,5%% strain,,,12.5%% strain,,' above their coordinates "
            "in mm",
            path);
    for (int s = 0; s < out->num_states; s++)
        if (beads[s] < MIN_BEADS)
            return pliant_fail(
                PLIANT_ERROR_FORMAT,
                "%s: %d beads at %g %% are too few; give lines with three coordinates in mm below 'no strain' and "
                "below each state",
                path, beads[s], 100 * strain[s]);
    for (int d = 0; d < 3; d++) {
        centre[d] /= lines;
        span = fmax(span, high[d] - low[d]);
    }
    if (span > edge || span < 0.05 * edge)
        return pliant_fail(PLIANT_ERROR_FORMAT,
                           "%s: at rest, beads are up to %g mm apart; give coordinates in mm in a cube of %g mm", path,
                           1e3 * span, 1e3 * edge);
    return PLIANT_OK;
}

static pliant_status read_cube(const char *path, measured_body *out)
{
    enum { CELLS = 12 };
    const double edge = 0.08, plate = edge / CELLS;
    const silicone cube = {{edge, edge, edge + plate}, 15.3e3, 0.499, 980, {CELLS, CELLS, CELLS + 1}, 1};
    double centre[3], strain[MAX_STATES];
    snprintf(out->name, sizeof out->name, "Truth Cube");
    pliant_status status = make_silicone(&cube, out);
    out->scene.fixed.planes[out->scene.fixed.num_planes++] = (pliant_fixed_plane){{0, 0, 1e-6}, {0, 0, 1}};
    out->fits_poisson = out->free_motion = out->loaded = true;
    out->scene.solver.kind = PLIANT_TLED; /* a material law for large strains */
    out->scene.tled.quasi_static = true;
    if (status < 0) return status;
    FILE *file = fopen(path, "r");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    status = read_beads(file, path, edge, out, strain, centre);
    fclose(file);
    for (int s = 0; status >= 0 && s < out->num_states; s++) {
        snprintf(out->state[s], sizeof out->state[s], "%g %%", 100 * strain[s]);
        status = press(edge, plate, strain[s] * edge, &out->load[s]);
    }
    for (int32_t m = 0; status >= 0 && m < out->num_markers; m++)
        for (int d = 0; d < 3; d++) out->markers[m].rest[d] += 0.5 * edge - centre[d];
    return status;
}

/* ---- the user's scene */

/* Add a file's bytes to the hash of the measurement. */
static pliant_status hash_file(const char *path, uint64_t *hash)
{
    char bytes[4096];
    FILE *file = fopen(path, "rb");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    for (size_t got; (got = fread(bytes, 1, sizeof bytes, file)) > 0;) *hash = report_hash(*hash, bytes, got);
    fclose(file);
    return PLIANT_OK;
}

static const char *last_name(const char *path)
{
    return strrchr(path, '/') && strrchr(path, '/')[1] ? strrchr(path, '/') + 1 : path;
}

static pliant_status read_scene_folder(const char *folder, const char *scan, measured_body *out)
{
    char path[4096 + 32];
    snprintf(out->name, sizeof out->name, "%.63s", last_name(folder));
    snprintf(path, sizeof path, "%s/scene.yaml", folder);
    pliant_status status = pliant_scene_read(path, &out->scene);
    if (status >= 0) status = pliant_inputs_read(&out->scene, scan, &out->scan, &out->labels, &out->materials);
    snprintf(path, sizeof path, "%s/markers.csv", folder);
    if (status >= 0) status = pliant_markers_read(path, 5e-4, &out->num_markers, &out->markers);
    if (status >= 0) status = hash_file(path, &out->bytes);
    for (int32_t m = 0; status >= 0 && m < out->num_markers; m++) {
        if (out->markers[m].load < 0 || out->markers[m].load >= MAX_STATES)
            return pliant_fail(PLIANT_ERROR_FORMAT, "%s: marker %d: load is %d; use 1 to %d", path, m + 1,
                               out->markers[m].load + 1, MAX_STATES);
        while (out->num_states <= out->markers[m].load) {
            snprintf(out->state[out->num_states], sizeof out->state[0], "load %d", out->num_states + 1);
            out->num_states++;
        }
    }
    for (int32_t s = 0; status >= 0 && s < out->num_states; s++) {
        snprintf(path, sizeof path, "%s/load_%d.yaml", folder, s + 1);
        if (s == 0) out->loaded = access(path, F_OK) == 0;
        if (out->loaded) status = pliant_path_read(path, &out->load[s]);
        if (status >= 0 && out->loaded) status = hash_file(path, &out->bytes);
    }
    return status;
}

/* ---- finding measurements */

/* Return whether a file is the table of the beam or the cube, by its name or by its first lines. */
static bool is_table(const char *name, const char *path, measured_source *out)
{
    const size_t length = strlen(name);
    char line[LINE], *cells[MAX_CELLS];
    double strain[MAX_STATES];
    int column[MAX_STATES], rest;
    bool found = false;
    if (length < 4 || strcasecmp(name + length - 4, ".csv") != 0 || strcmp(name, "markers.csv") == 0) return false;
    out->kind = strncmp(name, "truthcube", 9) == 0 ? MEASURED_CUBE : MEASURED_BEAM;
    if (out->kind == MEASURED_CUBE || strcmp(name, "gravity_markers.csv") == 0) return true;
    FILE *file = fopen(path, "r");
    for (int n = 0; file && !found && n < 50 && fgets(line, sizeof line, file); n++) {
        if (cells_text(line)[0] == '#') continue;
        if (strstr(line, "beam_x")) out->kind = MEASURED_BEAM, found = true;
        else if (cube_columns(cells_split(line, cells_separator(line), MAX_CELLS, cells), cells, strain, column,
                              &rest) > 0 &&
                 rest >= 0)
            out->kind = MEASURED_CUBE, found = true;
    }
    if (file) fclose(file);
    return found;
}

/* deeper: also search subfolders, skipping unreadable ones */
static pliant_status find_tables_in(const char *folder, bool deeper, int32_t *count, measured_source **out)
{
    const int32_t before = *count;
    measured_source scene = {.kind = MEASURED_SCENE}, one = {.kind = MEASURED_BEAM};
    bool has_scene = false;
    pliant_status status = PLIANT_OK;
    DIR *opened = opendir(folder);
    if (!opened && !deeper) pliant_log(PLIANT_LOG_WARNING, "%s: %s: the folder is skipped", folder, strerror(errno));
    if (!opened) return deeper ? pliant_fail(PLIANT_ERROR_FILE, "%s: %s", folder, strerror(errno)) : PLIANT_OK;
    snprintf(scene.path, sizeof scene.path, "%s", folder);
    for (struct dirent *entry; status >= 0;) {
        entry = readdir(opened);
        snprintf(one.path, sizeof one.path, "%s/%s", folder, entry ? entry->d_name : "");
        if (entry && strcmp(entry->d_name, "scene.yaml") == 0) has_scene = true;
        if (entry && strncmp(entry->d_name, "scan.", 5) == 0 && (!*scene.scan || strcmp(one.path, scene.scan) < 0))
            memcpy(scene.scan, one.path, sizeof one.path);
        const bool ends = !entry, is_scene = ends && has_scene && *scene.scan;
        if (is_scene || (entry && is_table(entry->d_name, one.path, &one))) {
            measured_source *larger = pliant_resize(*out, (size_t)*count + 1, sizeof *larger);
            if (!larger) status = pliant_fail_memory("the measured bodies");
            else (*out = larger)[(*count)++] = is_scene ? scene : one;
        }
        if (ends) break;
    }
    rewinddir(opened);
    for (struct dirent *entry; status >= 0 && deeper && *count == before && (entry = readdir(opened));) {
        struct stat what;
        snprintf(one.path, sizeof one.path, "%s/%s", folder, entry->d_name);
        if (entry->d_name[0] != '.' && stat(one.path, &what) == 0 && S_ISDIR(what.st_mode))
            status = find_tables_in(one.path, false, count, out);
    }
    closedir(opened);
    return status;
}

static int by_path(const void *a, const void *b)
{
    return strcmp(((const measured_source *)a)->path, ((const measured_source *)b)->path);
}

pliant_status measured_bodies_find(const char *folder, int32_t *count, measured_source **out)
{
    *count = 0;
    *out = NULL;
    pliant_status status = find_tables_in(folder, true, count, out);
    if (status >= 0 && *count == 0)
        status = pliant_fail(
            PLIANT_ERROR_FILE,
            "%s: no measurements found; expected gravity_markers.csv (beam), truthcube*.csv (cube), or scene.yaml with "
            "scan.* and markers.csv; pliant/report.h describes them",
            folder);
    if (status >= 0) {
        qsort(*out, (size_t)*count, sizeof **out, by_path);
        return PLIANT_OK;
    }
    pliant_free(*out);
    *out = NULL;
    *count = 0;
    return status;
}

pliant_status measured_body_read(const measured_source *source, measured_body *out)
{
    measured_body body = {.num_states = 0};
    const char *name = last_name(source->path);
    const bool usual = strcmp(name, "gravity_markers.csv") == 0 || strncmp(name, "truthcube", 9) == 0;
    pliant_status status = source->kind == MEASURED_BEAM   ? read_beam(source->path, &body)
                           : source->kind == MEASURED_CUBE ? read_cube(source->path, &body)
                                                           : read_scene_folder(source->path, source->scan, &body);
    if (status >= 0 && source->kind != MEASURED_SCENE) status = hash_file(source->path, &body.bytes);
    if (status < 0) {
        measured_body_free(&body);
        return status;
    }
    if (source->kind != MEASURED_SCENE && !usual) { /* distinguish it from others of its kind */
        const size_t used = strlen(body.name);
        snprintf(body.name + used, sizeof body.name - used, ", %.*s", (int)(strlen(name) - 4), name);
    }
    *out = body;
    return PLIANT_OK;
}
