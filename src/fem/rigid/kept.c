/* State of the pieces at the start of a step, for rollback. */
#include "base/fail.h"
#include "fem/element/rotation.h"
#include "fem/rigid/pieces.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

struct pliant_falling_kept {
    size_t bytes;
    char *all;       /* (bytes) pieces, positions, joints */
    grip grips[MOST_GRIPS];
    int num_grips;
    double gravity[3];
    bool told;
};

typedef struct part { void *at; size_t bytes; } part;

/* List the parts of the stored state.
 * @return Number of bytes. */
static size_t list(const pliant_falling *falling, part out[3])
{
    const pliant_pieces *pieces = falling->body->pieces;
    out[0] = (part){falling->pieces, (size_t)pieces->count * sizeof *falling->pieces};
    out[1] = (part){falling->x, 3 * (size_t)pieces->start[pieces->count] * sizeof *falling->x};
    out[2] = (part){falling->joint_at, (size_t)pieces->num_joints * sizeof *falling->joint_at};
    return out[0].bytes + out[1].bytes + out[2].bytes;
}

pliant_status pliant_falling_keep(const pliant_falling *falling, pliant_falling_kept **out)
{
    if (!*out && !(*out = pliant_calloc(1, sizeof **out))) return pliant_fail_memory("the pieces that have come off");
    pliant_falling_kept *kept = *out;
    part parts[3];
    const size_t bytes = list(falling, parts);
    if (bytes > kept->bytes) {
        char *all = pliant_resize(kept->all, bytes, 1);
        if (!all) return pliant_fail_memory("the pieces that have come off");
        kept->all = all;
        kept->bytes = bytes;
    }
    char *to = kept->all;
    for (int p = 0; p < 3; to += parts[p++].bytes) memcpy(to, parts[p].at, parts[p].bytes);
    memcpy(kept->grips, falling->grips, sizeof kept->grips);
    memcpy(kept->gravity, falling->gravity, sizeof kept->gravity);
    kept->num_grips = falling->num_grips;
    kept->told = falling->told;
    return PLIANT_OK;
}

void pliant_falling_back(const pliant_falling_kept *kept, pliant_falling *falling)
{
    part parts[3];
    const char *from = kept->all;
    (void)list(falling, parts);
    for (int p = 0; p < 3; from += parts[p++].bytes) memcpy(parts[p].at, from, parts[p].bytes);
    memcpy(falling->grips, kept->grips, sizeof falling->grips);
    memcpy(falling->gravity, kept->gravity, sizeof falling->gravity);
    falling->num_grips = kept->num_grips;
    falling->told = kept->told;
}

/* Compute the rotation between two sets of node positions about their means (Kabsch 1976), and the means. */
static void rotation_of(int32_t count, const double *from, const double *to, double rotation[9], double means[6])
{
    double product[9] = {0};
    memset(means, 0, 6 * sizeof *means);
    for (int32_t i = 0; i < 3 * count; i++) {
        means[i % 3] += from[i] / count;
        means[3 + i % 3] += to[i] / count;
    }
    for (int32_t i = 0; i < count; i++)
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                product[3 * r + c] +=
                    (to[3 * (size_t)i + (size_t)r] - means[3 + r]) * (from[3 * (size_t)i + (size_t)c] - means[c]);
    pliant_rotation_signed_svd(product, rotation);
}

/* Compute the rotation vector of a rotation [rad]. */
static void angle_of(const double r[9], double out[3])
{
    const double axis[3] = {r[7] - r[5], r[2] - r[6], r[3] - r[1]},
                 sine = 0.5 * sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    const double angle = atan2(sine, 0.5 * (r[0] + r[4] + r[8] - 1));
    for (int d = 0; d < 3; d++) out[d] = sine > 0 ? 0.5 * axis[d] * angle / sine : 0;
}

void pliant_falling_partway(const pliant_falling_kept *kept, double share, pliant_falling *falling)
{
    const pliant_pieces *pieces = falling->body->pieces;
    const piece *before = (const piece *)kept->all;
    const double *from = (const double *)(kept->all + (size_t)pieces->count * sizeof *before),
                 still[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    for (int32_t p = 0; p < pieces->count; p++) {
        const int32_t first = pieces->start[p], count = pieces->start[p + 1] - first;
        const double *x = from + 3 * (size_t)first;
        double *to = falling->x + 3 * (size_t)first, rotation[9], means[6], angle[3], centre[3];
        if (count == 0) continue;
        rotation_of(count, x, to, rotation, means);
        angle_of(rotation, angle);
        for (int d = 0; d < 3; d++) {
            angle[d] *= share;
            centre[d] = means[d] + share * (means[3 + d] - means[d]);
            falling->pieces[p].velocity[d] =
                before[p].velocity[d] + share * (falling->pieces[p].velocity[d] - before[p].velocity[d]);
            falling->pieces[p].momentum[d] =
                before[p].momentum[d] + share * (falling->pieces[p].momentum[d] - before[p].momentum[d]);
        }
        pliant_rigid_turn(angle, still, rotation);
        for (int32_t i = 0; i < count; i++)
            for (int r = 0; r < 3; r++) {
                const double *at = x + 3 * (size_t)i;
                to[3 * (size_t)i + (size_t)r] = centre[r] + rotation[3 * r] * (at[0] - means[0]) +
                                                rotation[3 * r + 1] * (at[1] - means[1]) +
                                                rotation[3 * r + 2] * (at[2] - means[2]);
            }
    }
}

void pliant_falling_kept_free(pliant_falling_kept *kept)
{
    if (kept) pliant_free(kept->all);
    pliant_free(kept);
}
