/* What is solved: elements, the nodes that move, the pattern of the matrix, how the fine nodes follow.
 *
 * Unknowns are the free nodes of the solved mesh (fine or coarse), three numbers each. Corotational elastic force of an
 * element: f = R K (R' x - X) (Mueller and Gross 2004); [H] 2.2 uses the same with homogenized K. */
#ifndef PLIANT_FEM_SYSTEM_H
#define PLIANT_FEM_SYSTEM_H

#include "base/lanes.h"
#include "state/model.h"

/* What a step says whose merit is not finite: everything that is checked one by one has been finite before. */
#define PLIANT_LOAD_NOT_FINITE \
    "the load is not finite, or too large for double precision: look at model/gravity, density in the material table, grasp/stiffness, and the forces " \
    "and offsets of the tools"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_factor pliant_factor;
typedef struct pliant_preconditioner pliant_preconditioner;
typedef struct pliant_basis pliant_basis;

/* Lower triangle of the node-by-node matrix, in compressed columns of 3 x 3 blocks, each column's diagonal first. */
typedef struct pliant_pattern {
    int32_t num_columns;      /* free nodes */
    int32_t num_blocks;
    int32_t *start;           /* (num_columns + 1) */
    int32_t *row;             /* (num_blocks) ascending in each column */
    int32_t *term_start;      /* (num_blocks + 1); NULL, as term: of macro-elements */
    int32_t *term;            /* 16 * element + 4 * (corner of the row) + (corner of the column) */
    int64_t num_values;       /* of the scalar lower triangle */
} pliant_pattern;

/* How fine nodes follow the solved ones; absent when the fine mesh is solved. */
typedef struct pliant_upsample {
    /* linear in one coarse tetrahedron, or trilinear in one coarse cube or larger leaf */
    int corners;              /* 4, or 8 */
    int32_t *node;            /* (fine nodes x corners) solved node */
    double *weights;          /* (fine nodes x corners), sum 1 a node */
    /* homogenized shape functions ([H] 5 to 7): a fine node follows every coarse element whose submesh holds it */
    int32_t *start;           /* (fine nodes + 1) into the entries; NULL: by the weights above */
    int32_t *entry_element;   /* (entries) coarse tetrahedron, or macro-element */
    double *entry_share;      /* (entries) inverse-distance weight, sum 1 a node */
    double *entry_shape;      /* (entries x 9 corners) N, 3 x 3 times the element's corners, row-major */
    const uint8_t *still;     /* Nullable: (fine nodes) those that are PLIANT_FIXED_AT_REST stay there */
} pliant_upsample;

/* Elements with as many corners as they need: hexahedra on their own eight nodes (hexahedra.c), or, for lod (NUMERICS 4), one a cube of the
 * solved lattice that holds tissue, on all nodes that move its fine nodes. Its frame turns by R, fitted to the cube's own nodes: F = sum of x_v g_v'. A corner at x, X at rest, has in it
 *     q = R'(x - c) - (X - C), c and C the means of the cube's own nodes; or q = R'(x - X) where it is held: it moves fine nodes
 * against something fixed, from where it stood.
 * Forces are R K q with K = root' root; the fine nodes that follow the cube go to c + R (X_f - C + N q), where it is grounded to
 * X_f + N q. */
