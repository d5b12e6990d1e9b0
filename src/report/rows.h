/* Build rows of the report's tables; small shared functions. */
#ifndef PLIANT_REPORT_ROWS_H
#define PLIANT_REPORT_ROWS_H

#include "pliant/report.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { ROW_CELLS = 96, ROW_TEXT = 1024, ROW_CAPACITY = 8192 };

/* A row under construction, key cells first. Copies of a row that contains only the key serve for many rows. */
typedef struct report_row {
    char text[ROW_CAPACITY];
    size_t used;
    size_t start[ROW_CELLS];
    int count;
} report_row;

void row_clear(report_row *row);
/* Append text. Line breaks become blanks; text longer than ROW_TEXT is truncated. */
void row_text(report_row *row, const char *text);
void row_number(report_row *row, double value); /* six digits; empty if it is not finite */
void row_integer(report_row *row, int64_t value);
void row_empty(report_row *row, int count);
/* Remove the cells from `count` on. */
void row_truncate(report_row *row, int count);
bool row_is_stored(const report_row *row, const pliant_results *results);
/* Append the row to a table. Missing cells at the end stay empty. */
/* Errors: ARGUMENT if there are more cells than columns. */
pliant_status row_add(const report_row *row, pliant_results *results);

/* A row of the sweep has a key of RUN_KEYS cells, a row of a model MODEL_KEYS. */
enum { MODEL_KEYS = 5, RUN_KEYS = 8 };

/* Return the quantile of sorted values: the minimum value that is not exceeded by the fraction `part` of them. */
double report_quantile(const double *sorted, int32_t count, double part);
void report_sort(double *values, int32_t count);

/* Continue a hash of the inputs that determine a result. */
uint64_t report_hash(uint64_t hash, const void *bytes, size_t size);

pliant_status report_write_npy(const char *path, const int32_t size[2], const float *values);

#ifdef __cplusplus
}
#endif
#endif
