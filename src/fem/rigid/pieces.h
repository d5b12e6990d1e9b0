/* What is known of pieces that have come off, for those who move them. */
#ifndef PLIANT_FEM_FALLING_PIECES_H
#define PLIANT_FEM_FALLING_PIECES_H

#include "fem/rigid/falling.h"
#include "fem/rigid/rigid.h"

#ifdef __cplusplus
extern "C" {
#endif

/* of a piece */
typedef struct piece {
    double velocity[3], momentum[3]; /* as in rigid.h */
    double quiet;                    /* for how long it has hardly moved on a wall [s] */
    bool rests, gone;                /* until something pulls at it; the latter: where nobody sees it */
    bool shaped;                     /* has its shape at rest */
    bool touched;                    /* is near something in this step */
    bool meets;                      /* may meet a tool in it */
    bool walled;                     /* its points on walls are among those of the step */
    double way;                      /* that its nodes go in this step at most, if nothing touches it [m] */
} piece;

/* A tool's part in a piece. */
typedef struct grip {
    int tool, piece;
    uint64_t hold;
    double share;                    /* of the tool's weights */
    double apart[3];                 /* the piece's held point minus that of the whole hold, when they were first seen together [m] */
    double last[3];                  /* where it was pulled to in the last step [m] */
    double point[3];                 /* the piece's held point [m] */
} grip;

enum { MOST_GRIPS = 8 * PLIANT_MAX_TOOLS };

struct pliant_falling {
    const pliant_body *body;
    double whole, step;              /* of the scene; of the part of it that is at hand [s] */
    pliant_wall walls[PLIANT_MAX_WALLS];
    int num_walls;
    double friction, restitution;
    double low[3], high[3];          /* what is beyond is not drawn [m] */
    bool told;
    piece *pieces;                   /* (body->pieces->count) */
    double *x, *home;                /* (nodes of pieces x 3) now, and when they came off [m] */
    int32_t *place;                  /* (fine nodes) in the list of nodes of pieces, or -1 */
    int32_t *piece_of;               /* (nodes of pieces) */
    int32_t *triangle_start, *triangle; /* (pieces + 1), surface triangles of the body, by piece */
    double *node_area;               /* (nodes of the largest piece) buffer [m^2] */
    double (*joint_at)[3];           /* (joints) where it hung in the last step [m] */
    double gravity[3];               /* of the last step */
    grip grips[MOST_GRIPS];
    int num_grips;
    double *arms, *near_walls;       /* (nodes of the largest piece x 3) room */
    int32_t *of_node;                /* (fine nodes) which piece, or -1 */
    pliant_touch_piece *touch;       /* (body->pieces->count) */
    pliant_touch_pieces together;  /* these two */
};

static inline void pliant_falling_set_step(pliant_falling *falling, const pliant_data *data) { falling->step = falling->whole * data->share; }

/* ---- grips.c */
/* As a rigid body, as the step begins. */
void pliant_falling_rigid(const pliant_falling *falling, int32_t p, pliant_rigid *out);
/* Of a piece, up to PLIANT_MAX_TOOLS. @return how many */
int pliant_falling_grips(pliant_falling *falling, int32_t p, grip **out);
/* What tools and joints pull it with in this step. @return how many */
int pliant_falling_pulls(const pliant_falling *falling, const pliant_data *data, int32_t p, const double centre[3], int num_grips, grip *const *grips,
                         pliant_rigid_pull pulls[PLIANT_RIGID_PULLS]);
/* Tools that hold nodes of pieces, with the pieces' held points. */
void pliant_falling_find_grips(pliant_falling *falling, const pliant_data *data);

/* ---- touched.c */
/* A step of one that is near something: what pulls at it and what touches it act where the step ends. */
void pliant_falling_move_touched(const pliant_falling *falling, const pliant_data *data, int32_t p, pliant_rigid *body, int num_pulls, pliant_rigid_pull *pulls);

#ifdef __cplusplus
}
#endif
#endif
