#include "sim/step/missing_compliance.h"

#include "base/fail.h"
#include "base/memory.h"
#include "base/vector3.h"
#include "contact/shapes/shapes.h"
#include "contact/shapes/tool_shape.h"
#include "fem/patch/patch.h"
#include "fem/rigid/rigid_pieces.h"
#include "mesh/mesh.h"
#include "sim/step/contact.h"
#include "sim/step/proxy.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double PI = 3.14159265358979324;
/* displacement of a half-space under a smooth pressure of unit deviation (Johnson, Contact Mechanics, 4.2): a ball, a
 * flat punch */
static const double kappa_hertz = 0.26832815729997478, kappa_sneddon = 0.28867513459481287;
static const double min_tissue = 0.05; /* fraction of a cell: less tissue in it counts as this much */
static const double outside = 0.05; /* distance from the surface at which the distance has a gradient [cell] */
/* errors at which iterations end: length of the contact's axes, its logarithm */
static const double exact_length = 1e-6, exact_logarithm = 1e-9;
/* largest decrease of the predicted force per iteration, and exponent of force over depth: between 1 for a flat part
 * and 3 / 2 for a ball */
static const double max_decrease = 0.125, depth_exponent = 1.25;
enum {
    FINEST = 16 /* sample of the part's profile nearest to its middle: 1 / 16 cell */,
    FARTHEST = 4 /* last sample, in cells or lengths of the contact */,
    MAX_ROUNDS = 6 /* iterations for both axes */,
    MAX_STEPS = 5 /* iterations for one axis */,
    MAX_PREDICTIONS = 4 /* iterations for the force */,
    MANY = 512 /* nodes of a contact that lacks little compliance; more take much time */
};

/* Contact of one part. */
typedef struct pressed_part {
    const pliant_data *data;
    const pliant_mesh *mesh; /* the mesh that the tool feels */
    int32_t tool, part;
    double force[3], size, sum; /* total force, its length, and the sum of the points' forces [N] */
    double middle[3];           /* mean position of the points on the part, weighted by forces [m] */
    double rest[3];             /* the same of the tissue at rest [m] */
    double outward[3];          /* sum of their normals, weighted by forces [N] */
    double reach;               /* largest distance of a point from it [m] */
    double spread;              /* mean variance of the points' weights per direction along the surface [m^2] */
    double cell;                /* edge of a cell [m] */
    double compliance, poisson; /* mean of (1 - nu^2) / E [1/Pa], and of nu */
    /* the surface of the part: the point below the middle, its outward normal, and two tangents */
    double top[3], normal[3], tangent[2][3];
    pliant_pose pose;
} pressed_part;

static bool is_of(const pressed_part *of, const pliant_contact_point *point)
{
    return point->kind == PLIANT_OBSTACLE_TOOL && point->tool == of->tool && point->part == of->part &&
           pliant_dot3(point->force, point->force) > 0 &&
           !(of->data->rigid_pieces && pliant_rigid_pieces_contain(of->data->rigid_pieces, point->node[0]));
}

/* ---- the mesh's response */

/* A half-space of cells of edge h has a unit force at a node of its surface. Another node has the distance 0, 1,
 * sqrt(2) or 2 h. This is its displacement times E* h. Farther nodes move as in Boussinesq's solution, 1 / (pi r).
 * The rows are for nu of 0, 0.3, 0.45 and 0.49 (test/bench/half_space_lattice.py). */
static const double lattice_nu[4] = {0, 0.3, 0.45, 0.49}, lattice_distance[4] = {0, 1, 1.4142135623730951, 2};
static const double lattice_response[2][4][4] = {
    /* tetrahedra */
    {{1.01, 0.325, 0.221, 0.166},
     {1.12, 0.331, 0.214, 0.162},
     {1.00, 0.344, 0.216, 0.161},
     {0.72, 0.338, 0.222, 0.169}},
    /* hexahedra */
    {{1.69, 0.178, 0.275, 0.156},
     {2.00, 0.093, 0.269, 0.179},
     {2.14, 0.064, 0.236, 0.196},
     {1.96, 0.175, 0.163, 0.185}},
};

