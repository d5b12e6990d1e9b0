/* A rigid body during a step: free flight, pulls at points, and contact with walls.
 *
 * The centre moves by velocity Verlet, which is exact under gravity. The rotation uses the implicit midpoint rule,
 * which conserves the angular momentum and, without torques, the energy (Hairer, Lubich and Wanner, Geometric Numerical
 * Integration, VII.5). Springs act at the end of a sub-step, which is stable for any stiffness. Walls apply impulses at
 * penetrating points, with Coulomb friction, by Gauss-Seidel iteration (Catto, Iterative dynamics with temporal
 * coherence, 2005). */
#ifndef PLIANT_FEM_RIGID_RIGID_H
#define PLIANT_FEM_RIGID_RIGID_H

#include "fem/dynamics/substep.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_RIGID_PULLS = 2 * PLIANT_MAX_TOOLS }; /* maximum per body: tools and joints */

typedef struct pliant_rigid {
    double mass, inertia[9];  /* about the centre, at the start of the step [kg, kg m^2] */
    double centre[3];         /* [m] */
    double rotation[9];       /* relative to the start of the step */
    double velocity[3], momentum[3]; /* of the centre [m/s]; angular, about it [kg m^2/s] */
} pliant_rigid;

/* A force or spring that acts at a point of the body. */
typedef struct pliant_rigid_pull {
    double arm[3];         /* from the centre to the point, at the start of the step [m] */
    bool is_force;         /* true: a given force; false: a spring */
    double force[3];       /* given force [N] */
    double compliance;     /* of the spring [m/N]; 0: rigid */
    double damping;        /* parallel to the spring [N s/m] */
    double from[3], to[3]; /* targets of the spring at the start and end of the step [m] */
    double impulse[3];     /* out: on the body, over the step [N s] */
} pliant_rigid_pull;

typedef struct pliant_rigid_walls {
    const pliant_wall *walls;
    int count;
    double friction, restitution;
    int32_t num_points;       /* points of the body that may reach a wall in this step */
    const double *arm;        /* (num_points x 3) as above */
} pliant_rigid_walls;

/* Move the body by one step. Return true if it has touched a wall. */
bool pliant_rigid_step(pliant_rigid *body, const double gravity[3], double time, int num_pulls,
                       pliant_rigid_pull *pulls, const pliant_rigid_walls *around);
/* Compute out = exp(angle) m, by Rodrigues' formula [rad]. */
void pliant_rigid_turn(const double angle[3], const double m[9], double out[9]);

enum { PLIANT_RIGID_DIRECTIONS = 8 };
/* Choice of contact points in front of a wall: the deepest or nearest point, and the extreme points along the wall.
 * These few points support a body as well as all points. */
typedef struct pliant_rigid_choice {
    double side[3], up[3], maximum[PLIANT_RIGID_DIRECTIONS + 1];
    int32_t chosen[PLIANT_RIGID_DIRECTIONS + 1]; /* -1: none */
} pliant_rigid_choice;
void pliant_rigid_choose(const double normal[3], pliant_rigid_choice *choice);
/* Add a candidate with this arm from the body's centre and this distance to the wall. */
void pliant_rigid_consider(pliant_rigid_choice *choice, int32_t point, const double arm[3], double gap);
/* List the chosen points, each once.
 * @return Their number. */
int pliant_rigid_chosen(const pliant_rigid_choice *choice, int32_t out[PLIANT_RIGID_DIRECTIONS + 1]);

/* Compute the angular velocity: inverse of the present inertia times the angular momentum [rad/s]. */
void pliant_rigid_spin(const pliant_rigid *body, double out[3]);

#ifdef __cplusplus
}
#endif
#endif