typedef struct pliant_macros {
    int32_t count;
    int32_t num_lent;         /* the first ones, whose roots belong to another system, which stays */
    int32_t *start;           /* (count + 1) into the corners */
    int32_t *node;            /* (corners) solved node */
    uint8_t *held;            /* (corners) */
    uint8_t *grounded;        /* (count) keeps R = I; every corner is held */
    int32_t *own;             /* (count x 8) the cube's own nodes, or -1 */
    double *gradient;         /* (count x 8 x 3) g [1/m] */
    double *shear;            /* Nullable: (count) volume * mu, what each weighs in the nodes' axes [N m]; NULL: axes do not turn */
    int32_t *rank;            /* (count) rows of root */
    float **root;             /* (count) (rank x 3 corners) [sqrt(N/m)], single: what is read most in a step */
    int32_t *cube_of_corner;  /* (corners) with the unknowns */
    int32_t *cell;            /* Nullable: (count) where it lies in the lattice, or the leaf of an octree; of hexahedra */
    double *rest;             /* Nullable: (solved nodes x 3) at rest; NULL: as the mesh has them */
    /* only where the solved mesh is not the fine one */
    int32_t *fine_start;      /* Nullable: (count + 1) into the fine nodes */
    int32_t *fine;            /* (fine nodes that are not fixed) by the cube that they follow */
    int32_t *cube_of_fine;    /* (fine nodes) that cube, or -1 */
    int32_t **entry_start;    /* (count) (its fine nodes + 1) into the entries of the cube */
    uint16_t **entry_corner;  /* (count) (entries) corner of the cube */
    float **entry_shape;      /* (count) (entries x 9) N, 3 x 3 */
} pliant_macros;

enum { PLIANT_MAX_LAYERS = 3, PLIANT_MAX_CORNERS = 2 * (2 * PLIANT_MAX_LAYERS + 2) * (2 * PLIANT_MAX_LAYERS + 2) * (2 * PLIANT_MAX_LAYERS + 2) };

/* The coarse elements at load, of which graded systems have those that no cut has come near; those that follow one another share it. */
typedef struct pliant_graded_base {
    int32_t holders;          /* changed atomically */
    const pliant_macros *macros; /* those of the coarse system, or made of its tetrahedra */
    pliant_macros *made;      /* Nullable */
    double *trace;            /* (macros->count) what each adds to the diagonal's sum */
    int32_t *element_of_tet;  /* (coarse tetrahedra) */
} pliant_graded_base;

/* Of a coarse system in whose body cuts have been made: near them its elements are those of the fine mesh (coarse/graded.c). Solved nodes are those of the
 * coarse mesh, then all fine ones, of which most follow and are no unknowns. */
typedef struct pliant_graded {
    pliant_mesh mesh;         /* solved: nodes and the lattice, no tetrahedra */
    int32_t coarse_nodes;
    const int32_t *coarse_place; /* (coarse_nodes) where each is in the coarse lattice; the body's */
    uint8_t *used;            /* (coarse_nodes) an element has it */
    uint8_t *refined;         /* (cells of the coarse lattice) */
    pliant_graded_base *base; /* the coarse elements at load; shared */
    int32_t num_base, num_fine; /* elements: those of the coarse mesh, which come first, then fine ones */
    int32_t *tet;             /* (num_fine) fine tetrahedron that each is; of a hexahedron -1 - its first one */
    int32_t *within;          /* (fine nodes) the first tetrahedron of a coarse element beside refined cubes that one of theirs lies in; -1: none */
    uint8_t *in_refined;      /* (fine nodes) a refined cube has it */
} pliant_graded;

/* What the stiffness of a block of elements follows from at one state. */
typedef struct pliant_tangent {
    double rotation[9][LANES];
    double twist[6][LANES];   /* what turning an element on costs against its stress; xx yy zz yz xz xy [N m] */
} pliant_tangent;

/* Which of the twists' stiffness is taken: all, or what is positive in every element, so that the sum is positive too. */
typedef enum pliant_twist { PLIANT_TWIST_EXACT, PLIANT_TWIST_POSITIVE } pliant_twist;

struct pliant_system {
    const pliant_mesh *mesh;  /* the solved one */
    const pliant_mesh *fine;
    const pliant_discretization *of; /* Nullable: that it is part of: who keeps something of it longer than a step retains that */
    int num_threads;

    /* ELEMENTS, in blocks of LANES, lane innermost; the last block is padded with elements that carry nothing */
    int32_t num_blocks;
    double (*gradients)[12][LANES]; /* (num_blocks) [1/m] */
    double (*lame)[2][LANES];       /* (num_blocks) volume * lambda, volume * mu [N m]; isotropic elements */
    double *stiffness;              /* (num_tets x 144) homogenized [N/m]; NULL: isotropic; beside macros of a coarser level (count x 576) */
    double *raw_diagonal;           /* (num_tets x 12) of it before grounded elements were stiffened; NULL: none were */
    uint8_t *grounded;              /* (num_blocks x LANES) keeps R = I: what holds fixed fine nodes, and what is empty; NULL: none */
    pliant_macros *macros;          /* Nullable: in place of all these; num_blocks is then what their forces and rotations fit in */

