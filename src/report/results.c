/* Tables of results as CSV (RFC 4180), written row by row, so that a stopped run can continue. */
#define _POSIX_C_SOURCE 200809L
#include "base/fail.h"
#include "base/memory.h"
#include "report/report.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct pliant_results {
    FILE *file;
    char *path;
    int num_columns, num_keys;
    char **columns;
    char **cells;     /* (rows x num_columns) */
    uint64_t *hashes; /* (rows) hashes of the keys */
    size_t rows, capacity;
};

static char *copy_text(const char *text)
{
    size_t size = strlen(text) + 1;
    char *copy = pliant_calloc(size, 1);
    if (copy) memcpy(copy, text, size);
    return copy;
}

static uint64_t hash_key(int num_keys, const char *const *key)
{
    uint64_t hash = 14695981039346656037u; /* FNV-1a */
    for (int c = 0; c < num_keys; c++)
        for (const char *at = key[c];; at++) {
            hash = (hash ^ (unsigned char)*at) * 1099511628211u;
            if (!*at) break;
        }
    return hash;
}

/* ---- reading */

typedef struct reader {
    FILE *file;
    char *text; /* cells of the row, each terminated by 0 */
    size_t length, capacity;
    int cells;
    bool complete; /* whether the row ended with a line break */
} reader;

static bool put(reader *r, char c)
{
    if (r->length == r->capacity) {
        size_t capacity = r->capacity ? 2 * r->capacity : 1024;
        char *larger = pliant_resize(r->text, capacity, 1);
        if (!larger) return false;
        r->text = larger;
        r->capacity = capacity;
    }
    r->text[r->length++] = c;
    return true;
}

/* Read the next row; no cells: the end. */
static pliant_status read_row(reader *r)
{
    bool quoted = false, good = true, any = false;
    int c;
    r->length = 0;
    r->cells = 0;
    r->complete = false;
    while (good && !r->complete && (c = getc(r->file)) != EOF) {
        any = true;
        if (quoted && c == '"') {
            int next = getc(r->file);
            if (next == '"') {
                good = put(r, '"');
            } else {
                quoted = false;
                ungetc(next, r->file);
            }
        } else if (quoted) {
            good = put(r, (char)c);
        } else if (c == '"') {
            quoted = true;
        } else if (c == ',' || c == '\n') {
            good = put(r, '\0');
            r->cells++;
            r->complete = c == '\n';
        } else if (c != '\r') {
            good = put(r, (char)c);
        }
    }
    if (any && !r->complete && good) {
        good = put(r, '\0');
        r->cells++;
    }
    return good ? PLIANT_OK : pliant_fail_memory("a table of results");
}

static pliant_status keep_row(pliant_results *results, const char *const *cells)
{
    size_t width = (size_t)results->num_columns;
    if (results->rows == results->capacity) {
        size_t capacity = results->capacity ? 2 * results->capacity : 64;
        char **cells_larger = pliant_resize(results->cells, capacity * width, sizeof *cells_larger);
        if (!cells_larger) return pliant_fail_memory("a table of results");
        results->cells = cells_larger;
        uint64_t *hashes_larger = pliant_resize(results->hashes, capacity, sizeof *hashes_larger);
        if (!hashes_larger) return pliant_fail_memory("a table of results");
        results->hashes = hashes_larger;
        results->capacity = capacity;
    }
    char **row = results->cells + width * results->rows;
    for (size_t c = 0; c < width; c++) {
        row[c] = copy_text(cells[c]);
        if (row[c]) continue;
        while (c-- > 0) pliant_free(row[c]);
        return pliant_fail_memory("a table of results");
    }
    results->hashes[results->rows++] = hash_key(results->num_keys, cells);
    return PLIANT_OK;
}

/* Split the reader's row into cells; false: the number of cells differs from the table's columns. */
static bool split_row(const reader *r, int width, const char **cells)
{
    if (r->cells != width) return false;
    const char *at = r->text;
    for (int c = 0; c < width; c++, at += strlen(at) + 1) cells[c] = at;
    return true;
}

/* Read the existing table. Its header must match; an incomplete last row is dropped.
 * whole: output; number of valid bytes */
