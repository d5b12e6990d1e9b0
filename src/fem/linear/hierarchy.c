/* The levels of a multigrid: which nodes move as one, and the patterns of their matrices. */
#include "fem/linear/hierarchy.h"

#include "base/fail.h"
#include "fem/linear/aggregate.h"
#include "fem/linear/pattern.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

/* Ties weaker than this do not bind, of nodes and of aggregates. (110 k tetrahedra of a CT with air: a cycle leaves 0.70 a step of conjugate
 * gradients where air and tissue share aggregates, 0.55 from 0.06 to 0.08; above, aggregates become many. Of aggregates 0.55 from 0.14 on,
 * 0.60 at 0.1.) */
static const float least_tie[2] = {0.07f, 0.16f};

/* the columns of blocks, and both triangles by rows for products with a vector */
static pliant_status full_rows(pliant_grid_level *level)
{
    const pliant_pattern *pattern = &level->pattern;
    int32_t entries = 2 * pattern->num_blocks - pattern->num_columns;
    level->block_column = pliant_calloc((size_t)pattern->num_blocks, sizeof *level->block_column);
    level->row_start = pliant_calloc((size_t)pattern->num_columns + 2, sizeof *level->row_start);
    level->column = pliant_calloc((size_t)entries, sizeof *level->column);
    level->place = pliant_calloc((size_t)pattern->num_blocks, 2 * sizeof *level->place);
    if (!level->block_column || !level->row_start || !level->column || !level->place) return pliant_fail_memory("the rows of the matrix");
    for (int32_t column = 0; column < pattern->num_columns; column++)
        for (int32_t b = pattern->start[column]; b < pattern->start[column + 1]; b++) {
            level->block_column[b] = column;
            level->row_start[pattern->row[b] + 2]++;
            if (pattern->row[b] != column) level->row_start[column + 2]++;
        }
    for (int32_t r = 0; r < pattern->num_columns; r++) level->row_start[r + 2] += level->row_start[r + 1];
    for (int32_t column = 0; column < pattern->num_columns; column++)
        for (int32_t b = pattern->start[column]; b < pattern->start[column + 1]; b++) {
            int32_t row = pattern->row[b];
            level->place[2 * b] = level->row_start[row + 1]++;
            level->column[level->place[2 * b]] = column;
            level->place[2 * b + 1] = row == column ? -1 : level->row_start[column + 1]++;
            if (row != column) level->column[level->place[2 * b + 1]] = row;
        }
    return PLIANT_OK;
}

static pliant_status list_members(pliant_grid_level *level)
{
    const int32_t nodes = level->pattern.num_columns;
    level->member_start = pliant_calloc((size_t)level->num_aggregates + 2, sizeof *level->member_start);
    level->member = pliant_calloc((size_t)nodes, sizeof *level->member);
    if (!level->member_start || !level->member) return pliant_fail_memory("the aggregates");
    for (int32_t n = 0; n < nodes; n++) level->member_start[level->aggregate[n] + 2]++;
    for (int32_t a = 0; a < level->num_aggregates; a++) level->member_start[a + 2] += level->member_start[a + 1];
    for (int32_t n = 0; n < nodes; n++) level->member[level->member_start[level->aggregate[n] + 1]++] = n;
    return PLIANT_OK;
}

static pliant_status find_aggregates(int index, const double *blocks, pliant_grid_level *level)
{
    const int32_t nodes = level->pattern.num_columns, stride = index > 0 ? 2 : 1;
    pliant_ties ties;
    pliant_status status = pliant_ties_create(&level->pattern, blocks, stride, &ties);
    if (status != PLIANT_OK) return status;
    level->aggregate = pliant_calloc((size_t)nodes, sizeof *level->aggregate);
    if (level->aggregate) {
        level->num_aggregates = pliant_aggregate(&ties, least_tie[index > 0], level->aggregate);
        for (int32_t n = nodes - 1; n > 0; n--) level->aggregate[n] = level->aggregate[n / stride];
    }
    pliant_ties_free(&ties);
    return level->aggregate ? list_members(level) : pliant_fail_memory("the aggregates");
}

