/* Pattern and values of the stiffness matrix. */
#include "base/fail.h"
#include "fem/system.h"
#include "base/memory.h"

#include <string.h>

typedef struct pair {
    int32_t row, column, term;
} pair;

/* List every (row, column) of the lower triangle with an element's contribution. */
static int32_t list_pairs(const pliant_system *system, pair *pairs)
{
    const pliant_mesh *mesh = system->mesh;
    int32_t count = 0;
    for (int32_t t = 0; t < mesh->num_tets; t++)
        for (int a = 0; a < 4; a++)
            for (int b = 0; b <= a; b++) {
                int32_t row = system->free_of_node[mesh->tets[4 * t + a]],
                        column = system->free_of_node[mesh->tets[4 * t + b]];
                if (row < 0 || column < 0) continue;
                pairs[count++] =
                    row >= column ? (pair){row, column, 16 * t + 4 * a + b} : (pair){column, row, 16 * t + 4 * b + a};
            }
    return count;
}

/* Sort stably by row or column (counting sort). */
static void sort_pairs(const pair *in, pair *out, int32_t count, bool by_column, int32_t *start, int32_t num_keys)
{
    memset(start, 0, ((size_t)num_keys + 1) * sizeof *start);
    for (int32_t p = 0; p < count; p++) start[(by_column ? in[p].column : in[p].row) + 1]++;
    for (int32_t k = 0; k < num_keys; k++) start[k + 1] += start[k];
    for (int32_t p = 0; p < count; p++) out[start[by_column ? in[p].column : in[p].row]++] = in[p];
}

static void pattern_free(pliant_pattern *pattern)
{
    pliant_free(pattern->start);
    pliant_free(pattern->row);
    pliant_free(pattern->term_start);
    pliant_free(pattern->term);
}

static pliant_status fill_pattern(pliant_pattern *pattern, const pair *pairs, int32_t count)
{
    pattern->start = pliant_calloc((size_t)pattern->num_columns + 1, sizeof *pattern->start);
    pattern->row = pliant_calloc((size_t)count, sizeof *pattern->row);
    pattern->term_start = pliant_calloc((size_t)count + 1, sizeof *pattern->term_start);
    pattern->term = pliant_calloc((size_t)count, sizeof *pattern->term);
    if (!pattern->start || !pattern->row || !pattern->term_start || !pattern->term)
        return pliant_fail_memory("the pattern of the matrix");
    int32_t blocks = 0;
    for (int32_t p = 0; p < count; p++) {
        bool begins = p == 0 || pairs[p].row != pairs[p - 1].row || pairs[p].column != pairs[p - 1].column;
        if (begins) {
            pattern->row[blocks] = pairs[p].row;
            pattern->term_start[blocks++] = p;
            pattern->start[pairs[p].column + 1] = blocks;
        }
        pattern->term[p] = pairs[p].term;
    }
    pattern->term_start[blocks] = count;
    pattern->num_blocks = blocks;
    /* A diagonal block has 6 numbers in the lower triangle, any other block has 9. */
    pattern->num_values = 9 * (int64_t)blocks - 3 * (int64_t)pattern->num_columns;
    return PLIANT_OK;
}

pliant_status pliant_system_unknowns(pliant_system *system, const uint8_t *fixed)
{
    pliant_status status = pliant_system_number_unknowns(system, fixed);
    return status == PLIANT_OK ? pliant_system_find_pattern(system) : status;
}

pliant_status pliant_system_find_pattern(pliant_system *system)
{
    if (system->pattern.start) return PLIANT_OK;
    if (system->macros) return pliant_macro_find_pattern(system);
    pliant_status status = PLIANT_OK;
    size_t maximum = 10 * (size_t)system->mesh->num_tets;
    if (maximum > INT32_MAX / 16)
        return pliant_fail(PLIANT_ERROR_SCENE, "%d tetrahedra are too many for the matrix", system->mesh->num_tets);
    pair *pairs = pliant_calloc(maximum, sizeof *pairs), *sorted = pliant_calloc(maximum, sizeof *sorted);
    int32_t *start = pliant_calloc((size_t)system->num_free + 1, sizeof *start);
    if (!pairs || !sorted || !start) {
        status = pliant_fail_memory("the pattern of the matrix");
    } else {
        int32_t count = list_pairs(system, pairs);
        sort_pairs(pairs, sorted, count, false, start, system->num_free);
        sort_pairs(sorted, pairs, count, true, start, system->num_free);
        pliant_pattern pattern = {.num_columns = system->num_free};
        status = fill_pattern(&pattern, pairs, count);
        if (status == PLIANT_OK) system->pattern = pattern;
        else pattern_free(&pattern);
    }
    pliant_free(pairs);
    pliant_free(sorted);
    pliant_free(start);
    return status;
}

/* Add the contribution of one element to one block. For isotropic elements it is R K_ab R' with the rotated gradients h
 * = R g. The twist contributes 1/2 [h_a]x' D [h_b]x: a displacement du_b rotates the element by h_b x du_b / 2, against
 * D (elements.c). */