static pliant_status read_table(pliant_results *results, long *whole)
{
    reader r = {.file = results->file};
    const char **cells = pliant_calloc((size_t)results->num_columns, sizeof *cells);
    pliant_status status = cells ? read_row(&r) : pliant_fail_memory("a table of results");
    if (status != PLIANT_OK) goto done;
    bool same = split_row(&r, results->num_columns, cells) && r.complete;
    for (int c = 0; same && c < results->num_columns; c++) same = strcmp(cells[c], results->columns[c]) == 0;
    if (!same && r.cells > 0) {
        status = pliant_fail(PLIANT_ERROR_FORMAT,
                             "%s has other columns than this version writes: move it away or choose another folder",
                             results->path);
        goto done;
    }
    *whole = r.cells > 0 ? ftell(results->file) : 0;
    for (;;) {
        status = read_row(&r);
        if (status != PLIANT_OK || r.cells == 0 || !r.complete || !split_row(&r, results->num_columns, cells)) break;
        status = keep_row(results, cells);
        if (status != PLIANT_OK) break;
        *whole = ftell(results->file);
    }
done:
    pliant_free(r.text);
    pliant_free(cells);
    return status;
}

/* ---- writing */

static void write_row(FILE *file, int width, const char *const *cells)
{
    for (int c = 0; c < width; c++) {
        if (c) putc(',', file);
        if (!cells[c][strcspn(cells[c], ",\"\r\n")]) {
            fputs(cells[c], file);
            continue;
        }
        putc('"', file);
        for (const char *at = cells[c]; *at; at++) {
            if (*at == '"') putc('"', file);
            putc(*at, file);
        }
        putc('"', file);
    }
    putc('\n', file);
}

static pliant_status flush(pliant_results *results)
{
    if (!results->file) return PLIANT_OK;
    bool failed = ferror(results->file) || fflush(results->file) != 0;
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "%s: %s", results->path, strerror(errno)) : PLIANT_OK;
}

static void write_rows(const pliant_results *results, FILE *file)
{
    write_row(file, results->num_columns, (const char *const *)results->columns);
    for (size_t row = 0; row < results->rows; row++)
        write_row(file, results->num_columns, (const char *const *)results->cells + row * (size_t)results->num_columns);
}

static pliant_status open_file(pliant_results *results)
{
    results->file = fopen(results->path, "r+");
    if (!results->file && errno == ENOENT) results->file = fopen(results->path, "w+");
    if (!results->file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", results->path, strerror(errno));
    long whole = 0;
    pliant_status status = read_table(results, &whole);
    if (status != PLIANT_OK) return status;
    /* Rewrite the file without the incomplete row, which may be longer than the next row. */
    fseek(results->file, 0, SEEK_END);
    if (ftell(results->file) > whole) {
        FILE *shorter = fopen(results->path, "w+");
        if (!shorter) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", results->path, strerror(errno));
        fclose(results->file);
        results->file = shorter;
        write_rows(results, results->file);
    } else if (whole == 0) {
        write_row(results->file, results->num_columns, (const char *const *)results->columns);
    }
    return flush(results);
}

pliant_status pliant_results_open(const char *path, const char *const *columns, int num_columns, int num_keys,
                                  pliant_results **out)
{
    if (num_columns < 1 || num_keys < 1 || num_keys > num_columns)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "%s: a table needs columns, and a key among them",
                           path ? path : "in memory");
    pliant_results *results = pliant_calloc(1, sizeof *results);
    if (!results) return pliant_fail_memory("a table of results");
    results->num_columns = num_columns;
    results->num_keys = num_keys;
    results->path = copy_text(path ? path : "");
    results->columns = pliant_calloc((size_t)num_columns, sizeof *results->columns);
    bool good = results->path && results->columns;
    for (int c = 0; good && c < num_columns; c++) good = (results->columns[c] = copy_text(columns[c])) != NULL;
    pliant_status status = !good ? pliant_fail_memory("a table of results") : path ? open_file(results) : PLIANT_OK;
    if (status != PLIANT_OK) {
        pliant_results_close(results);
        return status;
    }
    *out = results;
    return PLIANT_OK;
}