    /* UNKNOWNS */
    int32_t num_free;
    int32_t *free_of_node;    /* (num_nodes) or -1 */
    int32_t *node_of_free;    /* (num_free) */
    int32_t *corner_start, *corner_end; /* (num_free) where a node's begin and end in corner */
    int32_t num_corners;      /* of corner; those of a next body's system have gaps where a list got shorter, or longer and went to the end */
    int32_t *corner;          /* (num_corners) 4 * element + corner, or corner of the macro-elements: which forces a node gathers, ascending */

    pliant_pattern pattern;   /* of the next body's system empty until a background thread needs it, which makes it */
    pliant_preconditioner *preconditioner; /* at rest; shared, never changed. NULL: the next body's, until the solver has made its own */
    double mean_diagonal;     /* of that matrix [N/m] */
    double *trace;            /* (num_blocks) what each adds to that diagonal's sum; of a graded system (elements), below 0 where it is not known yet */

    pliant_upsample *upsample; /* Nullable */
    pliant_graded *graded;    /* Nullable: mesh is its own */
    bool divided;             /* cuts have gone into the body that it is of, and left every node at a place of the lattice */
    pliant_basis *basis;      /* Nullable: of a patch (basis.h): what lies beyond its elements pulls, too */
    double *gravity_mass;     /* (num_free x 9) M_j of [H] 10 [kg] */
    double *fine_mass;        /* Nullable: (fine nodes) by the shape functions of hexahedra [kg] */
};

/* ---- elements of either kind: tetrahedra of the solved mesh, or macro-elements */
enum { PLIANT_ELEMENT_UNKNOWNS = 24 }; /* of a tetrahedron or a hexahedron, at most */

static inline int32_t pliant_element_count(const pliant_system *system) { return system->macros ? system->macros->count : system->mesh->num_tets; }
/* its first corner, by the number that forces are gathered by; and that of the next element */
static inline int32_t pliant_element_begin(const pliant_system *system, int32_t element) { return system->macros ? system->macros->start[element] : 4 * element; }
/* (corners) solved node */
static inline const int32_t *pliant_element_nodes(const pliant_system *system) { return system->macros ? system->macros->node : system->mesh->tets; }
static inline int32_t pliant_element_of_corner(const pliant_system *system, int32_t corner) { return system->macros ? system->macros->cube_of_corner[corner] : corner / 4; }

/* What the system of a next body takes over from the one before: a tetrahedron is kept where its number, corners, material and what is
 * fixed of it are the same. */
typedef struct pliant_kept {
    const pliant_discretization *before;
    uint8_t *fine;            /* (fine tetrahedra of the next body) */
} pliant_kept;

/* ---- elements.c */
/* What it owns but its preconditioner; the struct is zeroed. */
void pliant_system_clear(pliant_system *system);
/* the first from one on that is not kept; count: there is none */
int32_t pliant_next_not_kept(const uint8_t *kept, int32_t count, int32_t from);
/* Isotropic linear tetrahedra. [H] 2.1. before, kept: Nullable: those of another system that are the same */
pliant_status pliant_system_elements(pliant_system *system, const pliant_tet_material *material, const pliant_system *before, const uint8_t *kept);
/* 12 x 12 of one: K = V B' E B, as lambda g_i g_j' + mu g_j g_i' + mu (g_i . g_j) I per 3 x 3 block. */
void pliant_element_stiffness(const double gradients[12], double volume_lambda, double volume_mu, double stiffness[144]);
/* the same of a tetrahedron of a mesh, at rest */
void pliant_tet_stiffness(const pliant_mesh *mesh, int32_t tet, const pliant_tet_material *material, double stiffness[144]);
/* Elastic force of every element at positions (num_nodes x 3): forces (num_blocks x 12 x LANES). */
void pliant_system_element_forces(const pliant_system *system, const double *positions, double (*forces)[12][LANES]);
/* Sum over elements on the free nodes, in a fixed order: out (num_free x 3) [N]. */
void pliant_system_gather(const pliant_system *system, double (*forces)[12][LANES], double *out);
/* (num_blocks) at these positions. */
void pliant_system_tangents(const pliant_system *system, const double *positions, pliant_twist twist, pliant_tangent *tangents);