static void add_term(const pliant_system *system, const pliant_tangent *tangents, int32_t element, int a, int b,
                     double block[9])
{
    const pliant_tangent *tangent = tangents + element / LANES;
    int32_t lane = element % LANES;
    double r[9];
    for (int m = 0; m < 9; m++) r[m] = tangent->rotation[m][lane];
    if (!system->stiffness) {
        double (*g)[LANES] = system->gradients[element / LANES], h[3], k[3], d[6];
        double lambda = system->lame[element / LANES][0][lane], mu = system->lame[element / LANES][1][lane];
        for (int i = 0; i < 3; i++) {
            h[i] = r[3 * i] * g[3 * a][lane] + r[3 * i + 1] * g[3 * a + 1][lane] + r[3 * i + 2] * g[3 * a + 2][lane];
            k[i] = r[3 * i] * g[3 * b][lane] + r[3 * i + 1] * g[3 * b + 1][lane] + r[3 * i + 2] * g[3 * b + 2][lane];
        }
        for (int m = 0; m < 6; m++) d[m] = 0.5 * tangent->twist[m][lane];
        double dot = mu * (h[0] * k[0] + h[1] * k[1] + h[2] * k[2]);
        /* Columns of D [k]x. */
        double t[9] = {d[5] * k[2] - d[4] * k[1], d[4] * k[0] - d[0] * k[2], d[0] * k[1] - d[5] * k[0],
                       d[1] * k[2] - d[3] * k[1], d[3] * k[0] - d[5] * k[2], d[5] * k[1] - d[1] * k[0],
                       d[3] * k[2] - d[2] * k[1], d[2] * k[0] - d[4] * k[2], d[4] * k[1] - d[3] * k[0]};
        for (int j = 0; j < 3; j++) {
            /* Minus [h]x times these columns. */
            double twist[3] = {h[2] * t[3 + j] - h[1] * t[6 + j], h[0] * t[6 + j] - h[2] * t[j],
                               h[1] * t[j] - h[0] * t[3 + j]};
            for (int i = 0; i < 3; i++)
                block[3 * i + j] += lambda * h[i] * k[j] + mu * k[i] * h[j] + (i == j ? dot : 0) + twist[i];
        }
        return;
    }
    double left[9];
    const double *k = system->stiffness + 144 * (size_t)element + 36 * a + 3 * b;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            left[3 * i + j] = r[3 * i] * k[j] + r[3 * i + 1] * k[12 + j] + r[3 * i + 2] * k[24 + j];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            block[3 * i + j] +=
                left[3 * i] * r[3 * j] + left[3 * i + 1] * r[3 * j + 1] + left[3 * i + 2] * r[3 * j + 2];
}

void pliant_system_element(const pliant_system *system, const pliant_tangent *tangents, int32_t element,
                           double *stiffness)
{
    const int32_t begin = pliant_element_begin(system, element),
                  corners = pliant_element_begin(system, element + 1) - begin, n = 3 * corners;
    double blocks[PLIANT_ELEMENT_UNKNOWNS / 3 * 9];
    for (int32_t b = 0; b < corners; b++) {
        if (system->macros) pliant_macro_column(system, tangents, begin + b, blocks);
        else memset(blocks, 0, sizeof blocks);
        for (int32_t a = 0; a < corners; a++) {
            double *block = blocks + 9 * a;
            if (!system->macros) add_term(system, tangents, element, a, b, block);
            for (int m = 0; m < 9; m++) stiffness[n * (3 * a + m / 3) + 3 * b + m % 3] = block[m];
        }
    }
}

void pliant_system_assemble_block(const pliant_system *system, const pliant_tangent *tangents, int32_t index,
                                  double block[9])
{
    const pliant_pattern *pattern = &system->pattern;
    memset(block, 0, 9 * sizeof *block);
    for (int32_t t = pattern->term_start[index]; t < pattern->term_start[index + 1]; t++) {
        int32_t term = pattern->term[t];
        add_term(system, tangents, term / 16, term / 4 % 4, term % 4, block);
    }
}

void pliant_system_assemble(const pliant_system *system, const pliant_tangent *tangents, double *values)
{
    if (system->macros) {
        pliant_macro_assemble(system, tangents, values);
        return;
    }
    const pliant_pattern *pattern = &system->pattern;
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t column = 0; column < pattern->num_columns; column++) {
        int32_t first = pattern->start[column], height = pattern->start[column + 1] - first;
        /* Scalar columns 3j, 3j+1, 3j+2 hold 3h, 3h-1, 3h-2 numbers. */
        double *out[3];
        out[0] = values + 9 * (int64_t)first - 3 * (int64_t)column;
        out[1] = out[0] + 3 * height;
        out[2] = out[1] + 3 * height - 1;
        for (int32_t n = 0; n < height; n++) {
            double block[9];
            pliant_system_assemble_block(system, tangents, first + n, block);
            for (int c = 0; c < 3; c++)
                for (int r = n == 0 ? c : 0; r < 3; r++) *out[c]++ = block[3 * r + c];
        }
    }
}