/* Variance, over h^2, by which a lattice smooths the pressure of forces at its nodes. */
static const double lattice_smoothing[2][4] = {{0.086, 0.033, 0.060, 0.185}, {-0.082, -0.122, -0.134, -0.126}};

/* Find the row below a Poisson's ratio. Return the fraction of the distance to the next row. */
static double find_row(double nu, int *row)
{
    *row = 0;
    while (*row < 2 && nu > lattice_nu[*row + 1]) ++*row;
    return fmin(fmax((nu - lattice_nu[*row]) / (lattice_nu[*row + 1] - lattice_nu[*row]), 0), 1);
}

/* Interpolate the response of a lattice at a Poisson's ratio. */
static void find_response(bool is_hexahedra, double nu, double out[4])
{
    int row;
    const double t = find_row(nu, &row);
    for (int k = 0; k < 4; k++)
        out[k] = (1 - t) * lattice_response[is_hexahedra][row][k] + t * lattice_response[is_hexahedra][row + 1][k];
}

static double response_at(const double response[4], double distance)
{
    if (distance >= lattice_distance[3]) return 1 / (PI * distance);
    int k = 0;
    while (distance >= lattice_distance[k + 1]) k++;
    const double t = (distance - lattice_distance[k]) / (lattice_distance[k + 1] - lattice_distance[k]);
    return response[k] + t * (response[k + 1] - response[k]);
}

static int compare_loads(const void *a, const void *b)
{
    const pliant_node_load *x = a, *y = b;
    return x->node != y->node ? (x->node > y->node) - (x->node < y->node)
                              : (x->order > y->order) - (x->order < y->order);
}

/* Add the force of a point at its nodes, and the variance of its weights along the surface. */
static void add_loads(const pliant_contact_point *point, int32_t count, const int32_t *node, const double *weight,
                      pressed_part *of, pliant_node_loads *out)
{
    double mean[3] = {0, 0, 0}, square = 0;
    for (int32_t k = 0; k < count; k++) {
        pliant_node_load *load = out->load + out->count;
        double from[3];
        *load = (pliant_node_load){.node = node[k], .order = out->count++};
        for (int d = 0; d < 3; d++) load->force[d] = weight[k] * point->force[d];
        pliant_subtract3(of->mesh->rest + 3 * (size_t)node[k], of->mesh->rest + 3 * (size_t)node[0], from);
        const double across = pliant_dot3(from, point->normal);
        for (int d = 0; d < 3; d++) {
            from[d] -= across * point->normal[d];
            mean[d] += weight[k] * from[d];
        }
        square += weight[k] * pliant_dot3(from, from);
    }
    of->spread += 0.5 * pliant_length3(point->force) / of->sum * (square - pliant_dot3(mean, mean));
}

/* Add the forces of all points at each node of the mesh that the tool feels. */
static pliant_status gather_loads(pressed_part *of, pliant_node_loads *out)
{
    const pliant_contacts *contacts = &of->data->contacts;
    const int32_t needed = PLIANT_CONTACT_NODES * contacts->count;
    if (needed > out->capacity) {
        pliant_node_load *load = pliant_resize(out->load, (size_t)needed, sizeof *load);
        if (!load) return pliant_fail_memory("contacts");
        out->load = load;
        out->capacity = needed;
    }
    out->count = 0;
    for (int32_t p = 0; p < contacts->count; p++) {
        const pliant_contact_point *point = contacts->point + p;
        double rest[3], weight[4];
        if (!is_of(of, point)) continue;
        if (of->mesh == &of->data->body->fine) {
            add_loads(point, point->count, point->node, point->weight, of, out);
            continue;
        }
        pliant_contact_force_position(of->data->body->fine.rest, point, rest);
        const int32_t tet = pliant_mesh_locate(of->mesh, rest, weight);
        if (tet >= 0) add_loads(point, 4, of->mesh->tets + 4 * (size_t)tet, weight, of, out);
    }
    if (out->count == 0) return PLIANT_OK;
    qsort(out->load, (size_t)out->count, sizeof *out->load, compare_loads);
    int32_t last = 0;
    for (int32_t n = 1; n < out->count; n++) {
        if (out->load[n].node != out->load[last].node)
            out->load[++last] = out->load[n];
        else
            for (int d = 0; d < 3; d++) out->load[last].force[d] += out->load[n].force[d];
    }
    out->count = last + 1;
    return PLIANT_OK;
}