/* which blocks add to which pair of aggregates */
static pliant_status find_pairs(pliant_grid_level *level)
{
    const pliant_pattern *pattern = &level->pattern;
    pliant_entry *entries = pliant_calloc((size_t)pattern->num_blocks, sizeof *entries);
    if (!entries) return pliant_fail_memory("the pattern of the matrix");
    for (int32_t b = 0; b < pattern->num_blocks; b++) {
        const int32_t row = level->aggregate[pattern->row[b]], column = level->aggregate[level->block_column[b]];
        entries[b] = row >= column ? (pliant_entry){row, column, 2 * b} : (pliant_entry){column, row, 2 * b + 1};
    }
    level->pairs.num_columns = level->num_aggregates;
    pliant_status status = pliant_pattern_fill(&level->pairs, entries, pattern->num_blocks);
    pliant_free(entries);
    return status;
}

/* two nodes an aggregate */
static pliant_status twofold(const pliant_pattern *pairs, pliant_pattern *out)
{
    out->num_columns = 2 * pairs->num_columns;
    out->num_blocks = 4 * pairs->num_blocks - pairs->num_columns;
    out->num_values = 9 * (int64_t)out->num_blocks - 3 * (int64_t)out->num_columns;
    out->start = pliant_calloc((size_t)out->num_columns + 1, sizeof *out->start);
    out->row = pliant_calloc((size_t)out->num_blocks, sizeof *out->row);
    if (!out->start || !out->row) return pliant_fail_memory("the pattern of the matrix");
    int32_t blocks = 0;
    for (int32_t column = 0; column < out->num_columns; column++) {
        for (int32_t p = pairs->start[column / 2]; p < pairs->start[column / 2 + 1]; p++)
            for (int32_t row = 2 * pairs->row[p]; row < 2 * pairs->row[p] + 2; row++)
                if (row >= column) out->row[blocks++] = row;
        out->start[column + 1] = blocks;
    }
    return PLIANT_OK;
}

static void level_free(pliant_grid_level *level)
{
    pliant_pattern_clear(&level->pattern);
    pliant_pattern_clear(&level->pairs);
    pliant_free(level->block_column);
    pliant_free(level->aggregate);
    pliant_free(level->member_start);
    pliant_free(level->member);
    pliant_free(level->row_start);
    pliant_free(level->column);
    pliant_free(level->place);
    memset(level, 0, sizeof *level);
}

void pliant_hierarchy_free(pliant_hierarchy *hierarchy)
{
    if (!hierarchy) return;
    /* the finest pattern belongs to the model */
    memset(&hierarchy->level[0].pattern, 0, sizeof hierarchy->level[0].pattern);
    for (int l = 0; l < hierarchy->num_levels; l++) level_free(hierarchy->level + l);
    pliant_factor_free(hierarchy->factor);
    pliant_free(hierarchy);
}

/* numbers of a level while the next is made */
typedef struct pliant_level_room {
    double *blocks, *place;
} pliant_level_room;

static pliant_status next_level(pliant_hierarchy *hierarchy, pliant_level_room *room)
{
    const int index = hierarchy->num_levels - 1;
    pliant_grid_level *level = hierarchy->level + index, *next = level + 1;
    pliant_status status = full_rows(level);
    if (status == PLIANT_OK) status = find_aggregates(index, room->blocks, level);
    if (status == PLIANT_OK) status = find_pairs(level);
    if (status != PLIANT_OK) return status;
    hierarchy->num_levels++;
    status = twofold(&level->pairs, &next->pattern);
    if (status != PLIANT_OK) return status;
    double *arm = pliant_calloc((size_t)level->pattern.num_columns, 3 * sizeof *arm);
    pliant_level_room after = {pliant_calloc((size_t)next->pattern.num_blocks, 9 * sizeof *after.blocks),
                               pliant_calloc((size_t)level->num_aggregates, 3 * sizeof *after.place)};
    if (arm && after.blocks && after.place) {
        pliant_galerkin_arms(hierarchy, index, room->place, after.place, arm);
        pliant_galerkin_product(hierarchy, index, room->blocks, arm, hierarchy->system.num_threads, after.blocks);
    } else status = pliant_fail_memory("the coarser levels");
    pliant_free(arm);
    pliant_free(room->blocks);
    pliant_free(room->place);
    *room = after;
    return status;
}

