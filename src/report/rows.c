#include "report/rows.h"

#include "base/fail.h"
#include "report/report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void row_clear(report_row *row) { row->used = 0, row->count = 0; }

void row_text(report_row *row, const char *text)
{
    if (row->count == ROW_CELLS || row->used == ROW_CAPACITY) return;
    size_t length = strlen(text), capacity = ROW_CAPACITY - row->used - 1;
    if (length > ROW_TEXT) length = ROW_TEXT;
    if (length > capacity) length = capacity;
    row->start[row->count++] = row->used;
    for (size_t c = 0; c < length; c++) row->text[row->used++] = text[c] == '\n' || text[c] == '\r' ? ' ' : text[c];
    row->text[row->used++] = '\0';
}

void row_number(report_row *row, double value)
{
    char text[32] = "";
    if (isfinite(value)) snprintf(text, sizeof text, "%.6g", value);
    row_text(row, text);
}

void row_integer(report_row *row, int64_t value)
{
    char text[32];
    snprintf(text, sizeof text, "%lld", (long long)value);
    row_text(row, text);
}

void row_empty(report_row *row, int count)
{
    while (count-- > 0) row_text(row, "");
}

void row_truncate(report_row *row, int count)
{
    if (count >= row->count) return;
    row->used = row->start[count];
    row->count = count;
}

static void list_cells(const report_row *row, const char *cells[ROW_CELLS])
{
    for (int c = 0; c < ROW_CELLS; c++) cells[c] = c < row->count ? row->text + row->start[c] : "";
}

bool row_is_stored(const report_row *row, const pliant_results *results)
{
    const char *cells[ROW_CELLS];
    list_cells(row, cells);
    return pliant_results_has(results, cells);
}

pliant_status row_add(const report_row *row, pliant_results *results)
{
    const char *cells[ROW_CELLS];
    if (row->count > pliant_results_columns(results))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "a row of %d cells for a table of %d columns", row->count,
                           pliant_results_columns(results));
    list_cells(row, cells);
    return pliant_results_add(results, cells);
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

void report_sort(double *values, int32_t count) { qsort(values, (size_t)count, sizeof *values, compare); }

double report_quantile(const double *sorted, int32_t count, double part)
{
    if (count < 1) return NAN;
    int32_t at = (int32_t)ceil(part * count) - 1;
    return sorted[at < 0 ? 0 : at];
}