/* Return the distance of two nodes along the surface, in cells. Nodes below each other act as one: where the
 * tissue ends within a cell, the nodes of both of its sides carry the load. */
static double distance_along(const pressed_part *of, int32_t a, int32_t b)
{
    double apart[3];
    pliant_subtract3(of->mesh->rest + 3 * (size_t)a, of->mesh->rest + 3 * (size_t)b, apart);
    const double across = pliant_dot3(apart, of->outward) / pliant_length3(of->outward);
    return sqrt(fmax(pliant_dot3(apart, apart) - across * across, 0)) / of->cell;
}

/* Return the work of the nodes' forces in the lattice, times E* h [N^2]. */
static double lattice_work(const pressed_part *of, const pliant_node_loads *loads, const double response[4])
{
    double work = 0;
    for (int32_t a = 0; a < loads->count; a++)
        for (int32_t b = 0; b <= a; b++) {
            const pliant_node_load *x = loads->load + a, *y = loads->load + b;
            work += (a == b ? 1 : 2) * pliant_dot3(x->force, y->force) *
                    response_at(response, distance_along(of, x->node, y->node));
        }
    return work;
}

/* ---- the contact */

static void add_point(const pliant_contact_point *point, pressed_part *of)
{
    const pliant_body *body = of->data->body;
    const double size = pliant_length3(point->force);
    double rest[3], inside[3], weight[4];
    of->sum += size;
    for (int d = 0; d < 3; d++) {
        of->force[d] += point->force[d];
        of->middle[d] += size * point->place[d];
        of->outward[d] += size * point->normal[d];
    }
    const double *cell = of->mesh->cell_size, volume = cell[0] * cell[1] * cell[2], *fine = body->fine.cell_size,
                 half = 0.5 * fmin(fine[0], fmin(fine[1], fine[2]));
    of->cell += size * (of->mesh->num_leaves > 0 ? fmax(volume, point->area * sqrt(point->area)) : volume);
    pliant_contact_force_position(body->fine.rest, point, rest);
    /* Half a cell below the surface: on it, rounding decides between elements with tissue and elements with air. */
    for (int d = 0; d < 3; d++) {
        of->rest[d] += size * rest[d];
        inside[d] = rest[d] + half * point->normal[d];
    }
    const int32_t tet = pliant_mesh_locate(&body->fine, inside, weight);
    if (tet < 0) return;
    const pliant_tet_material *material = body->fine_material + tet;
    const double lambda = material->lambda, mu = material->mu;
    if (!(mu > 0)) return;
    /* (1 - nu^2) / E of the tissue in the tetrahedron, which may be partly empty */
    of->compliance += size * fmax(material->tissue, min_tissue) * (lambda + 2 * mu) / (4 * mu * (lambda + mu));
    of->poisson += size * 0.5 * lambda / (lambda + mu);
}

/* Find the point of the part's surface nearest to a point a little outside of the middle. On the surface itself,
 * rounding decides the gradient of the distance. */
static bool find_top(const pliant_part *part, pressed_part *of)
{
    const double beyond = outside * of->cell / pliant_length3(of->outward);
    double above[3], local[3];
    for (int d = 0; d < 3; d++) above[d] = of->middle[d] + beyond * of->outward[d];
    pliant_pose_from(&of->pose, above, local);
    const double distance = pliant_part_distance(part, local, of->normal);
    for (int d = 0; d < 3; d++) of->top[d] = local[d] - distance * of->normal[d];
    return pliant_dot3(of->normal, of->normal) > 0;
}

/* Find the total of the contact points, and the frame of the part below them. Return whether the part presses. */
static bool find_contact(const pliant_tool_pose *pose, pressed_part *of)
{
    const pliant_contacts *contacts = &of->data->contacts;
    const pliant_tool_shape *shape = &of->data->tools[of->tool].shape;
    for (int32_t p = 0; p < contacts->count; p++)
        if (is_of(of, contacts->point + p)) add_point(contacts->point + p, of);
    of->size = pliant_length3(of->force);
    if (!(of->size > 0) || !(of->compliance > 0) || !(pliant_length3(of->outward) > 0)) return false;
    for (int d = 0; d < 3; d++) {
        of->middle[d] /= of->sum;
        of->rest[d] /= of->sum;
    }
    of->cell = cbrt(of->cell / of->sum);
    of->compliance /= of->sum;
    of->poisson /= of->sum;
    for (int32_t p = 0; p < contacts->count; p++)
        if (is_of(of, contacts->point + p))
            of->reach = fmax(of->reach, pliant_distance3(contacts->point[p].place, of->middle));
    pliant_part_pose(shape, shape->part[of->part].frame, pose->tip, pose->rotation, pose->jaw, &of->pose);
    return find_top(shape->part + of->part, of);
}

