/* Motion of the pieces in a leg, reduced to a fraction of it. */
#include "base/fail.h"
#include "fem/element/rotation.h"
#include "fem/rigid/rigid_pieces_data.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

struct pliant_rigid_pieces_saved {
    int32_t num_pieces, num_nodes; /* capacities */
    piece *pieces;                 /* (num_pieces) */
    double *x;                     /* (num_nodes x 3) [m] */
};

pliant_status pliant_rigid_pieces_save(const pliant_rigid_pieces *rigid_pieces, pliant_rigid_pieces_saved **out)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    const int32_t count = pieces->count, nodes = pieces->start[count];
    pliant_rigid_pieces_saved *kept = *out ? *out : (*out = pliant_calloc(1, sizeof **out));
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
    memcpy(kept->pieces, rigid_pieces->pieces, (size_t)count * sizeof *kept->pieces);
    memcpy(kept->x, rigid_pieces->x, 3 * (size_t)nodes * sizeof *kept->x);
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

void pliant_rigid_pieces_interpolate(const pliant_rigid_pieces_saved *kept, double fraction,
                                     pliant_rigid_pieces *rigid_pieces)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    const piece *before = kept->pieces;
    const double still[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    for (int32_t p = 0; p < pieces->count; p++) {
        const int32_t first = pieces->start[p], count = pieces->start[p + 1] - first;
        const double *x = kept->x + 3 * (size_t)first;
        double *to = rigid_pieces->x + 3 * (size_t)first, rotation[9], means[6], angle[3], centre[3];
        if (count == 0) continue;
        rotation_of(count, x, to, rotation, means);
        angle_of(rotation, angle);
        for (int d = 0; d < 3; d++) {
            angle[d] *= fraction;
            centre[d] = means[d] + fraction * (means[3 + d] - means[d]);
            rigid_pieces->pieces[p].velocity[d] =
                before[p].velocity[d] + fraction * (rigid_pieces->pieces[p].velocity[d] - before[p].velocity[d]);
            rigid_pieces->pieces[p].momentum[d] =
                before[p].momentum[d] + fraction * (rigid_pieces->pieces[p].momentum[d] - before[p].momentum[d]);
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

void pliant_rigid_pieces_saved_free(pliant_rigid_pieces_saved *kept)
{
    if (!kept) return;
    PLIANT_FREE(kept->pieces, kept->x, kept);
}
