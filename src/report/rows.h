/* Rows of the report's tables while they are put together, and small things that its parts share. */
#ifndef PLIANT_REPORT_ROWS_H
#define PLIANT_REPORT_ROWS_H

#include "pliant/report.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { ROW_CELLS = 96, ROW_TEXT = 1024, ROW_ROOM = 8192 };

/* Cells one after another; the key first. A copy of a row with the key only serves many rows. */
typedef struct report_row {
    char room[ROW_ROOM];
    size_t used;
    size_t start[ROW_CELLS];
    int count;
} report_row;

void row_clear(report_row *row);
/* Line breaks become blanks; a text longer than ROW_TEXT is cut. */
void row_text(report_row *row, const char *text);
void row_number(report_row *row, double value); /* six digits; empty when it is not a number */
void row_integer(report_row *row, int64_t value);
void row_empty(report_row *row, int count);
/* Drop the cells from `count` on. */
void row_back(report_row *row, int count);
bool row_known(const report_row *row, const pliant_results *results);
/* Cells that are missing at the end stay empty. */
/* ARGUMENT when there are more cells than columns. */
pliant_status row_add(const report_row *row, pliant_results *results);

/* A row of the sweep has a key of RUN_KEYS cells, of a model MODEL_KEYS. */
enum { MODEL_KEYS = 5, RUN_KEYS = 8 };

/* The smallest of `count` sorted values that a part of them does not exceed. */
double report_quantile(const double *sorted, int32_t count, double part);
void report_sort(double *values, int32_t count);

/* Of what figures follow from: bytes, after others. */
uint64_t report_hash(uint64_t hash, const void *bytes, size_t size);

pliant_status report_write_npy(const char *path, const int32_t size[2], const float *values);

#ifdef __cplusplus
}
#endif
#endif
