/* Motion of the pieces in a leg, reduced to a fraction of it. */
#include "base/fail.h"
#include "fem/element/rotation.h"
#include "fem/rigid/pieces.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

struct pliant_falling_kept {
    int32_t num_pieces, num_nodes; /* capacities */
    piece *pieces;                 /* (num_pieces) */
    double *x;                     /* (num_nodes x 3) [m] */
};

pliant_status pliant_falling_keep(const pliant_falling *falling, pliant_falling_kept **out)
{
    const pliant_pieces *pieces = falling->body->pieces;
    const int32_t count = pieces->count, nodes = pieces->start[count];
    pliant_falling_kept *kept = *out ? *out : (*out = pliant_calloc(1, sizeof **out));
    if (!kept) return pliant_fail_memory("detached pieces");
    if (count > kept->num_pieces) {
        piece *made = pliant_resize(kept->pieces, (size_t)count, sizeof *made);
        if (!made) return pliant_fail_memory("detached pieces");
        kept->pieces = made;
        kept->num_pieces = count;
    }
    if (nodes > kept->num_nodes) {
        double *made = pliant_resize(kept->x, (size_t)nodes, 3 * sizeof *made);
        if (!made) return pliant_fail_memory("detached pieces");
        kept->x = made;
        kept->num_nodes = nodes;
    }
    memcpy(kept->pieces, falling->pieces, (size_t)count * sizeof *kept->pieces);
    memcpy(kept->x, falling->x, 3 * (size_t)nodes * sizeof *kept->x);
    return PLIANT_OK;
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
    const piece *before = kept->pieces;
    const double still[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    for (int32_t p = 0; p < pieces->count; p++) {
        const int32_t first = pieces->start[p], count = pieces->start[p + 1] - first;
        const double *x = kept->x + 3 * (size_t)first;
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
    if (!kept) return;
    pliant_free(kept->pieces);
    pliant_free(kept->x);
    pliant_free(kept);
}