/* ---- unknowns.c */
/* Number free nodes (fixed: (num_nodes)), and gather lists. */
pliant_status pliant_system_number(pliant_system *system, const uint8_t *fixed);
/* Likewise, with the lists of before where all tetrahedra around a node are kept. kept: Nullable */
pliant_status pliant_system_number_next(pliant_system *system, const uint8_t *fixed, const pliant_system *before, const uint8_t *kept);
/* Whether the unknowns of before have the same numbers; those of a system that was numbered after it are not read. */
bool pliant_numbered_alike(const pliant_system *system, const pliant_system *before);
/* system->mean_diagonal; turning the elements does not change it. before, kept: Nullable: those of another system that are the same. Errors: MEMORY. */
pliant_status pliant_system_find_mean_diagonal(pliant_system *system, const pliant_system *before, const uint8_t *kept);

/* ---- pattern.c */
/* pliant_system_number and pliant_system_find_pattern. */
pliant_status pliant_system_unknowns(pliant_system *system, const uint8_t *fixed);
/* where there is none yet */
pliant_status pliant_system_find_pattern(pliant_system *system);
/* Stiffness at given tangents (num_blocks): values (pattern.num_values), lower triangle by columns. */
void pliant_system_assemble(const pliant_system *system, const pliant_tangent *tangents, double *values);
/* one 3 x 3 block of it, by its place in the pattern */
void pliant_system_assemble_block(const pliant_system *system, const pliant_tangent *tangents, int32_t index, double block[9]);
/* An element's part of it, (3 corners x 3 corners), of at most PLIANT_ELEMENT_UNKNOWNS. */
void pliant_system_element(const pliant_system *system, const pliant_tangent *tangents, int32_t element, double *stiffness);

/* ---- part.c */
/* Some elements of a system as a system of their own, without unknowns, on a mesh of their nodes. place: (nodes of the whole) number there, or -1;
 * mesh: num_nodes is set; cells, cell_size, rest and, of tetrahedra, tets are made. Errors: MEMORY; what was made is the caller's to free. */
pliant_status pliant_system_take(const pliant_system *whole, int32_t count, const int32_t *element, const int32_t *place, pliant_mesh *mesh,
                                 pliant_system *out);

/* ---- hexahedra.c: in place of pliant_system_elements */
/* A hexahedron for every whole cube of the lattice and every such part of one, tetrahedra for the rest. before, kept: Nullable: those of another system that are the same.
 * Errors: MEMORY. */
pliant_status pliant_system_hexahedra(pliant_system *system, const pliant_tet_material *material, const pliant_system *before, const uint8_t *kept);
/* ---- octree_hexahedra.c: one for every leaf. A node in the middle of an edge or face of a larger leaf follows its corners, as the centre of a divided
 * one does: upsample has how. before, kept: Nullable: those of another system that are the same. fixed: (nodes) in: what the body fixes; out: and what follows,
 * and what is followed by something fixed. Errors: MEMORY. */
pliant_status pliant_system_octree_hexahedra(pliant_system *system, const pliant_tet_material *material, const pliant_system *before, const uint8_t *kept,
                                             uint8_t *fixed);
/* ---- coarse/graded.c */
/* Whether cuts have parted anything of a body. */
bool pliant_body_is_cut(const pliant_body *body);
/* All of it that is made of elements, and how the fine nodes follow; its mesh is the coarse one yet. base: of the coarse mesh alone, with unknowns.
 * kept: Nullable: what the body before has the same, whose system may be graded, from the same base. fixed: (solved nodes) out, with pliant_calloc.
 * Errors: MEMORY. */
