#include "fem/rigid/rigid.h"

#include "base/matrix.h"
#include "base/vector3.h"

#include <string.h>

enum {
    DIRECTIONS = PLIANT_RIGID_DIRECTIONS,
    MAX_CONTACTS = PLIANT_MAX_WALLS * (DIRECTIONS + 1),
    ITERATIONS = 30,
    MAX_SUBSTEPS = 100
};

static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};

/* ---- Vectors and 3 x 3 matrices. */

static void apply(const double m[9], const double v[3], double out[3])
{
    for (int r = 0; r < 3; r++) out[r] = pliant_dot3(m + 3 * r, v);
}

/* Compute out = a b, or a b'. */
static void multiply(const double a[9], const double b[9], bool transposed, double out[9])
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            double sum = 0;
            for (int k = 0; k < 3; k++) sum += a[3 * r + k] * (transposed ? b[3 * c + k] : b[3 * k + c]);
            out[3 * r + c] = sum;
        }
}

/* Invert a matrix by cofactors. A singular matrix gives 0. */
static void invert(const double m[9], double out[9])
{
    const double determinant = pliant_determinant(m);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            const double *a = m + 3 * ((c + 1) % 3), *b = m + 3 * ((c + 2) % 3);
            const double cofactor = a[(r + 1) % 3] * b[(r + 2) % 3] - a[(r + 2) % 3] * b[(r + 1) % 3];
            out[3 * r + c] = determinant != 0 ? cofactor / determinant : 0;
        }
}

void pliant_rigid_turn(const double angle[3], const double m[9], double out[9])
{
    const double square = pliant_dot3(angle, angle), size = sqrt(square);
    const double s = size > 1e-6 ? sin(size) / size : 1 - square / 6, c = size > 1e-6 ? (1 - cos(size)) / square : 0.5;
    const double k[9] = {0, -angle[2], angle[1], angle[2], 0, -angle[0], -angle[1], angle[0], 0};
    double squared[9], rotation[9];
    multiply(k, k, false, squared);
    for (int i = 0; i < 9; i++) rotation[i] = identity[i] + s * k[i] + c * squared[i];
    multiply(rotation, m, false, out);
}

/* ---- One sub-step. */

typedef struct moving {
    double inverse_mass, inverse_inertia[9]; /* inverse_inertia: in the middle of the sub-step */
    double velocity[3], spin[3];
} moving;

typedef struct contact {
    const double *normal;
    double arm[3], towards;      /* minimum normal velocity [m/s] */
    double normal_impulse, along[3];
} contact;

static void velocity_at(const moving *now, const double arm[3], double out[3])
{
    pliant_cross3(now->spin, arm, out);
    for (int d = 0; d < 3; d++) out[d] += now->velocity[d];
}

static void push(moving *now, const double arm[3], const double impulse[3])
{
    double torque[3], spin[3];
    pliant_cross3(arm, impulse, torque);
    apply(now->inverse_inertia, torque, spin);
    for (int d = 0; d < 3; d++) {
        now->velocity[d] += now->inverse_mass * impulse[d];
        now->spin[d] += spin[d];
    }
}

/* Compute the velocity change of a point per impulse: I / m - [r] J^-1 [r]. */
static void answer(const moving *now, const double arm[3], double out[9])
{
    for (int c = 0; c < 3; c++) {
        const double unit[3] = {c == 0, c == 1, c == 2};
        double torque[3], spin[3], velocity[3];
        pliant_cross3(arm, unit, torque);
        apply(now->inverse_inertia, torque, spin);
        pliant_cross3(spin, arm, velocity);
        for (int r = 0; r < 3; r++) out[3 * r + c] = velocity[r] + (r == c) * now->inverse_mass;
    }
}

/* A spring of compliance c over a step h has the impulse p:  c p / h = target - y - h v+,  v+ = v + A p. */
typedef struct spring { double arm[3], gap[3], soft, solved[9], impulse[3]; } spring;