/* matrix and places of the finest level at rest */
static pliant_status at_rest(const pliant_hierarchy *hierarchy, pliant_level_room *room)
{
    const pliant_system *system = &hierarchy->system;
    pliant_tangent *tangents = pliant_calloc((size_t)system->num_blocks, sizeof *tangents);
    room->blocks = pliant_calloc((size_t)system->pattern.num_blocks, 9 * sizeof *room->blocks);
    room->place = pliant_calloc((size_t)system->num_free, 3 * sizeof *room->place);
    if (tangents && room->blocks && room->place) {
        pliant_system_tangents(system, system->mesh->rest, PLIANT_TWIST_EXACT, tangents);
        pliant_galerkin_finest(system, tangents, room->blocks);
        for (int32_t f = 0; f < system->num_free; f++)
            memcpy(room->place + 3 * (size_t)f, system->mesh->rest + 3 * (size_t)system->node_of_free[f], 3 * sizeof *room->place);
    }
    pliant_free(tangents);
    return tangents && room->blocks && room->place ? PLIANT_OK : pliant_fail_memory("the coarser levels");
}

pliant_status pliant_hierarchy_create(const pliant_system *system, int32_t largest_direct, pliant_hierarchy **out)
{
    const double thinned = 0.8; /* a level that has more of the nodes of the one above is the last */
    *out = NULL;
    pliant_hierarchy *hierarchy = pliant_calloc(1, sizeof *hierarchy);
    if (!hierarchy) return pliant_fail_memory("the coarser levels");
    hierarchy->system = *system;
    hierarchy->num_levels = 1;
    hierarchy->level[0].pattern = system->pattern;
    const double *cell = system->mesh->cell_size;
    hierarchy->length = cbrt(cell[0] * cell[1] * cell[2]);
    pliant_level_room room = {0};
    pliant_status status = at_rest(hierarchy, &room);
    while (status == PLIANT_OK && hierarchy->num_levels < PLIANT_MAX_LEVELS) {
        const int32_t nodes = hierarchy->level[hierarchy->num_levels - 1].pattern.num_columns;
        if (hierarchy->num_levels > 1 && nodes <= largest_direct) break;
        status = next_level(hierarchy, &room);
        if (status == PLIANT_OK && hierarchy->level[hierarchy->num_levels - 1].pattern.num_columns > thinned * nodes) break;
    }
    pliant_free(room.blocks);
    pliant_free(room.place);
    if (status == PLIANT_OK) status = pliant_factor_analyze(&hierarchy->level[hierarchy->num_levels - 1].pattern, &hierarchy->factor);
    if (status != PLIANT_OK) {
        pliant_hierarchy_free(hierarchy);
        return status;
    }
    *out = hierarchy;
    return PLIANT_OK;
}

double pliant_hierarchy_operations(const pliant_hierarchy *hierarchy)
{
    /* blocks of 16 pairs an element, their Galerkin products, a dozen products with the matrix for its largest eigenvalue */
    double sum = pliant_factor_operations(hierarchy->factor) + 16.0 * 120 * hierarchy->system.mesh->num_tets;
    for (int l = 0; l + 1 < hierarchy->num_levels; l++)
        sum += 200.0 * hierarchy->level[l].pattern.num_blocks + 12.0 * 18 * hierarchy->level[l].row_start[hierarchy->level[l].pattern.num_columns];
    return sum;
}