pliant_status pliant_system_graded(pliant_system *system, const pliant_system *base, const pliant_body *body, const pliant_kept *kept, bool hexahedra,
                                   uint8_t **fixed);
/* ---- coarse/graded_carry.c */
/* The solved node that each was in the system of the body before; -1: none. *own: to be freed by the caller, where it is not the map's. Errors: MEMORY. */
pliant_status pliant_solved_sources(const pliant_system *system, const pliant_system *before, const pliant_body_map *map, int32_t **own, const int32_t **out);
/* Where solved nodes are, by where those before were: out (solved nodes x 3). Errors: MEMORY. */
pliant_status pliant_solved_positions(const pliant_system *system, const pliant_system *before, const pliant_body_map *map, const double *x, double *out);
/* the fine node at the place of a solved one; -1: none */
int32_t pliant_fine_of_solved(const pliant_system *system, const pliant_body *body, int32_t node);
/* ---- hexahedra.c */
/* Nodes of the cubes of a lattice of whole ones, without stiffness: start, node, cell. Errors: MEMORY. */
pliant_status pliant_system_cubes(pliant_system *system);

/* ---- macro.c: the same of macro-elements; forces (corners x 3) */
void pliant_macro_forces(const pliant_system *system, const double *positions, double *forces);
void pliant_macro_gather(const pliant_system *system, const double *forces, double *out);
void pliant_macro_tangents(const pliant_system *system, const double *positions, pliant_tangent *tangents);
pliant_status pliant_macro_number(pliant_system *system); /* free nodes are numbered already */
pliant_status pliant_macro_find_pattern(pliant_system *system);
void pliant_macro_assemble(const pliant_system *system, const pliant_tangent *tangents, double *values);
/* of the stiffness of a corner's cube the column of blocks of that corner: blocks (corners of the cube x 9) */
void pliant_macro_column(const pliant_system *system, const pliant_tangent *tangents, int32_t corner, double *blocks);
double pliant_macro_operations(const pliant_system *system); /* of that */
/* y = y + K x, on all nodes, by one thread */
void pliant_macro_multiply(const pliant_system *system, const pliant_tangent *tangents, const double *x, double *y);
double pliant_macro_mean_diagonal(const pliant_system *system); /* finds what is not known of its trace */
/* what an element adds to the diagonal's sum */
double pliant_macro_trace(const pliant_macros *macros, const int32_t *free_of_node, int32_t element);
void pliant_macro_positions(const pliant_system *system, const double *solved, double *fine);
/* a fine node's, added with this weight: dense (num_free x 9) */
void pliant_macro_weights(const pliant_system *system, const double *solved, int32_t fine_node, double weight, double *dense);
void pliant_macros_free(pliant_macros *macros); /* Nullable */

/* ---- homogenize.c */
pliant_status pliant_homogenize(pliant_system *system, const pliant_scene *scene, const pliant_mesh *fine, const uint8_t *fine_fixed,
                                const pliant_tet_material *fine_material, const int32_t *coarse_of_fine, pliant_progress progress);

/* ---- cubes.c: the same of hexahedra on the coarse cubes. Errors: MEMORY, NUMERIC, CANCELLED. */
pliant_status pliant_homogenize_cubes(pliant_system *system, const pliant_scene *scene, const pliant_mesh *fine, const uint8_t *fine_fixed, uint8_t *coarse_fixed,
                                      const pliant_tet_material *fine_material, const int32_t *coarse_of_fine, pliant_progress progress);

/* ---- held_edges.c: coarse hexahedra with a held face beside a free one are made softer. fixed: (coarse nodes). Errors: MEMORY. */
pliant_status pliant_soften_held_edges(pliant_system *system, const pliant_body *body, const uint8_t *fixed);