static void set_spring(const moving *now, const pliant_rigid_pull *pull, const double arm[3], const double at[3],
                       const double before[3], const double target[3], double step, spring *out)
{
    const double stiffness = pull->compliance > 0 ? 1 / pull->compliance : 0,
                 damper = stiffness > 0 ? pull->damping / step : 0;
    const double none[3] = {0, 0, 0};
    double a[9];
    memcpy(out->arm, arm, sizeof out->arm);
    memset(out->impulse, 0, sizeof out->impulse);
    pliant_substep_gap(stiffness, damper, 0, target, before, at, at, none, none, out->gap);
    answer(now, arm, a);
    const double rigid = 1e-3 * (a[0] + a[4] + a[8]) / 3; /* keeps forces finite if a wall blocks a rigid pull */
    out->soft = stiffness > 0 ? fmax(1 / ((stiffness + damper) * step * step), rigid) : rigid;
    for (int d = 0; d < 3; d++) {
        out->gap[d] /= step;
        a[4 * d] += out->soft;
    }
    invert(a, out->solved);
}

static void pull_on(moving *now, spring *with)
{
    double velocity[3], missing[3], impulse[3];
    velocity_at(now, with->arm, velocity);
    for (int d = 0; d < 3; d++) missing[d] = with->gap[d] - velocity[d] - with->soft * with->impulse[d];
    apply(with->solved, missing, impulse);
    for (int d = 0; d < 3; d++) with->impulse[d] += impulse[d];
    push(now, with->arm, impulse);
}

static void press(moving *now, contact *at, double friction)
{
    double velocity[3], a[9], answered[3], impulse[3];
    answer(now, at->arm, a);
    velocity_at(now, at->arm, velocity);
    apply(a, at->normal, answered);
    double more = (at->towards - pliant_dot3(velocity, at->normal)) / pliant_dot3(at->normal, answered);
    more = fmax(more, -at->normal_impulse);
    at->normal_impulse += more;
    for (int d = 0; d < 3; d++) impulse[d] = more * at->normal[d];
    push(now, at->arm, impulse);

    double direction[3], kept[3];
    velocity_at(now, at->arm, velocity);
    const double normal = pliant_dot3(velocity, at->normal);
    for (int d = 0; d < 3; d++) velocity[d] -= normal * at->normal[d];
    const double speed = pliant_length3(velocity);
    memcpy(kept, at->along, sizeof kept);
    for (int d = 0; d < 3 && speed > 0; d++) direction[d] = velocity[d] / speed;
    if (speed > 0) {
        apply(a, direction, answered);
        for (int d = 0; d < 3; d++) at->along[d] -= speed / pliant_dot3(direction, answered) * direction[d];
    }
    const double size = pliant_length3(at->along), maximum = friction * at->normal_impulse;
    for (int d = 0; d < 3; d++) {
        if (size > maximum) at->along[d] *= maximum / size;
        impulse[d] = at->along[d] - kept[d];
    }
    push(now, at->arm, impulse);
}

void pliant_rigid_choose(const double normal[3], pliant_rigid_choice *choice)
{
    double axis[3] = {0, 0, 0};
    axis[fabs(normal[0]) < 0.6 ? 0 : 1] = 1;
    pliant_cross3(normal, axis, choice->side);
    pliant_cross3(normal, choice->side, choice->up);
    for (int k = 0; k <= DIRECTIONS; k++) {
        choice->chosen[k] = -1;
        choice->maximum[k] = -INFINITY;
    }
}

void pliant_rigid_consider(pliant_rigid_choice *choice, int32_t point, const double arm[3], double gap)
{
    for (int k = 0; k <= DIRECTIONS; k++) {
        const double angle = 0.78539816339744831 * k, far = k == DIRECTIONS
                                                                ? -gap
                                                                : cos(angle) * pliant_dot3(choice->side, arm) +
                                                                      sin(angle) * pliant_dot3(choice->up, arm);
        if (far <= choice->maximum[k]) continue;
        choice->maximum[k] = far;
        choice->chosen[k] = point;
    }
}

