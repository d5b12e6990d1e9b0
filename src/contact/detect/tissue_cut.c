/* The two sides of a cut through voxels. */
#include "contact/detect/tissue.h"

#include "base/cubic.h"
#include "base/fail.h"
#include "mesh/mesh.h"
#include "topology/links.h"
#include "contact/detect/part_contacts.h"
#include "contact/detect/update_sides.h"
#include "base/memory.h"
#include "base/pairs.h"
#include "base/vector3.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* fraction of its links' area; a face with a smaller projected area is folded and is left out */
static const double folded = 0.1;
static const double rounding = 1e-12; /* of an opening [m] */

/* A severed link between two fragments. */
typedef struct parting {
    int32_t tet[2], number;
    double middle[3], towards[3]; /* position at rest [m]; normal to tet[0], times the link's area [m^2] */
} parting;

static bool has_tissue(const pliant_voxels *voxels, int32_t voxel)
{
    const int32_t tet = voxels->owner[voxel];
    return tet >= 0 &&
           voxels->of_material[voxels->material[voxels->start[tet] + pliant_voxel_in(voxels, tet, voxel)]].tissue > 0;
}

static bool find_parting(const pliant_body *body, int32_t number, parting *out)
{
    const pliant_voxels *voxels = body->voxels;
    const pliant_geometry *geometry = &voxels->geometry;
    const int axis = (int)(body->cuts->link[number] % 4);
    const int32_t voxel = (int32_t)(body->cuts->link[number] / 4), other = voxel + pliant_stride_of(voxels, axis);
    int32_t at[3];
    if (!has_tissue(voxels, voxel) || !has_tissue(voxels, other)) return false;
    out->number = number;
    out->tet[0] = pliant_voxels_fragment(voxels, body->cuts, voxel);
    out->tet[1] = pliant_voxels_fragment(voxels, body->cuts, other);
    if (out->tet[0] == out->tet[1]) return false;
    const bool turned = out->tet[0] > out->tet[1];
    if (turned) {
        const int32_t first = out->tet[0];
        out->tet[0] = out->tet[1];
        out->tet[1] = first;
    }
    pliant_place_of(voxels, voxel, at);
    double middle[3] = {at[0], at[1], at[2]};
    middle[axis] += 0.5;
    pliant_geometry_to_world(geometry, middle, out->middle);
    const double area = geometry->spacing[(axis + 1) % 3] * geometry->spacing[(axis + 2) % 3];
    for (int d = 0; d < 3; d++) out->towards[d] = (turned ? area : -area) * geometry->direction[3 * d + axis];
    return true;
}

/* The links of one face, and a normal that also uses the adjacent faces. */
typedef struct patch {
    int32_t first, count;   /* range in the sorted list of links */
    double middle[3], own[3], normal[3], area; /* own: sum of the face's links */
} patch;

static void gather(const parting *list, patch *one)
{
    for (int32_t n = one->first; n < one->first + one->count; n++) {
        double square = 0;
        for (int d = 0; d < 3; d++) {
            one->middle[d] += list[n].middle[d] / one->count;
            one->own[d] += list[n].towards[d];
            square += list[n].towards[d] * list[n].towards[d];
        }
        one->area += sqrt(square);
    }
}

/* Smooth the faces' normals twice: each normal becomes the sum over all faces of both fragments. Faces of voxels
 * form steps that would block sliding.
 * @param sum (tetrahedra x 3) buffer, all 0 */
static void smooth(const parting *list, int32_t count, patch *patches, double *sum)
{
    for (int32_t p = 0; p < count; p++) memcpy(patches[p].normal, patches[p].own, sizeof patches[p].own);
    for (int again = 0; again < 2; again++) {
        for (int pass = 0; pass < 3; pass++)
            for (int32_t p = 0; p < count; p++) {
                patch *one = patches + p;
                const int32_t *tet = list[one->first].tet;
                double square = 0;
                for (int d = 0; d < 3; d++) {
                    double *towards = sum + 3 * (size_t)tet[0] + d, *away = sum + 3 * (size_t)tet[1] + d;
                    if (pass == 0) {
                        *towards += one->normal[d];
                        *away -= one->normal[d];
                    } else if (pass == 1) {
                        one->normal[d] = *towards - *away;
                    } else {
                        *towards = *away = 0;
                    }
                    square += one->normal[d] * one->normal[d];
                }
                for (int d = 0; d < 3 && pass == 2 && square > 0; d++) one->normal[d] *= one->area / sqrt(square);
            }
    }
}