/* ---- upsample.c */
pliant_status pliant_upsample_linear(pliant_system *system, const int32_t *coarse_of_fine);
/* Of a point in a cube of the solved lattice: weights of its corners. A coordinate that is a node's of the fine lattice is exactly that. */
void pliant_trilinear_weights(const pliant_system *system, int32_t cell, const double *point, double weights[8]);
/* the same in coarse hexahedra, and the tetrahedra beside a cut. element_of_fine: (fine tetrahedra) macro-element */
pliant_status pliant_upsample_trilinear(pliant_system *system, const int32_t *element_of_fine);
/* that, by the coarse tetrahedra that the elements are made of */
pliant_status pliant_upsample_cubes(pliant_system *system, const int32_t *coarse_of_fine);
/* whether the fine mesh is the solved one, node by node */
bool pliant_solves_fine(const pliant_system *system);
/* whether weights turn with the tissue, so that they change from step to step */
bool pliant_upsample_turns(const pliant_system *system);
void pliant_upsample_positions(const pliant_system *system, const double *solved, double *fine);
/* M_j = sum of m_i N_ij over all fine nodes, [H] 10: mass (fine nodes) [kg]; dense (num_free x 9), zeroed by the caller [kg]. Errors: MEMORY. */
pliant_status pliant_upsample_masses(const pliant_system *system, const double *mass, double *dense);
/* Fine weights (sparse: nodes, weights) to 3 x 3 blocks on the unknowns, [H] 11: dense (num_free x 9), zeroed by the caller. */
void pliant_upsample_weights(const pliant_system *system, const double *solved, int32_t count, const int32_t *nodes, const double *weights,
                             double *dense);

/* ---- factor.c: CHOLMOD behind a few lines. One factor belongs to one thread at a time. */
pliant_status pliant_factor_analyze(const pliant_pattern *pattern, pliant_factor **out);
/* order: Nullable: (num_columns) the columns as they are to be eliminated, in place of looking for a good order */
pliant_status pliant_factor_analyze_in(const pliant_pattern *pattern, const int32_t *order, pliant_factor **out);
/* That order: (num_columns) out. Returns how many columns there are. */
int32_t pliant_factor_order(const pliant_factor *factor, int32_t *order);
/* solves in double precision from now on; takes effect with the next numbers */
void pliant_factor_in_double(pliant_factor *factor);
/* the same symbolic analysis, nothing numeric */
pliant_status pliant_factor_clone(const pliant_factor *factor, pliant_factor **out);
/* Errors: NUMERIC (not positive definite), MEMORY; the old numbers are gone then. */
pliant_status pliant_factor_numeric(pliant_factor *factor, double *values);
/* right, out: (columns x 3 num_columns); may be the same. Errors: MEMORY. */
pliant_status pliant_factor_solve(pliant_factor *factor, int32_t columns, const double *right, double *out);
/* A solve in two parts (panels.h): at some nodes, or at those whose half solves are kept (halves.h). possible: the factor has panels; else the others cannot be
 * called. Errors: MEMORY. */
pliant_status pliant_factor_reach(pliant_factor *factor, int32_t count, const int32_t *nodes, bool *possible);
void pliant_factor_begin(pliant_factor *factor, const double *right, double *out);
void pliant_factor_end(pliant_factor *factor, const double *more, double *out);
typedef struct pliant_half pliant_half;
pliant_status pliant_factor_half(pliant_factor *factor, int32_t node, pliant_half *out); /* after pliant_factor_reach. Errors: MEMORY */
void pliant_factor_half_product(const pliant_factor *factor, const pliant_half *a, const pliant_half *b, double out[9]);
void pliant_factor_begin_half(pliant_factor *factor, const double *right);
void pliant_factor_half_answer(const pliant_factor *factor, const pliant_half *half, double out[3]); /* of that at the node */
void pliant_factor_half_add(pliant_factor *factor, const pliant_half *half, const double force[3]);  /* to the right side, at the node */
void pliant_factor_end_half(pliant_factor *factor, double *out);
double pliant_factor_condition(pliant_factor *factor);
/* Floating-point operations of a numeric factorization, as the analysis counted them; 0 for clones. */
double pliant_factor_operations(const pliant_factor *factor);
/* Numbers in it, as the analysis counted them; 0 for clones. */
double pliant_factor_values(const pliant_factor *factor);
size_t pliant_factor_bytes(const pliant_factor *factor);
void pliant_factor_free(pliant_factor *factor);

