/* State of the detached pieces, for the files that move them. */
#ifndef PLIANT_FEM_RIGID_RIGID_PIECES_DATA_H
#define PLIANT_FEM_RIGID_RIGID_PIECES_DATA_H

#include "fem/rigid/rigid_pieces.h"
#include "fem/rigid/rigid.h"

#ifdef __cplusplus
extern "C" {
#endif

/* State of one piece. */
typedef struct piece {
    double velocity[3], momentum[3]; /* as in rigid.h */
    double rest_time;                /* time for which it has hardly moved on a wall [s] */
    bool is_at_rest, has_left_view;  /* at rest until a force acts; outside of the drawn region */
    bool has_rest_shape;             /* has its shape at rest */
    bool is_near_wall;               /* near an obstacle in this step */
    bool may_touch_tool;             /* may touch a tool in this step */
    bool has_wall_points;            /* its points on walls are contact points of the step */
    double max_motion;               /* maximum motion of its nodes in this step without contact [m] */
} piece;

/* Part of a tool's grasp that holds nodes of a piece. */
typedef struct grip {
    int tool, piece;
    uint64_t hold;
    double fraction;                    /* fraction of the tool's weights */
    /* Offset of the piece's held point from the held point of the whole grasp, at the start of the grasp [m]. */
    double offset[3];
    double last[3];                  /* target in the last step [m] */
    double point[3];                 /* the piece's held point [m] */
} grip;

enum { MAX_GRIPS = 8 * PLIANT_MAX_TOOLS };

struct pliant_rigid_pieces {
    const pliant_body *body;
    double whole, step;              /* step of the scene; present part of it [s] */
    pliant_wall walls[PLIANT_MAX_WALLS];
    int num_walls;
    double friction, restitution;
    double low[3], high[3];          /* bounds of the drawn region [m] */
    bool reported;
    piece *pieces;                   /* (body->pieces->count) */
    double *x,
        *detachment_positions;       /* (nodes of pieces x 3) present positions, and positions when they detached [m] */
    int32_t *place;                  /* (fine nodes) index in the list of nodes of pieces, or -1 */
    int32_t *piece_of;               /* (nodes of pieces) */
    int32_t *triangle_start, *triangle; /* (pieces + 1), surface triangles of the body, by piece */
    double *node_area;               /* (nodes of the largest piece) buffer [m^2] */
    double (*joint_at)[3];           /* (joints) attachment positions in the last step [m] */
    double gravity[3];               /* of the last step */
    grip grips[MAX_GRIPS];
    int num_grips;
    double *arms, *near_walls;         /* (nodes of the largest piece x 3) work arrays */
    int32_t *of_node;                  /* (fine nodes) piece, or -1 */
    pliant_contact_body *contact_body; /* (body->pieces->count) */
    pliant_contact_bodies together;    /* view of the two arrays above */
};

static inline void pliant_rigid_pieces_set_step(pliant_rigid_pieces *rigid_pieces, const pliant_data *data)
{
    rigid_pieces->step = rigid_pieces->whole * data->fraction;
}

/* ---- Implemented in piece_pulls.c. */
/* Compute the rigid body of a piece at the start of the step. */
void pliant_rigid_pieces_body(const pliant_rigid_pieces *rigid_pieces, int32_t p, pliant_rigid *out);
/* List the grips of a piece, up to PLIANT_MAX_TOOLS.
 * @return Their number. */
int pliant_rigid_pieces_grips(pliant_rigid_pieces *rigid_pieces, int32_t p, grip **out);
/* List the forces and springs of tools and joints that act on the piece in this step.
 * @return Their number. */
int pliant_rigid_pieces_pulls(const pliant_rigid_pieces *rigid_pieces, const pliant_data *data, int32_t p,
                              const double centre[3], int num_grips, grip *const *grips,
                              pliant_rigid_pull pulls[PLIANT_RIGID_PULLS]);
/* Find the tools that hold nodes of pieces, with the pieces' held points. */
void pliant_rigid_pieces_find_grips(pliant_rigid_pieces *rigid_pieces, const pliant_data *data);

/* ---- Implemented in piece_contact.c. */
/* Move a piece with contact by one step. All pulls and contact forces act at the end of the step. */
void pliant_rigid_pieces_move_in_contact(const pliant_rigid_pieces *rigid_pieces, const pliant_data *data, int32_t p,
                                         pliant_rigid *body, int num_pulls, pliant_rigid_pull *pulls);

#ifdef __cplusplus
}
#endif
#endif