/* Compute a face. Return false if its links have no common direction. */
static bool find_face(const pliant_mesh *mesh, const int32_t tet[2], const patch *one, pliant_cut_face *out)
{
    double normal[3], along[2][3], square = 0;
    for (int d = 0; d < 3; d++) square += one->normal[d] * one->normal[d];
    if (!(square > 0)) return false;
    int minimum = 0;
    out->area = 0;
    for (int d = 0; d < 3; d++) {
        normal[d] = one->normal[d] / sqrt(square);
        out->area += normal[d] * one->own[d];
        if (fabs(normal[d]) < fabs(normal[minimum])) minimum = d;
    }
    if (!(out->area > folded * one->area)) return false;
    for (int d = 0; d < 3; d++) along[0][d] = (d == minimum) - normal[minimum] * normal[d];
    for (int d = 0; d < 3; d++)
        along[1][d] = normal[(d + 1) % 3] * along[0][(d + 2) % 3] - normal[(d + 2) % 3] * along[0][(d + 1) % 3];
    for (int side = 0; side < 2; side++) {
        double gradients[12];
        out->tet[side] = tet[side];
        pliant_mesh_barycentric(mesh, tet[side], one->middle, out->at[side]);
        pliant_mesh_gradients(mesh, tet[side], gradients);
        for (int k = 0; k < 2; k++)
            for (int v = 0; v < 4; v++) {
                out->along[side][k][v] = 0;
                for (int d = 0; d < 3; d++) out->along[side][k][v] += gradients[3 * v + d] * along[k][d];
            }
    }
    return true;
}

static bool same_face(const parting *a, const parting *b) { return a->tet[0] == b->tet[0] && a->tet[1] == b->tet[1]; }

/* Compute all faces. list: sorted by pair of fragments */
static pliant_status make_faces(const pliant_body *body, const parting *list, int32_t found, pliant_cut_face **out,
                                int32_t *count)
{
    int32_t num_patches = 0;
    for (int32_t n = 0; n < found; n++) num_patches += n == 0 || !same_face(list + n, list + n - 1);
    if (num_patches == 0) return PLIANT_OK;
    patch *patches = pliant_calloc((size_t)num_patches, sizeof *patches);
    double *sum = pliant_calloc((size_t)body->fine.num_tets, 3 * sizeof *sum);
    pliant_cut_face *face = pliant_calloc((size_t)num_patches, sizeof *face);
    const bool there = patches && sum && face;
    num_patches = 0;
    for (int32_t n = 0; n < found && there; n++) {
        if (n == 0 || !same_face(list + n, list + n - 1)) patches[num_patches++].first = n;
        patches[num_patches - 1].count++;
    }
    for (int32_t p = 0; p < num_patches && there; p++) gather(list, patches + p);
    if (there) smooth(list, num_patches, patches, sum);
    for (int32_t p = 0; p < num_patches && there; p++)
        *count += find_face(&body->fine, list[patches[p].first].tet, patches + p, face + *count);
    pliant_free(patches);
    pliant_free(sum);
    if (!there) {
        pliant_free(face);
        return pliant_fail_memory("the faces of a cut");
    }
    *out = face;
    return PLIANT_OK;
}

pliant_status pliant_cut_faces(const pliant_body *body, pliant_cut_face **out, int32_t *count)
{
    *out = NULL;
    *count = 0;
    const int32_t links = body->voxels && body->cuts ? body->cuts->num_links : 0;
    if (links == 0) return PLIANT_OK;
    parting *list = pliant_calloc((size_t)links, sizeof *list);
    if (!list) return pliant_fail_memory("the faces of a cut");
    int32_t found = 0;
    for (int32_t n = 0; n < links; n++) found += find_parting(body, n, list + found);
    if (found > 0) qsort(list, (size_t)found, sizeof *list, pliant_triple_order);
    pliant_status status = make_faces(body, list, found, out, count);
    pliant_free(list);
    return status;
}

/* ---- contact points in a step */

/* Move the second side's point along its face to the foot of the first side's point. Then forces along the normal
 * apply no torque to either side. Return false if the face has no area. */