/* ---- preconditioner.c: what stands for the inverse of the stiffness matrix at one state: a factor, or a multigrid cycle.
 * Symmetric, positive definite, fixed between refreshes. One belongs to one thread at a time. */
/* order: Nullable: as pliant_factor_analyze_in, of a factor */
pliant_status pliant_preconditioner_create(const pliant_system *system, pliant_preconditioner_choice choice, const int32_t *order,
                                           pliant_preconditioner **out);
/* within a basis (basis.h), which is borrowed; without numbers */
pliant_status pliant_preconditioner_within(const pliant_basis *basis, const pliant_system *system, pliant_preconditioner **out);
/* the same analysis and numbers, for another thread */
pliant_status pliant_preconditioner_clone(const pliant_preconditioner *source, int num_threads, pliant_preconditioner **out);
void pliant_preconditioner_threads(pliant_preconditioner *preconditioner, int num_threads); /* from now on */
/* One of a body before, carried over to this system (carried.h): with numbers once that one, the base, is handed over to it. of_base: the
 * system that it is of, one of those of `of`. source: (num_free) unknown there or -1, taken over, also on an error; positions (num_nodes x 3)
 * NULL: it is mended later; axes (num_free x 9) Nullable: now */
pliant_status pliant_preconditioner_carry(const pliant_system *system, const pliant_discretization *of, const pliant_system *of_base, int32_t *source,
                                          const double *positions, const double *axes, pliant_preconditioner **out);
/* One that was carried over to be mended later, before it solves anything; others stay as they are. Errors: MEMORY, NUMERIC. */
pliant_status pliant_preconditioner_mend(pliant_preconditioner *preconditioner, const double *positions, const double *axes);
void pliant_preconditioner_hand_over(pliant_preconditioner *carried, pliant_preconditioner **base); /* *base becomes NULL */
/* Where a carried one keeps its base; NULL: it is not carried. */
pliant_preconditioner **pliant_preconditioner_base(pliant_preconditioner *preconditioner);
/* What the base of a carried one is of, and its source; NULL: it is not carried. */
const pliant_discretization *pliant_preconditioner_source(const pliant_preconditioner *preconditioner, const int32_t **source);
bool pliant_preconditioner_layered(const pliant_preconditioner *preconditioner); /* a multigrid */
int32_t pliant_preconditioner_order(const pliant_preconditioner *preconditioner, int32_t *order); /* as pliant_factor_order; 0: no factor */
/* at these tangents (num_blocks). Errors: NUMERIC, MEMORY; the old numbers are gone then. */
pliant_status pliant_preconditioner_numeric(pliant_preconditioner *preconditioner, const pliant_tangent *tangents);
/* right, out: (columns x 3 num_free); may be the same. */
pliant_status pliant_preconditioner_solve(pliant_preconditioner *preconditioner, int32_t columns, const double *right, double *out);
pliant_factor *pliant_preconditioner_factor(pliant_preconditioner *preconditioner); /* NULL: it is none */
/* whether a matrix that is not positive definite is refused; a multigrid does not see it */
bool pliant_preconditioner_refuses(const pliant_preconditioner *preconditioner);
double pliant_preconditioner_condition(pliant_preconditioner *preconditioner); /* 0: not known */
double pliant_preconditioner_operations(const pliant_preconditioner *preconditioner); /* of a refresh */
double pliant_preconditioner_apply_operations(const pliant_preconditioner *preconditioner); /* to apply it once */
double pliant_preconditioner_solve_operations(const pliant_preconditioner *preconditioner); /* to bring a residual down to 1e-4 */
size_t pliant_preconditioner_bytes(const pliant_preconditioner *preconditioner); /* beyond pliant_memory_in_use */
void pliant_preconditioner_free(pliant_preconditioner *preconditioner);

/* All of it, with its preconditioner. Nullable */
void pliant_system_free(pliant_system *system);

#ifdef __cplusplus
}
#endif

#endif
