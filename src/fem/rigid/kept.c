/* What a step begins with, of pieces: a step that is taken anew goes back to it. */
#include "base/fail.h"
#include "fem/rigid/pieces.h"
#include "pliant/memory.h"

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

/* @return bytes of all of them */
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

void pliant_falling_kept_free(pliant_falling_kept *kept)
{
    if (kept) pliant_free(kept->all);
    pliant_free(kept);
}