static bool find_foot(const double normal[3], const double offset[3], double along[2][3], const double weights[2][4],
                      double at[4])
{
    double product[2][2] = {{0}}, right[2] = {0};
    for (int k = 0; k < 2; k++) {
        double out = 0;
        for (int d = 0; d < 3; d++) out += along[k][d] * normal[d];
        for (int d = 0; d < 3; d++) along[k][d] -= out * normal[d];
    }
    for (int k = 0; k < 2; k++)
        for (int d = 0; d < 3; d++) {
            right[k] += along[k][d] * offset[d];
            for (int l = 0; l < 2; l++) product[k][l] += along[k][d] * along[l][d];
        }
    const double determinant = product[0][0] * product[1][1] - product[0][1] * product[1][0];
    if (!(determinant > 1e-6 * product[0][0] * product[1][1])) return false;
    const double shift[2] = {(right[0] * product[1][1] - right[1] * product[0][1]) / determinant,
                           (right[1] * product[0][0] - right[0] * product[1][0]) / determinant};
    for (int v = 0; v < 4; v++) at[v] += shift[0] * weights[0][v] + shift[1] * weights[1][v];
    return true;
}

static void point_of(const double *positions, const int32_t *node, const double weight[4], double out[3])
{
    for (int d = 0; d < 3; d++) {
        out[d] = 0;
        for (int v = 0; v < 4; v++) out[d] += weight[v] * positions[3 * (size_t)node[v] + (size_t)d];
    }
}

/* Return the squared length of a fragment's first edge at rest. */
static double size_of(const pliant_mesh *mesh, int32_t tet)
{
    const int32_t *node = mesh->tets + 4 * (size_t)tet;
    double square = 0;
    for (int d = 0; d < 3; d++)
        square += pow(mesh->rest[3 * (size_t)node[0] + (size_t)d] - mesh->rest[3 * (size_t)node[1] + (size_t)d], 2);
    return square;
}

static bool any_moves(const pliant_body *body, const int32_t *node)
{
    bool moves = !body->fine_fixed;
    for (int v = 0; v < 4 && !moves; v++) moves = body->fine_fixed[node[v]] != PLIANT_FIXED_AT_REST;
    return moves;
}

/* One side of a face: 0 or 1. */
typedef struct side { const pliant_cut_face *face; int of; } side;

static int32_t tet_of(const side *at) { return at->face->tet[at->of]; }

/* Geometry of two sides p and q. The normal points from q to p. gap and off are the distances of their points along
 * the normal and across it. */
typedef struct meeting { double normal[3], offset[3], along[2][2][3], facing, gap, off; } meeting;

static bool look_at_sides(const pliant_body *body, const side *p, const side *q, const double *positions, meeting *out)
{
    const side *const both[2] = {p, q};
    double place[2][3], sum[3] = {0, 0, 0}, length = 0;
    for (int s = 0; s < 2; s++) {
        const int32_t *node = body->fine.tets + 4 * (size_t)tet_of(both[s]);
        double (*along)[3] = out->along[s], normal[3], square = 0;
        point_of(positions, node, both[s]->face->at[both[s]->of], place[s]);
        for (int k = 0; k < 2; k++) point_of(positions, node, both[s]->face->along[both[s]->of][k], along[k]);
        for (int d = 0; d < 3; d++)
            normal[d] = along[0][(d + 1) % 3] * along[1][(d + 2) % 3] - along[0][(d + 2) % 3] * along[1][(d + 1) % 3];
        for (int d = 0; d < 3; d++) square += normal[d] * normal[d];
        if (!(square > 0)) return false;
        /* the product of the directions points to the face's first side */
        const double sign = (both[s]->of == s ? 1 : -1) / sqrt(square);
        for (int d = 0; d < 3; d++) sum[d] += sign * normal[d];
    }
    for (int d = 0; d < 3; d++) length += sum[d] * sum[d];
    if (!(length > 0)) return false;
    out->facing = length;
    out->gap = out->off = 0;
    for (int d = 0; d < 3; d++) {
        out->normal[d] = sum[d] / sqrt(length);
        out->offset[d] = place[0][d] - place[1][d];
        out->gap += out->normal[d] * out->offset[d];
    }
    for (int d = 0; d < 3; d++) out->off += pow(out->offset[d] - fmax(out->gap, 0) * out->normal[d], 2);
    return true;
}

