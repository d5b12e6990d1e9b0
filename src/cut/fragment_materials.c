/* Integrate the material of fragments. A fragment gets the fraction of its tetrahedron's integrals that its voxels
 * contribute ([H] 2.1, summed over its own voxels). The fractions of all fragments add up to one. A chip adds its
 * fraction to the element that received it. */
#include "cut/cut_stages.h"

#include "base/fail.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <string.h>

typedef struct sums {
    double lambda, mu, density, tissue;
    int32_t voxels;
    uint32_t count[PLIANT_MAX_MATERIALS];
} sums;

/* Sum over the voxels of a touched tetrahedron that belong to element `end`; end < 0: all voxels. */
static void sum_voxels(const cut_work *work, int32_t touched, int32_t end, sums *out)
{
    const pliant_voxels *voxels = work->voxels;
    const int32_t tet = work->touched[touched], count = work->start[touched + 1] - work->start[touched],
                  tets = work->body->fine.num_tets;
    const uint8_t *material = voxels->material + voxels->start[tet];
    /* next to bone, fixed voxels are not part of the tetrahedron's integrals (pliant_mesh_integrate_moved) */
    const bool leaves_out = work->body->fine.num_moved > 0 && voxels->load[tet].num_voxels < (uint32_t)count;
    memset(out, 0, sizeof *out);
    for (int32_t v = 0; v < count; v++) {
        if (end >= 0 && cut_receiver(work, tets + work->part[work->start[touched] + v]) != end) continue;
        out->voxels++;
        if (leaves_out && voxels->fixed_material[material[v]]) continue;
        out->count[material[v]]++;
    }
    for (int32_t m = 0; m < voxels->num_materials; m++) {
        const pliant_tet_material *one = voxels->of_material + m;
        out->lambda += out->count[m] * one->lambda;
        out->mu += out->count[m] * one->mu;
        out->density += out->count[m] * one->density;
        out->tissue += out->count[m] * (double)one->tissue;
    }
}

/* Return part / whole, or the fraction of voxels if whole is zero. */
static double fraction(double part, double whole, const sums *own, const sums *all)
{
    return whole > 0 ? part / whole : (double)own->voxels / all->voxels;
}

static void share_material(const cut_work *work, int32_t tet, const sums *own, const sums *all,
                           pliant_tet_material *out)
{
    const pliant_tet_material *load = work->voxels->load + tet;
    *out = *load;
    if (own->voxels == all->voxels) return;
    out->lambda *= fraction(own->lambda, all->lambda, own, all);
    out->mu *= fraction(own->mu, all->mu, own, all);
    out->density *= fraction(own->density, all->density, own, all);
    out->tissue *= (float)fraction(own->tissue, all->tissue, own, all);
    out->num_voxels = (uint32_t)own->voxels;
    uint32_t maximum = 0;
    for (int32_t m = 0; m < work->voxels->num_materials; m++) {
        if (own->count[m] <= maximum) continue;
        maximum = own->count[m];
        out->material = (uint16_t)m;
    }
}

/* Add the material of a chip from another tetrahedron, weighted by volume. */
static void add_chip(const pliant_tet_material *chip, double volumes, pliant_tet_material *out)
{
    out->lambda += volumes * chip->lambda;
    out->mu += volumes * chip->mu;
    out->density += volumes * chip->density;
    out->num_voxels += chip->num_voxels;
}

pliant_status pliant_cut_materials(cut_work *work)
{
    const pliant_body *body = work->body;
    const int32_t tets = body->fine.num_tets;
    work->material = pliant_calloc((size_t)(work->num_changed + work->num_tets - tets) + 1, sizeof *work->material);
    if (!work->material) return pliant_fail_memory("the materials of fragments");
    for (int32_t r = 0; r < work->num_changed; r++) work->material[r] = body->fine_material[work->changed[r]];
    /* the first pass handles fragments of the same tetrahedron, the second one chips of other tetrahedra */
    for (int pass = 0; pass < 2; pass++)
        for (int32_t t = 0; t < work->num_touched; t++) {
            const int32_t tet = work->touched[t];
            sums all, own;
            sum_voxels(work, t, -1, &all);
            for (int32_t f = work->first[t]; f < work->first[t + 1]; f++) {
                const int32_t end = cut_receiver(work, tets + f), with = cut_tet_of(work, end);
                bool first = (with != tet) == (pass == 1);
                for (int32_t g = work->first[t]; g < f && first; g++) first = cut_receiver(work, tets + g) != end;
                if (!first) continue;
                pliant_tet_material made;
                double gradients[12];
                sum_voxels(work, t, end, &own);
                share_material(work, tet, &own, &all, &made);
                pliant_tet_material *out = work->material + cut_row(work, cut_number(work, end));
                if (pass == 0) *out = made;
                else
                    add_chip(&made,
                             pliant_mesh_gradients(&body->fine, tet, gradients) /
                                 pliant_mesh_gradients(&body->fine, with, gradients),
                             out);
            }
        }
    return PLIANT_OK;
}