/* ---- the part's shape */

enum { PROFILE = 14, FLAT = 1000 /* exponent of a flat part */ };
/* Piece of a part's profile. The height below the plane that touches the middle of the part is a power of the distance
 * from the middle there. */
typedef struct segment {
    double from, to, height; /* distances of its ends, and the height at the far end [m] */
    double exponent, width;  /* of the height, and the fourth root of its variance_of */
    double root, factor;     /* of balance at the far end; root: square root of the deviation there */
} segment;
typedef struct profile {
    segment segment[PROFILE];
    int count;
} profile;

/* Sample the part's surface along a tangent. */
static void sample(const pressed_part *of, const double tangent[3], double x, double *at, double *height)
{
    const pliant_part *part = of->data->tools[of->tool].shape.part + of->part;
    *at = *height = 0;
    for (int sign = -1; sign <= 1; sign += 2) {
        double p[3], normal[3], offset[3];
        for (int d = 0; d < 3; d++) p[d] = of->top[d] + sign * x * tangent[d];
        const double distance = pliant_part_distance(part, p, normal);
        for (int d = 0; d < 3; d++) offset[d] = p[d] - distance * normal[d] - of->top[d];
        *at += 0.5 * sign * pliant_dot3(offset, tangent);
        *height -= 0.5 * pliant_dot3(offset, of->normal);
    }
    *height = fmax(*height, 0);
}

/* Find the principal directions of the part's surface within a cell. */
static void find_tangents(pressed_part *of)
{
    double axis[3] = {0, 0, 0}, base[2][3], at, height[4];
    const double *n = of->normal;
    axis[fabs(n[0]) < fabs(n[1]) ? (fabs(n[0]) < fabs(n[2]) ? 0 : 2) : (fabs(n[1]) < fabs(n[2]) ? 1 : 2)] = 1;
    pliant_cross3(n, axis, base[0]);
    pliant_normalize3(base[0]);
    pliant_cross3(n, base[0], base[1]);
    for (int k = 0; k < 4; k++) {
        const double angle = PI / 4 * k, c = cos(angle), s = sin(angle);
        double along[3];
        for (int d = 0; d < 3; d++) along[d] = c * base[0][d] + s * base[1][d];
        sample(of, along, of->cell, &at, height + k);
    }
    const double turn = 0.5 * atan2(height[1] - height[3], height[0] - height[2]), c = cos(turn), s = sin(turn);
    for (int d = 0; d < 3; d++) {
        of->tangent[0][d] = c * base[0][d] + s * base[1][d];
        of->tangent[1][d] = c * base[1][d] - s * base[0][d];
    }
}

/* Half of a contact along one direction: its length a, the part's height z there, and the exponent m of the height near
 * there, z ~ x^m. A flat part has a large m. */
typedef struct semi_axis {
    double length, height, exponent;
} semi_axis;

/* Return the variance of the pressure along an axis, over the square of its length: 1 / 5 for Hertz, 1 / 3 for a flat
 * punch. */
static double variance_of(double m) { return (m + 1) / (3 * (m + 3)); }

static double deviation(const semi_axis *of) { return of->length * sqrt(variance_of(of->exponent)); }

/* Return Gamma(x + 1/2) / Gamma(x + 1) within 0.22 % for x >= 1, and exactly for x = 1. */
static double gamma_ratio(double x) { return 1 / sqrt(x - 1 + 4 / PI); }

/* Return z a E* / F for a part whose height is z ~ x^m. */
static double height_of(double m) { return (m + 1) / (2 * m) * gamma_ratio(0.5 * m) / sqrt(PI); }

