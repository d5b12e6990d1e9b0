/* A rigid body through a step: it flies, is pulled at points, and lies on walls.
 *
 * Velocity Verlet for the centre, exact under gravity; the implicit midpoint rule for the turning, which keeps the
 * angular momentum and, without torques, the energy (Hairer, Lubich and Wanner, Geometric Numerical Integration,
 * VII.5). Springs act at the end of a sub-step: any stiffness is stable. Walls take impulses at the points that would
 * go through them, with Coulomb's friction, by Gauss and Seidel's iteration (Catto, Iterative dynamics with temporal
 * coherence, 2005). */
#ifndef PLIANT_FEM_FALLING_RIGID_H
#define PLIANT_FEM_FALLING_RIGID_H

#include "fem/dynamics/substep.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_RIGID_PULLS = 2 * PLIANT_MAX_TOOLS }; /* at most at one body: tools, and what it hangs on */

typedef struct pliant_rigid {
    double mass, inertia[9];  /* about the centre, at the start of the step [kg, kg m^2] */
    double centre[3];         /* [m] */
    double rotation[9];       /* since the start of the step */
    double velocity[3], momentum[3]; /* of the centre [m/s]; angular, about it [kg m^2/s] */
} pliant_rigid;

/* What pulls at a point of it. */
typedef struct pliant_rigid_pull {
    double arm[3];            /* from the centre to the point, at the start of the step [m] */
    bool given;               /* a force, no spring */
    double force[3];          /* that [N] */
    double compliance;        /* of the spring [m/N]; 0: rigid */
    double damping;           /* beside it [N s/m] */
    double from[3], to[3];    /* where it pulls to when the step begins and ends [m] */
    double impulse[3];        /* out: on the body, over the step [N s] */
} pliant_rigid_pull;

typedef struct pliant_rigid_walls {
    const pliant_wall *walls;
    int count;
    double friction, restitution;
    int32_t num_points;       /* of the body that may get to a wall in this step */
    const double *arm;        /* (num_points x 3) as above */
} pliant_rigid_walls;

/* true: it has touched a wall */
bool pliant_rigid_step(pliant_rigid *body, const double gravity[3], double time, int num_pulls, pliant_rigid_pull *pulls,
                       const pliant_rigid_walls *around);
/* out = exp(angle) m, by Rodrigues' formula [rad] */
void pliant_rigid_turn(const double angle[3], const double m[9], double out[9]);

enum { PLIANT_RIGID_DIRECTIONS = 8 };
/* Of points before a wall those that carry a body as well as all do: the one that is nearest to it or deepest in it,
 * and those farthest out along it. */
typedef struct pliant_rigid_choice {
    double side[3], up[3], most[PLIANT_RIGID_DIRECTIONS + 1];
    int32_t chosen[PLIANT_RIGID_DIRECTIONS + 1]; /* -1: none */
} pliant_rigid_choice;
void pliant_rigid_choose(const double normal[3], pliant_rigid_choice *choice);
/* One more, this far out from the body's centre and before the wall. */
void pliant_rigid_offer(pliant_rigid_choice *choice, int32_t point, const double arm[3], double gap);
/* Each once. @return how many */
int pliant_rigid_chosen(const pliant_rigid_choice *choice, int32_t out[PLIANT_RIGID_DIRECTIONS + 1]);

/* inverse (inertia at the start of the step) times the angular momentum [rad/s] */
void pliant_rigid_spin(const pliant_rigid *body, double out[3]);

#ifdef __cplusplus
}
#endif
#endif
