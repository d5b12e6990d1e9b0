/* Count the connected pieces of a body that contain tissue. */
#include "cut/cut_stages.h"

#include "base/fail.h"
#include "base/memory.h"

pliant_status pliant_cut_count_pieces(const pliant_body *body, int32_t *pieces)
{
    const pliant_mesh *fine = &body->fine;
    int32_t *piece = pliant_calloc((size_t)fine->num_nodes, sizeof *piece);
    uint8_t *counted = pliant_calloc((size_t)fine->num_nodes, 1);
    pliant_status status = piece && counted ? PLIANT_OK : pliant_fail_memory("the pieces of the mesh");
    if (status != PLIANT_OK) goto done;
    for (int32_t n = 0; n < fine->num_nodes; n++) piece[n] = n;
    for (int32_t j = 0; body->pieces && j < body->pieces->num_joints + body->pieces->num_inner; j++)
        pliant_set_join(piece, body->pieces->joint[2 * j], body->pieces->joint[2 * j + 1]);
    for (int32_t t = 0; t < fine->num_tets; t++)
        for (int v = 1; v < 4; v++) pliant_set_join(piece, fine->tets[4 * (size_t)t], fine->tets[4 * (size_t)t + v]);
    *pieces = 0;
    for (int32_t t = 0; t < fine->num_tets; t++) {
        const int32_t first = pliant_set_root(piece, fine->tets[4 * (size_t)t]);
        if (!(body->fine_material[t].tissue > 0) || counted[first]) continue;
        (*pieces)++;
        counted[first] = 1;
    }
done:
    pliant_free(piece);
    pliant_free(counted);
    return status;
}