int pliant_rigid_chosen(const pliant_rigid_choice *choice, int32_t out[DIRECTIONS + 1])
{
    int count = 0;
    for (int k = 0; k <= DIRECTIONS; k++) {
        bool again = choice->chosen[k] < 0;
        for (int before = 0; before < k; before++) again = again || choice->chosen[before] == choice->chosen[k];
        if (!again) out[count++] = choice->chosen[k];
    }
    return count;
}

/* Choose a few of the points that would pass through a wall. */
static int find_contacts(const pliant_rigid *body, const moving *now, const double gravity[3], double step,
                         const pliant_rigid_walls *around, contact *out)
{
    int count = 0;
    /* [m/s] resting bodies have such speeds and must not bounce */
    const double slow = 4 * step * pliant_length3(gravity);
    for (int w = 0; w < around->count; w++) {
        const pliant_wall *wall = around->walls + w;
        pliant_rigid_choice choice;
        int32_t chosen[DIRECTIONS + 1];
        pliant_rigid_choose(wall->normal, &choice);
        for (int32_t p = 0; p < around->num_points; p++) {
            double arm[3], velocity[3];
            apply(body->rotation, around->arm + 3 * p, arm);
            velocity_at(now, arm, velocity);
            const double gap = pliant_dot3(wall->normal, body->centre) + pliant_dot3(wall->normal, arm) - wall->offset,
                         ahead = gap + step * pliant_dot3(wall->normal, velocity);
            if (ahead < 0) pliant_rigid_consider(&choice, p, arm, ahead);
        }
        const int num_chosen = pliant_rigid_chosen(&choice, chosen);
        for (int k = 0; k < num_chosen; k++) {
            contact *at = out + count++;
            memset(at, 0, sizeof *at);
            at->normal = wall->normal;
            double velocity[3];
            apply(body->rotation, around->arm + 3 * chosen[k], at->arm);
            velocity_at(now, at->arm, velocity);
            const double gap = pliant_dot3(wall->normal, body->centre) + pliant_dot3(wall->normal, at->arm) -
                               wall->offset,
                         speed = pliant_dot3(wall->normal, velocity);
            at->towards =
                around->restitution > 0 && speed < -slow ? -around->restitution * speed : fmin(-gap / step, 0);
        }
    }
    return count;
}

static void middle_of(const pliant_rigid *body, const double inverse[9], double step, moving *out)
{
    double rotation[9], half[9];
    memcpy(rotation, body->rotation, sizeof rotation);
    for (int pass = 0; pass < 4; pass++) {
        double angle[3];
        multiply(rotation, inverse, false, half);
        multiply(half, rotation, true, out->inverse_inertia);
        apply(out->inverse_inertia, body->momentum, out->spin);
        for (int d = 0; d < 3; d++) angle[d] = 0.5 * step * out->spin[d];
        pliant_rigid_turn(angle, body->rotation, rotation);
    }
}