/* Write the contact point of two sides. Return false if the second face has no area. */
static bool write_point(const pliant_body *body, const side *p, const side *q, meeting *met,
                        const pliant_tissue_rule *rule, pliant_contact_point *out)
{
    const int32_t *first = body->fine.tets + 4 * (size_t)tet_of(p), *second = body->fine.tets + 4 * (size_t)tet_of(q);
    double foot[4];
    memcpy(foot, q->face->at[q->of], sizeof foot);
    if (!find_foot(met->normal, met->offset, met->along[1], q->face->along[q->of], foot)) return false;
    out->count = 0;
    for (int v = 0; v < 4; v++)
        pliant_contact_add_weight(&out->count, out->node, out->weight, first[v], p->face->at[p->of][v]);
    for (int v = 0; v < 4; v++)
        pliant_contact_add_weight(&out->count, out->node, out->weight, second[v], -foot[v]);
    int32_t kept = 0;
    for (int32_t k = 0; k < out->count; k++) {
        if (fabs(out->weight[k]) < 1e-12) continue;
        out->node[kept] = out->node[k];
        out->weight[kept++] = out->weight[k];
    }
    out->count = kept;
    out->area = p->face->area;
    for (int d = 0; d < 3; d++) {
        out->normal[d] = met->normal[d];
        out->place[d] =
            pliant_contact_permitted_gap(met->gap, rule->recovery, rule->remaining_depth_fraction) * met->normal[d];
    }
    return kept > 0;
}

static bool moves(const pliant_body *body, const side *p, const side *q)
{
    return any_moves(body, body->fine.tets + 4 * (size_t)tet_of(p)) ||
           any_moves(body, body->fine.tets + 4 * (size_t)tet_of(q));
}

bool pliant_cut_face_point(const pliant_body *body, const pliant_cut_face *face, const double *positions,
                           const pliant_tissue_rule *rule, bool *has_slid, pliant_contact_point *out)
{
    const side p = {face, 0}, q = {face, 1};
    meeting met;
    *has_slid = false;
    if (!look_at_sides(body, &p, &q, positions, &met) || !moves(body, &p, &q)) return false;
    /* opposite to another face, or a penetration depth of an element's length */
    *has_slid = met.off > size_of(&body->fine, face->tet[0]);
    return met.gap <= rule->margin && !*has_slid && write_point(body, &p, &q, &met, rule, out);
}

/* ---- a leg */

/* Compute the vectors whose triple product is the opening of a face times its area, by the normal of one of its sides:
 * two directions in the side, and the vector between the middles of both sides. */
static void find_opening(const pliant_body *body, const pliant_cut_face *face, int of, const double *positions,
                         double out[3][3])
{
    const int32_t *tets = body->fine.tets, *own = tets + 4 * (size_t)face->tet[of];
    double middle[2][3];
    for (int k = 0; k < 2; k++) point_of(positions, own, face->along[of][k], out[k]);
    for (int s = 0; s < 2; s++) point_of(positions, tets + 4 * (size_t)face->tet[s], face->at[s], middle[s]);
    pliant_subtract3(middle[0], middle[1], out[2]);
}

double pliant_cut_advance(const pliant_body *body, int32_t num_faces, const pliant_cut_face *faces,
                          const uint8_t *has_slid, const int32_t *piece, const double *from, const double *to,
                          double depth)
{
    double fraction = 1;
    for (int32_t f = 0; f < num_faces; f++) {
        const pliant_cut_face *face = faces + f;
        const int32_t own = piece ? piece[body->fine.tets[4 * (size_t)face->tet[0]]] : -1;
        double coefficient[4] = {0, 0, 0, 0}, normal[3] = {0, 0, 0};
        if (has_slid[f] || (own >= 0 && own == piece[body->fine.tets[4 * (size_t)face->tet[1]]])) continue;
        for (int of = 0; of < 2; of++) {
            double begin[3][3], end[3][3], one[4], cross[3];
            find_opening(body, face, of, from, begin);
            find_opening(body, face, of, to, end);
            pliant_cubic_coefficients((const double(*)[3])begin, (const double(*)[3])end, one);
            pliant_cross3(begin[0], begin[1], cross);
            for (int k = 0; k < 4; k++) coefficient[k] += one[k];
            for (int d = 0; d < 3; d++) normal[d] += cross[d];
        }
        const double area = pliant_length3(normal), limit = fmin(-depth * area, coefficient[0] - rounding * area);
        if (area > 0) fraction = fmin(fraction, pliant_cubic_time(coefficient, limit));
    }
    return fraction;
}