static segment make_segment(double from, double to, double low, double height, bool is_first)
{
    segment out = {.from = from, .to = to, .height = height, .exponent = !is_first && height > low ? FLAT : 2};
    if (low > 0) out.exponent = fmin(fmax(log(height / low) / log(to / from), 1), FLAT);
    out.width = sqrt(sqrt(variance_of(out.exponent)));
    out.root = out.width * sqrt(to);
    out.factor = height / (8 * height_of(out.exponent) * out.width * out.width * out.root);
    return out;
}

static void find_profile(const pressed_part *of, int direction, profile *out)
{
    const pliant_part *shape = of->data->tools[of->tool].shape.part + of->part;
    const double first = fmax(of->cell / FINEST, FARTHEST * pliant_part_cell_size(shape)),
                 last = FARTHEST * fmax(of->cell, of->reach), step = pow(last / first, 1.0 / (PROFILE - 1));
    double x = first, before = 0, low = 0;
    out->count = 0;
    for (int k = 0; k < PROFILE; k++, x *= step) {
        double at, height;
        sample(of, of->tangent[direction], x, &at, &height);
        if (at > before) out->segment[out->count++] = make_segment(before, at, low, height, k == 0);
        before = at;
        low = height;
    }
}

/* Return the mean height of the contact along an axis, weighted by the pressure. */
static double mean_height(const semi_axis *of)
{
    const double m = of->exponent;
    return sqrt(PI) / 4 * gamma_ratio(0.5 * m + 0.5) * (m + 1) / (2 * m + 1) * of->height;
}

/* Return a number that grows with the length of an axis and is 1 at equilibrium, at the far end of a segment. across:
 * square root of the other axis's deviation; load: F / E* */
static double balance(const segment *in, double across, double load)
{
    const double sum = in->root + across;
    return sum * sum * sum * in->factor / load;
}

/* Find the length of an axis within a segment at equilibrium: Newton's method for log(balance) over log(length), which
 * is almost linear. */
static semi_axis find_axis_in(const segment *in, double across, double load)
{
    const double m = in->exponent, lowest = log(fmax(in->from, 1e-9 * in->to)), highest = log(in->to),
                 constant = log(in->factor * in->root / load);
    double x = highest, before = INFINITY;
    for (int n = 0; n < MAX_STEPS && fabs(x - before) > exact_logarithm; n++) {
        const double own = in->width * exp(0.5 * x), sum = own + across,
                     slope = m - 0.5 + 1.5 * own / sum; /* at least 1 / 2 */
        before = x;
        x -= (log(sum * sum * sum / own) + constant + m * (x - highest)) / slope;
        x = fmin(fmax(x, lowest), highest);
    }
    return (semi_axis){exp(x), in->height * exp(m * (x - highest)), m};
}

/* Find the length of an axis at equilibrium. Between two samples, the height is a power of the distance. */
static semi_axis find_axis(const profile *part, double other, double load)
{
    const double across = sqrt(other);
    double reached = 0;
    for (int k = 0; k < part->count; k++) {
        reached = balance(part->segment + k, across, load);
        if (reached >= 1) return find_axis_in(part->segment + k, across, load);
    }
    if (part->count == 0) return (semi_axis){0, 0, 2};
    const segment *last = part->segment + part->count - 1; /* the contact ends at the border of the part */
    return (semi_axis){last->to, last->height, fmin(last->exponent / fmax(reached, 2.0 / FLAT), FLAT)};
}

/* ---- the missing depth */

/* Return the arithmetic-geometric mean: two of its steps. */
static double mean_of(double a, double b)
{
    const double sum = sqrt(a) + sqrt(b);
    return sum * sum / 4;
}

/* Response of a half-space to a pressing part. */
typedef struct half_space {
    double depth;    /* approach: mean displacement of the surface, and mean height of the part above it [m] */
    double smoothed; /* reduction of the displacement if the mesh smooths the pressure [m] */
    double radius;   /* smaller half axis of the contact [m] */
    double weight;   /* 1: the contact is narrower than a cell, or the part is flat; 0: many cells are in contact */
} half_space;

/* resolved: radius of a contact at which half of the missing depth counts [m]; load: F / E* [m^2]; smoothing: variance
 * that the mesh adds to a smooth pressure [m^2]; axis: the axes of the contact; in: an estimate */