/* Run one sub-step. part: its end in the step, from 0 to 1; length: of the sub-step as a fraction. */
static bool substep(pliant_rigid *body, const double inverse[9], const double gravity[3], double step, double part,
                    double length, int num_pulls, pliant_rigid_pull *pulls, const pliant_rigid_walls *around)
{
    moving now = {.inverse_mass = 1 / body->mass};
    spring springs[PLIANT_RIGID_PULLS];
    contact contacts[MAX_CONTACTS];
    double angle[3];
    middle_of(body, inverse, step, &now);
    for (int d = 0; d < 3; d++) now.velocity[d] = body->velocity[d] + 0.5 * step * gravity[d];
    const moving before_pulls = now;
    for (int p = 0; p < num_pulls; p++) {
        pliant_rigid_pull *pull = pulls + p;
        double arm[3], at[3], target[3], old[3], impulse[3];
        apply(body->rotation, pull->arm, arm);
        for (int d = 0; d < 3; d++) {
            at[d] = body->centre[d] + arm[d];
            target[d] = pull->from[d] + part * (pull->to[d] - pull->from[d]);
            old[d] = pull->from[d] + (part - length) * (pull->to[d] - pull->from[d]);
            impulse[d] = step * pull->force[d];
        }
        if (!pull->is_force) {
            set_spring(&before_pulls, pull, arm, at, old, target, step, springs + p);
            continue;
        }
        push(&now, arm, impulse);
        for (int d = 0; d < 3; d++) pull->impulse[d] += impulse[d];
    }
    const int num_contacts = find_contacts(body, &now, gravity, step, around, contacts);
    for (int pass = 0; pass < (num_pulls + num_contacts > 0 ? ITERATIONS : 0); pass++) {
        for (int p = 0; p < num_pulls; p++)
            if (!pulls[p].is_force) pull_on(&now, springs + p);
        for (int c = 0; c < num_contacts; c++) press(&now, contacts + c, around->friction);
    }
    for (int p = 0; p < num_pulls; p++)
        for (int d = 0; d < 3 && !pulls[p].is_force; d++) pulls[p].impulse[d] += springs[p].impulse[d];

    double inertia[9], rotation[9];
    invert(now.inverse_inertia, inertia);
    for (int d = 0; d < 3; d++) {
        body->centre[d] += step * now.velocity[d];
        body->velocity[d] = now.velocity[d] + 0.5 * step * gravity[d];
        angle[d] = step * now.spin[d];
    }
    /* Without torques the momentum stays bitwise identical. */
    if (num_pulls + num_contacts > 0) apply(inertia, now.spin, body->momentum);
    pliant_rigid_turn(angle, body->rotation, rotation);
    memcpy(body->rotation, rotation, sizeof rotation);
    return num_contacts > 0;
}

/* ---- A step. */

static void inverse_of(const pliant_rigid *body, double out[9])
{
    double whole[9];
    memcpy(whole, body->inertia, sizeof whole);
    const double trace = whole[0] + whole[4] + whole[8];
    for (int d = 0; d < 3; d++) whole[4 * d] += 1e-9 * trace; /* of a needle */
    invert(whole, out);
}

void pliant_rigid_spin(const pliant_rigid *body, double out[3])
{
    double inverse[9];
    inverse_of(body, inverse);
    apply(inverse, body->momentum, out);
}

bool pliant_rigid_step(pliant_rigid *body, const double gravity[3], double time, int num_pulls,
                       pliant_rigid_pull *pulls, const pliant_rigid_walls *around)
{
    const double longest = 2e-3, largest = 0.05; /* [s, rad] maximum of a sub-step: duration with contact; rotation */
    double inverse[9], spin[3];
    bool has_touched = false;
    inverse_of(body, inverse);
    apply(inverse, body->momentum, spin);
    memcpy(body->rotation, identity, sizeof identity);
    for (int p = 0; p < num_pulls; p++) memset(pulls[p].impulse, 0, sizeof pulls[p].impulse);
    double parts = fmax(1, ceil(pliant_length3(spin) * time / largest));
    if (num_pulls > 0 || around->num_points > 0) parts = fmax(parts, ceil(time / longest - 1e-9));
    const int count = (int)fmin(parts, MAX_SUBSTEPS);
    /* A hanging body does not move. Its velocity is the velocity in the middle of sub-steps, where springs balance the
     * complete weight. */
    const double ahead = num_pulls > 0 ? 0.5 * time / count : 0;
    for (int d = 0; d < 3; d++) body->velocity[d] += ahead * gravity[d];
    for (int s = 0; s < count; s++)
        has_touched |=
            substep(body, inverse, gravity, time / count, (s + 1.0) / count, 1.0 / count, num_pulls, pulls, around);
    for (int d = 0; d < 3; d++) body->velocity[d] -= ahead * gravity[d];
    return has_touched;
}
