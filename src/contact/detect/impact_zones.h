/* Keep tissue out of tissue in each sub-step of explicit dynamics.
 *
 * A sub-step moves all nodes along straight lines. The pairs of the surface that are near each other are listed once
 * per leg, with a margin for their motion. The list is made again when that margin is used up. A pair is measured
 * only when the motion since its last measurement could bring it near the distance that all pairs keep.
 *
 * If a pair would come nearer, an impulse along the line between its closest points reduces its approach to the
 * fraction that is free. Where several rounds of impulses do not suffice, the nodes of the pairs form impact zones
 * (Bridson, Fedkiw, Anderson, ACM Trans. Graph. 21(3):594, 2002). The motion of a zone relative to its center of mass
 * takes the largest free fraction. So both keep the momentum of free tissue. A zone with a fixed node has no mean
 * motion: the support takes its momentum.
 *
 * Less kinetic energy is not enough, since central differences conserve another energy (fem/dynamics/tled_energy.c).
 * For a sub-step h at the displacements u it is (d - c)' M (d - c) / 2 h^2 plus a constant. Here d are the increments,
 * and c = h^2 a / 2 follows from the accelerations a without contact. So d - c is h times the velocity at u. Impulses
 * never lengthen it in the norm of the mass. Zones can, where they stop tissue that its strain accelerates. They then
 * lose as much of their velocities. */
#ifndef PLIANT_CONTACT_IMPACT_ZONES_H
#define PLIANT_CONTACT_IMPACT_ZONES_H

#include "contact/detect/contact_surface.h"
#include "contact/detect/tissue.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A listed pair. */
typedef struct pliant_impact_pair {
    int32_t index; /* into the advance's pairs */
    double thickness; /* negative: not known yet [m] */
    double gap;       /* when the pairs were listed: distance beyond the smallest one; valid with a thickness [m] */
    double slack;     /* motion at which the pair can come too near; a lower bound [m] */
} pliant_impact_pair;

typedef struct pliant_impact_zone {
    double mass;                               /* [kg] */
    double motion[3], increment[3], center[3]; /* mass-weighted sums, later means [m] */
    double t;                             /* fraction of the relative motion */
    double gain, energy;                  /* 2 h^2 times the energy that t adds; the same of the velocities [J s^2] */
    double kept;                          /* fraction of the relative velocities */
    bool is_fixed;                        /* it contains a fixed node */
} pliant_impact_zone;

/* All zero: nothing is kept apart. */
typedef struct pliant_impact_zones {
    pliant_tissue *tissue;                 /* borrowed, for a frame */
    const pliant_contact_surface *surface; /* Nullable: the mesh's own surface; borrowed, for a frame */
    pliant_tissue_rule rule;
    double motion; /* bound of the motion of two points relative to each other since the pairs were listed [m] */
    double next;   /* smallest slack [m] */
    int32_t num_pairs, num_blocked, max_blocked;
    pliant_impact_pair *pair;
    int32_t *blocked;         /* indices into pair */
    double *start;            /* (nodes x 3) displacements when the pairs were listed [m] */
    double *before;           /* (nodes x 3) displacements before the sub-step [m] */
    double *center;           /* (nodes x 3) increments of least energy (pliant_impact_zones_accelerate) [m] */
    double *wanted[2];        /* (nodes x 3) displacements and increments without zones [m] */
    double *from, *to;        /* (nodes x 3) surface before and after the sub-step, of measured pairs [m] */
    int32_t *root;            /* (nodes) disjoint sets; -1: in no zone */
    pliant_impact_zone *zone; /* (nodes) at the roots */
    pliant_status status;     /* of a sub-step: MEMORY */
    bool is_too_fast;         /* the sub-step moved nodes so far that it is not stable, and its pairs are not checked */
} pliant_impact_zones;

void pliant_impact_zones_free(pliant_impact_zones *zones); /* frees its contents */
/* Set the pairs of a leg: the pairs that pliant_tissue_find has listed by this rule. Errors: MEMORY.
 * @param surface Nullable: the mesh's own surface. It is borrowed, as the tissue is, for the leg. */
pliant_status pliant_impact_zones_set(pliant_impact_zones *zones, pliant_tissue *tissue,
                                      const pliant_contact_surface *surface, const pliant_tissue_rule *rule);
/* Start the sub-steps of the leg, again after a rollback. u: (nodes x 3) displacements [m] */
void pliant_impact_zones_begin(pliant_impact_zones *zones, const double *u);
/* Set the accelerations in a sub-step before contact changes them.
 * @param step duration of the sub-step [s]
 * @param acceleration (nodes x 3) [m/s^2] */
void pliant_impact_zones_accelerate(pliant_impact_zones *zones, double step, const double *acceleration);
/* Change the motion of a sub-step so that no pair comes too near. Errors: zones->status.
 * @param u, d (nodes x 3) displacements and increments after the sub-step [m] */
void pliant_impact_zones_limit(pliant_impact_zones *zones, const double *inverse_mass, double *u, double *d);

#ifdef __cplusplus
}
#endif

#endif