static half_space find_half_space(const profile part[2], double resolved, double smoothing, double load,
                                  semi_axis axis[2])
{
    double before = 0;
    for (int n = 0; n < MAX_ROUNDS && fabs(axis[1].length - before) > exact_length * before; n++) {
        before = axis[1].length;
        for (int d = 0; d < 2; d++) axis[d] = find_axis(part + d, deviation(axis + 1 - d), load);
    }
    const double s[2] = {deviation(axis), deviation(axis + 1)},
                 curved = 0.5 * (sqrt(2 / axis[0].exponent) + sqrt(2 / axis[1].exponent)),
                 kappa = kappa_sneddon + curved * (kappa_hertz - kappa_sneddon),
                 moved = kappa * load / mean_of(s[0], s[1]), radius = fmin(axis[0].length, axis[1].length),
                 ratio = radius / resolved, few = 1 / (1 + ratio * ratio * ratio * ratio);
    return (half_space){.depth = moved + mean_height(axis) + mean_height(axis + 1),
                        .smoothed = moved - kappa * load /
                                                mean_of(sqrt(s[0] * s[0] + smoothing), sqrt(s[1] * s[1] + smoothing)),
                        .radius = radius,
                        .weight = 1 - fmin(curved, 1) * (1 - few)};
}

/* Compute the same for the lattice [m].
 * @param few out: 1 for few nodes. 0 from MANY nodes on: they lack little compliance, and take much time. */
static pliant_status lattice_depth(pressed_part *of, pliant_node_loads *loads, double *depth, double *few)
{
    const pliant_contacts *contacts = &of->data->contacts;
    double response[4];
    pliant_status status = gather_loads(of, loads);
    *depth = 0;
    *few = fmin(fmax(2 - 2.0 * loads->count / MANY, 0), 1);
    if (status != PLIANT_OK || !(*few > 0)) return status;
    find_response(of->data->model->scene.element.kind == PLIANT_HEXAHEDRA, of->poisson, response);
    *depth = lattice_work(of, loads, response) / of->size * of->compliance / of->cell;
    double height = 0;
    for (int32_t p = 0; p < contacts->count; p++) {
        double local[3], below[3];
        if (!is_of(of, contacts->point + p)) continue;
        pliant_pose_from(&of->pose, contacts->point[p].place, local);
        pliant_subtract3(of->top, local, below);
        height += pliant_length3(contacts->point[p].force) / of->sum * pliant_dot3(below, of->normal);
    }
    *depth += height;
    return PLIANT_OK;
}

/* Return the fraction of the missing depth that counts. The tissue at rest below the contact must be thick enough for a
 * half-space: 0 for one cell, 1 from three cells on. */
static double known_fraction(const pressed_part *of)
{
    enum { STEPS = 6 }; /* of half a cell */
    const pliant_body *body = of->data->body;
    const double length = pliant_length3(of->outward);
    double cells = 0;
    for (int k = 0; k < STEPS; k++) {
        double at[3], weight[4];
        for (int d = 0; d < 3; d++) at[d] = of->rest[d] + 0.5 * (k + 0.5) * of->cell / length * of->outward[d];
        const int32_t tet = pliant_mesh_locate(&body->fine, at, weight);
        if (tet < 0) break;
        cells += 0.5 * body->fine_material[tet].tissue;
    }
    return fmin(fmax(0.5 * (cells - 1), 0), 1);
}

/* Return the missing depth over the force, times the present force [m]. The force at the end of the leg is predicted
 * from the distance between the proxy and its goal, as if the rest of the tissue did not yield.
 * @param radius out: smaller half axis of the contact [m] */