bool pliant_results_has(const pliant_results *results, const char *const *key)
{
    uint64_t hash = hash_key(results->num_keys, key);
    for (size_t row = 0; row < results->rows; row++) {
        if (results->hashes[row] != hash) continue;
        char *const *cells = results->cells + row * (size_t)results->num_columns;
        int same = 0;
        while (same < results->num_keys && strcmp(cells[same], key[same]) == 0) same++;
        if (same == results->num_keys) return true;
    }
    return false;
}

pliant_status pliant_results_add(pliant_results *results, const char *const *cells)
{
    pliant_status status = keep_row(results, cells);
    if (status != PLIANT_OK) return status;
    if (results->file) write_row(results->file, results->num_columns, cells);
    return flush(results);
}

pliant_status pliant_results_write(const pliant_results *results, const char *path)
{
    FILE *file = fopen(path, "w");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    write_rows(results, file);
    bool failed = ferror(file);
    failed |= fclose(file) != 0;
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "%s could not be written completely: %s", path, strerror(errno))
                  : PLIANT_OK;
}

size_t pliant_results_rows(const pliant_results *results) { return results->rows; }
int pliant_results_columns(const pliant_results *results) { return results->num_columns; }

int pliant_results_column(const pliant_results *results, const char *name)
{
    for (int c = 0; c < results->num_columns; c++)
        if (strcmp(results->columns[c], name) == 0) return c;
    return -1;
}

const char *pliant_results_cell(const pliant_results *results, size_t row, int column)
{
    return row < results->rows && column >= 0 && column < results->num_columns
               ? results->cells[row * (size_t)results->num_columns + (size_t)column]
               : "";
}

/* ---- JSON */

static void write_json_text(FILE *file, const char *text)
{
    putc('"', file);
    for (const unsigned char *at = (const unsigned char *)text; *at; at++) {
        if (*at == '"' || *at == '\\') fprintf(file, "\\%c", *at);
        else if (*at < 0x20) fprintf(file, "\\u%04x", *at);
        else putc(*at, file);
    }
    putc('"', file);
}

/* JSON permits decimal numbers only: no inf, no hexadecimal numbers, no leading zero or plus. */
static bool is_number(const char *text)
{
    const char *digit = text + (*text == '-');
    if (*digit < '0' || *digit > '9' || (digit[0] == '0' && digit[1] >= '0' && digit[1] <= '9')) return false;
    if (text[strspn(text, "0123456789.eE+-")]) return false;
    char *end;
    double value = strtod(text, &end);
    return !*end && end[-1] != '.' && isfinite(value);
}

pliant_status pliant_results_json(const pliant_results *results, const char *first, void *stream)
{
    FILE *file = stream;
    bool any = false;
    putc('[', file);
    for (size_t row = 0; row < results->rows; row++) {
        char *const *cells = results->cells + row * (size_t)results->num_columns;
        if (first && strcmp(cells[0], first) != 0) continue;
        fputs(any ? ",\n  {" : "\n  {", file);
        any = true;
        for (int c = 0; c < results->num_columns; c++) {
            if (c) fputs(", ", file);
            write_json_text(file, results->columns[c]);
            fputs(": ", file);
            if (!*cells[c]) fputs("null", file);
            else if (c > 0 && is_number(cells[c])) fputs(cells[c], file);
            else write_json_text(file, cells[c]);
        }
        putc('}', file);
    }
    fputs(any ? "\n]" : "]", file);
    return ferror(file) ? pliant_fail(PLIANT_ERROR_FILE, "the report could not be written: %s", strerror(errno))
                        : PLIANT_OK;
}

void pliant_results_close(pliant_results *results)
{
    if (!results) return;
    if (results->file) fclose(results->file);
    for (size_t c = 0; c < results->rows * (size_t)results->num_columns; c++) pliant_free(results->cells[c]);
    for (int c = 0; results->columns && c < results->num_columns; c++) pliant_free(results->columns[c]);
    pliant_free(results->cells);
    pliant_free(results->hashes);
    pliant_free(results->columns);
    pliant_free(results->path);
    pliant_free(results);
}