/* ---- slid sides */

static void place_of_side(const pliant_body *body, const side *of, const double *positions, double out[3])
{
    point_of(positions, body->fine.tets + 4 * (size_t)tet_of(of), of->face->at[of->of], out);
}

/* Sorted by x, then by number. */
typedef struct slot { double x; int32_t side; } slot;

static int compare_slots(const void *a, const void *b)
{
    const slot *one = a, *other = b;
    return one->x != other->x ? (one->x > other->x) - (one->x < other->x)
                              : (one->side > other->side) - (one->side < other->side);
}

/* Find the side that is now opposite to a slid side, with the smallest distance across the normal. -1: none */
static int32_t find_opposite(const pliant_body *body, const pliant_cut_face *faces, const slot *slots, int32_t count,
                             const int32_t *piece, int32_t number, const double *positions,
                             const pliant_tissue_rule *rule, meeting *best)
{
    const side p = {faces + number / 2, number % 2};
    const double size = size_of(&body->fine, tet_of(&p)), reach = sqrt(size) + rule->margin;
    const int32_t own = piece ? piece[body->fine.tets[4 * (size_t)tet_of(&p)]] : -1;
    double place[3];
    int32_t low = 0, high = count, found = -1;
    place_of_side(body, &p, positions, place);
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (slots[middle].x < place[0] - reach) low = middle + 1;
        else high = middle;
    }
    for (; low < count && slots[low].x <= place[0] + reach; low++) {
        const side q = {faces + slots[low].side / 2, slots[low].side % 2};
        meeting met;
        if (tet_of(&q) == tet_of(&p) || (own >= 0 && piece[body->fine.tets[4 * (size_t)tet_of(&q)]] == own)) continue;
        if (!look_at_sides(body, &p, &q, positions, &met) || !(met.facing > 2 + 2 * rule->settings->same_cosine) ||
            !(met.gap <= rule->margin) || !(met.gap > -rule->settings->self_border * sqrt(size)) || met.off > size)
            continue;
        if ((found >= 0 && !(met.off < best->off)) || !moves(body, &p, &q)) continue;
        found = slots[low].side;
        *best = met;
    }
    return found;
}

pliant_status pliant_cut_slid_points(const pliant_body *body, int32_t num_faces, const pliant_cut_face *faces,
                                     const uint8_t *has_slid, const int32_t *piece, const double *positions,
                                     const pliant_tissue_rule *rule, pliant_contacts *out)
{
    slot *slots = pliant_calloc((size_t)num_faces, 2 * sizeof *slots);
    /* sides that already have a point, as the other side of a slid side */
    uint8_t *has_point = pliant_calloc((size_t)num_faces, 2);
    pliant_status status = slots && has_point ? PLIANT_OK : pliant_fail_memory("the self-contacts of the tissue");
    if (status != PLIANT_OK) {
        pliant_free(slots);
        pliant_free(has_point);
        return status;
    }
    for (int32_t n = 0; n < 2 * num_faces; n++) {
        const side of = {faces + n / 2, n % 2};
        double place[3];
        place_of_side(body, &of, positions, place);
        slots[n] = (slot){place[0], n};
    }
    qsort(slots, 2 * (size_t)num_faces, sizeof *slots, compare_slots);
    for (int32_t n = 0; n < 2 * num_faces && status == PLIANT_OK; n++) {
        meeting met;
        const int32_t other = has_slid[n / 2] && !has_point[n]
                                  ? find_opposite(body, faces, slots, 2 * num_faces, piece, n, positions, rule, &met)
                                  : -1;
        if (other < 0) continue;
        const side p = {faces + n / 2, n % 2}, q = {faces + other / 2, other % 2};
        if ((status = pliant_contacts_reserve(out, out->count + 1)) != PLIANT_OK) break;
        pliant_contact_point *point = out->point + out->count;
        *point =
            (pliant_contact_point){.kind = PLIANT_OBSTACLE_TISSUE, .tool = -1, .part = -1, .friction = rule->friction};
        point->feature = (uint64_t)PLIANT_TISSUE_SLID << 56 | (uint64_t)n << 28 | (uint64_t)other;
        if (!write_point(body, &p, &q, &met, rule, point)) continue;
        has_point[other] = 1;
        out->count++;
    }
    pliant_free(slots);
    pliant_free(has_point);
    return status;
}