static double missing_depth(const pressed_part *of, const pliant_tool_pose *goal, double lattice, double *radius)
{
    const pliant_tool *tool = of->data->tools + of->tool;
    const double present = of->size * of->compliance, resolved = of->data->model->contact.resolved_radius * of->cell;
    profile part[2];
    pliant_pose target;
    double from[3], to[3], normal[3];
    for (int d = 0; d < 2; d++) find_profile(of, d, part + d);
    pliant_part_pose(&tool->shape, tool->shape.part[of->part].frame, goal->tip, goal->rotation, goal->jaw, &target);
    pliant_pose_to(&of->pose, of->top, from);
    pliant_pose_to(&target, of->top, to);
    pliant_pose_turn(&of->pose, of->normal, normal);
    const double depth = lattice + pliant_dot3(normal, to) - pliant_dot3(normal, from);
    int row;
    const double t = find_row(of->poisson, &row),
                 *rows = lattice_smoothing[of->data->model->scene.element.kind == PLIANT_HEXAHEDRA] + row,
                 smoothing = fmax(((1 - t) * rows[0] + t * rows[1]) * of->cell * of->cell + of->spread, 0);
    semi_axis axis[2] = {{of->cell, 0, 2}, {of->cell, 0, 2}};
    half_space found = find_half_space(part, resolved, smoothing, present, axis);
    double ratio = 1;
    for (int n = 0; n < MAX_PREDICTIONS && found.depth > 0; n++) {
        ratio = depth > 0 ? fmax(ratio * pow(depth / found.depth, depth_exponent), max_decrease) : max_decrease;
        found = find_half_space(part, resolved, smoothing, ratio * present, axis);
    }
    *radius = found.radius;
    const double missing = found.weight * (found.depth / ratio - lattice) + (1 - found.weight) * found.smoothed / ratio;
    return known_fraction(of) * fmax(missing, 0);
}

/* Return the sum of the torques of the part's forces about the axis of the jaws, without signs [N m]. */
static double jaw_torque(const pressed_part *of, const pliant_tool_pose *pose)
{
    const pliant_contacts *contacts = &of->data->contacts;
    double joint[3], axis[3], sum = 0;
    pliant_tool_joint(of->data->tools + of->tool, pose, joint, axis);
    for (int32_t p = 0; p < contacts->count; p++) {
        const pliant_contact_point *point = contacts->point + p;
        double lever[3], torque[3];
        if (!is_of(of, point)) continue;
        pliant_subtract3(point->place, joint, lever);
        pliant_cross3(lever, point->force, torque);
        sum += fabs(0.5 * point->jaw * pliant_dot3(axis, torque));
    }
    return sum;
}

pliant_status pliant_missing_compliance(const pliant_data *data, int tool, const pliant_tool_pose *pose,
                                        const pliant_tool_pose *goal, pliant_node_loads *buffer,
                                        pliant_missing_depth *out)
{
    /* of all parts, and of the parts on jaws [N m]; forces [N]; torques on the jaws [N m] */
    double work[2] = {0, 0}, formed = 0, sum = 0, total[3] = {0, 0, 0}, torque = 0;
    *out = (pliant_missing_depth){.fraction = 1};
    const pliant_mesh *mesh = pliant_felt_mesh(data, tool);
    if (!pliant_adds_missing_compliance(data, tool)) return PLIANT_OK;
    for (int32_t p = 0; p < data->tools[tool].shape.num_parts && data->contacts.count > 0; p++) {
        pressed_part part = {.data = data, .mesh = mesh, .tool = tool, .part = p};
        double lattice, few, radius = 0;
        if (!find_contact(pose, &part)) continue;
        find_tangents(&part);
        const pliant_status status = lattice_depth(&part, buffer, &lattice, &few);
        if (status != PLIANT_OK) return status;
        const double missing = few > 0 ? few * missing_depth(&part, goal, lattice, &radius) * part.size : 0;
        if (radius > 0 && !(out->cells > 0 && out->cells < radius / part.cell)) out->cells = radius / part.cell;
        sum += part.size;
        for (int d = 0; d < 3; d++) total[d] += part.force[d];
        work[0] += missing;
        formed += fmax(lattice, 0) * part.size;
        if (data->tools[tool].shape.part[p].frame == PLIANT_FRAME_TIP) continue;
        work[1] += missing;
        torque += jaw_torque(&part, pose);
    }
    if (!(sum > 0)) return PLIANT_OK;
    const double net = fmin(pliant_length3(total) / sum, 1);
    out->fraction = work[0] > 0 ? work[0] / (work[0] + formed) : 0;
    out->compliance = work[0] / (sum * sum);
    if (torque > 0) out->jaw_compliance = work[1] / (torque * torque) * (1 - net * net);
    return PLIANT_OK;
}
