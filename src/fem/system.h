/* The linear system of a quasi-static solver: elements, free nodes, matrix pattern, and the upsampling to fine nodes.
 *
 * Unknowns are the free nodes of the solved mesh (fine or coarse), three numbers each. The corotational elastic force
 * of an element is f = R K (R' x - X) (Mueller and Gross 2004). [H] 2.2 uses the same force with homogenized K. */
#ifndef PLIANT_FEM_SYSTEM_H
#define PLIANT_FEM_SYSTEM_H

#include "fem/weight_blocks.h"
#include "base/lanes.h"
#include "model_data/model.h"
#include "topology/body.h"

/* Error message of a step whose merit is not finite. All single inputs have been checked to be finite before. */
#define PLIANT_LOAD_NOT_FINITE \
    "the load is not finite, or too large for double precision: look at model/gravity, density in the material " \
    "table, grasp/stiffness, and the forces and offsets of the tools"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_factor pliant_factor;
typedef struct pliant_preconditioner pliant_preconditioner;
typedef struct pliant_basis pliant_basis;

/* Pattern of the lower triangle of the node-by-node matrix: compressed columns of 3 x 3 blocks. The diagonal block is
 * the first block of each column. */
typedef struct pliant_pattern {
    int32_t num_columns;      /* free nodes */
    int32_t num_blocks;
    int32_t *start;           /* (num_columns + 1) */
    int32_t *row;             /* (num_blocks) ascending in each column */
    int32_t *term_start;      /* (num_blocks + 1); NULL for macro-elements, and so is term */
    int32_t *term;            /* 16 * element + 4 * (corner of the row) + (corner of the column) */
    int64_t num_values;       /* entries of the scalar lower triangle */
} pliant_pattern;

/* Upsampling: how fine nodes follow the solved nodes. Absent when the fine mesh is solved. */
typedef struct pliant_upsample {
    /* Linear in one coarse tetrahedron, or trilinear in one coarse cube or larger leaf. */
    int corners;              /* 4, or 8 */
    int32_t *node;            /* (fine nodes x corners) solved node */
    double *weights;          /* (fine nodes x corners), sum 1 per node */
    /* Homogenized shape functions ([H] 5 to 7): a fine node follows every coarse element whose submesh contains it. */
    int32_t *start;         /* (fine nodes + 1) into the entries; NULL: use the weights above */
    int32_t *entry_element; /* (entries) coarse tetrahedron, or macro-element */
    double *entry_weight;   /* (entries) inverse-distance weight, sum 1 per node */
    double *entry_shape;    /* (entries x 9 corners) N, 3 x 3 times the element's corners, row-major */
    const uint8_t *still;   /* Nullable: (fine nodes) nodes marked PLIANT_FIXED_AT_REST keep their rest position */
} pliant_upsample;

/* Moduli of a neo-Hookean element, times volume [N m] (element/neo_hookean.h). */
typedef struct pliant_macro_law { double lambda, mu; } pliant_macro_law;

/* Elements with a variable number of corners. There are two kinds: hexahedra on their own eight nodes (hexahedra.c),
 * and the macro-elements of lod (src/fem/coarse/NUMERICS.md). A macro-element is a cube of the solved lattice that
 * contains tissue. Its corners are all solved nodes that move the fine nodes of the cube.
 *
 * An element has F = sum of x_v g_v' over the cube's own nodes v, and its rotation R. A corner at x with rest position
 * X has the local displacement
 *     q = R'(x - c) - (X - C)
 * where c and C are the means of the cube's own nodes. A held corner moves fine nodes relative to something fixed, and
 * has
 *     q = R'(x - X).
 * The corner forces are R K q with K = root' root. The fine nodes of the cube move to c + R (X_f - C + N q). In a
 * grounded element they move to X_f + N q. */
typedef struct pliant_macros {
    int32_t count;
    int32_t num_lent; /* the first elements, whose roots are borrowed from another system that outlives this system */
    int32_t *start;           /* (count + 1) into the corners */
    int32_t *node;            /* (corners) solved node */
    uint8_t *held;            /* (corners) */
    uint8_t *grounded;        /* (count) R = I always; every corner is held */
    int32_t *own;             /* (count x 8) the cube's own nodes, or -1 */
    double *gradient;         /* (count x 8 x 3) g [1/m] */
    /* Nullable: (count) volume * mu, the weight of an element in the rotation of its nodes' axes [N m]; NULL: axes do
     * not turn. */
    double *shear;
    pliant_macro_law *law;    /* Nullable: (count) NULL: the elements are corotational */
    int32_t *rank;            /* (count) rows of root */
    /* (count) (rank x 3 corners) [sqrt(N/m)]; in single precision, since a step reads these more than all other data */
    float **root;
    int32_t *cube_of_corner;  /* (corners) element; set together with the unknowns */
    /* Nullable: (count) index of the cube in the lattice, or of the leaf in the octree; hexahedra only. */
    int32_t *cell;
    double *rest;             /* Nullable: (solved nodes x 3) rest positions [m]; NULL: the mesh's rest positions */
    /* Only if the solved mesh is not the fine mesh. */
    int32_t *fine_start;      /* Nullable: (count + 1) into the fine nodes */
    int32_t *fine;            /* (fine nodes that are not fixed) sorted by the cube that they follow */
    int32_t *cube_of_fine;    /* (fine nodes) the followed cube, or -1 */
    int32_t **entry_start;    /* (count) (fine nodes of the cube + 1) into the entries of the cube */
    uint16_t **entry_corner;  /* (count) (entries) corner of the cube */
    float **entry_shape;      /* (count) (entries x 9) N, 3 x 3 */
} pliant_macros;

enum {
    PLIANT_MAX_LAYERS = 3,
    PLIANT_MAX_CORNERS = 2 * (2 * PLIANT_MAX_LAYERS + 2) * (2 * PLIANT_MAX_LAYERS + 2) * (2 * PLIANT_MAX_LAYERS + 2)
};

/* The coarse elements at load time. A graded system uses the elements that are far from every cut. Successive graded
 * systems share one base. */
typedef struct pliant_graded_base {
    int32_t holders;          /* reference count, changed atomically */
    const pliant_macros *macros; /* the macro-elements of the coarse system, or elements built from its tetrahedra */
    pliant_macros *made;      /* Nullable: the elements built from tetrahedra, owned */
    double *trace;            /* (macros->count) contribution of each element to the sum of the diagonal */
    int32_t *element_of_tet;  /* (coarse tetrahedra) */
} pliant_graded_base;

/* A coarse system whose topology has been cut. Near the cuts, fine elements replace the coarse elements
 * (coarse/graded.c). Solved nodes are the coarse nodes, followed by all fine nodes. Most fine nodes follow coarse nodes
 * and are no unknowns. */
typedef struct pliant_graded {
    pliant_mesh mesh;         /* solved mesh: nodes and the lattice, no tetrahedra */
    int32_t coarse_nodes;
    const int32_t *coarse_place; /* (coarse_nodes) index of each node in the coarse lattice; borrowed from the body */
    uint8_t *used;            /* (coarse_nodes) nonzero: an element uses the node */
    uint8_t *refined;         /* (cells of the coarse lattice) */
    pliant_graded_base *base; /* the coarse elements at load time; shared */
    int32_t num_base, num_fine; /* number of elements: first the coarse elements, then the fine ones */
    int32_t *tet; /* (num_fine) fine tetrahedron of each element; for a hexahedron: -1 - its first tetrahedron */
    /* (fine nodes of refined cubes) first fine tetrahedron in an adjacent cube that is not refined and contains the
     * node; -1: no such tetrahedron */
    int32_t *unrefined_neighbour;
    uint8_t *in_refined;      /* (fine nodes) nonzero: the node belongs to a refined cube */
} pliant_graded;

/* State of a block of elements from which its stiffness is computed. */
typedef struct pliant_tangent {
    double rotation[9][LANES];
    /* Resistance of the element's stress to a rotation of the element; xx yy zz yz xz xy [N m]. */
    double twist[6][LANES];
} pliant_tangent;

/* Selects the twist stiffness: the exact one, or the positive terms of every element, which make the sum positive as
 * well. */
typedef enum pliant_twist { PLIANT_TWIST_EXACT, PLIANT_TWIST_POSITIVE } pliant_twist;

struct pliant_system {
    const pliant_mesh *mesh;  /* the solved mesh */
    const pliant_mesh *fine;
    /* Nullable: the discretization that contains this system. Code that keeps data of the system longer than a step
     * retains it. */
    const pliant_discretization *of;
    int num_threads;

    /* ELEMENTS, in blocks of LANES, lane innermost. The last block is padded with elements without stiffness. */
    int32_t num_blocks;
    double (*gradients)[12][LANES]; /* (num_blocks) [1/m] */
    double (*lame)[2][LANES];       /* (num_blocks) volume * lambda, volume * mu [N m]; isotropic elements */
    pliant_elasticity law;          /* of isotropic elements */
    /* Nullable: (num_tets) volume * pressure (element/pressures.h) at which the tangents are computed [N m] */
    const double *volume_pressure;
    /* (num_tets x 144) homogenized [N/m]; NULL: isotropic elements. With macro-elements of a coarser level: (count x
     * 576). */
    double *stiffness;
    /* (num_tets x 12) diagonal of `stiffness` before grounded elements were stiffened; NULL: no element was
     * stiffened */
    double *raw_diagonal;
    /* (num_blocks x LANES) nonzero: R = I always, for elements with fixed fine nodes and for empty elements; NULL: no
     * such element */
    uint8_t *grounded;
    /* Nullable: replaces all arrays above; num_blocks then gives the capacity for the macro-elements' forces and
     * rotations. */
    pliant_macros *macros;

    /* UNKNOWNS */
    int32_t num_free;
    int32_t *free_of_node;    /* (num_nodes) or -1 */
    int32_t *node_of_free;    /* (num_free) */
    int32_t *corner_start, *corner_end; /* (num_free) range of a node's entries in corner */
    /* Capacity of `corner` in use. After a cut the array has gaps: a list that became longer is moved to the end. */
    int32_t num_corners;
    /* (num_corners) 4 * element + corner, or the corner index of a macro-element: the forces that a node sums,
     * ascending */
    int32_t *corner;

    /* The pattern after a cut stays empty until a background thread needs and builds it. */
    pliant_pattern pattern;
    /* At rest; shared, never changed. After a cut: NULL until the solver has built its own preconditioner. */
    pliant_preconditioner *preconditioner;
    double mean_diagonal;     /* mean of the matrix's diagonal [N/m] */
    /* Contribution of each block to the sum of the diagonal: (num_blocks); of a graded system: (elements), negative
     * while it is not computed. */
    double *trace;

    pliant_upsample *upsample; /* Nullable */
    pliant_graded *graded;    /* Nullable: owns `mesh` */
    bool divided;             /* cuts have changed the topology, and every node is still a lattice node */
    bool is_subdivided;       /* cuts have put nodes on edges */
    /* Nullable: of a patch (basis.h). The tissue beyond the patch's elements pulls on the patch as well. */
    pliant_basis *basis;
    double *gravity_mass;     /* (num_free x 9) M_j of [H] 10 [kg] */
    double *fine_mass;        /* Nullable: (fine nodes) from the hexahedra's shape functions [kg] */
};

/* ---- Elements of both kinds: tetrahedra of the solved mesh, or macro-elements. */
enum { PLIANT_ELEMENT_UNKNOWNS = 24 }; /* maximum per element, for tetrahedra and hexahedra */

static inline int32_t pliant_element_count(const pliant_system *system)
{
    return system->macros ? system->macros->count : system->mesh->num_tets;
}
/* Return the index of the element's first corner in the gather lists. The index for `element + 1` is the end. */
static inline int32_t pliant_element_begin(const pliant_system *system, int32_t element)
{
    return system->macros ? system->macros->start[element] : 4 * element;
}
/* Return the solved node of every corner: (corners). */
static inline const int32_t *pliant_element_nodes(const pliant_system *system)
{
    return system->macros ? system->macros->node : system->mesh->tets;
}
static inline int32_t pliant_element_of_corner(const pliant_system *system, int32_t corner)
{
    return system->macros ? system->macros->cube_of_corner[corner] : corner / 4;
}

/* The elements that a system shares with its predecessor from before a cut. A tetrahedron is kept if its index,
 * corners, material and fixed nodes are unchanged. */
typedef struct pliant_unchanged_elements {
    const pliant_discretization *before;
    uint8_t *fine;            /* (fine tetrahedra after the cut) nonzero: kept */
} pliant_unchanged_elements;

/* ---- Implemented in elements.c. */
/* Free everything that the system owns except its preconditioner, and zero the struct. */
void pliant_system_clear(pliant_system *system);
/* Return whether an element only fills empty space through which tissue moves. */
bool pliant_tet_fills(const pliant_tet_material *material);
/* Return the first index >= from that is not kept, or `count` if all are kept. */
int32_t pliant_next_changed(const uint8_t *kept, int32_t count, int32_t from);
/* Build isotropic linear tetrahedra ([H] 2.1).
 * @param before, kept  Nullable: a system whose kept elements are copied. */
pliant_status pliant_system_build_tetrahedra(pliant_system *system, const pliant_tet_material *material,
                                             const pliant_system *before, const uint8_t *kept);
/* Compute the 12 x 12 stiffness of one tetrahedron: K = V B' E B. A 3 x 3 block is lambda g_i g_j' + mu g_j g_i' + mu
 * (g_i . g_j) I. */
void pliant_element_stiffness(const double gradients[12], double volume_lambda, double volume_mu,
                              double stiffness[144]);
/* Compute the same stiffness for a tetrahedron of a mesh, at rest. */
void pliant_tet_stiffness(const pliant_mesh *mesh, int32_t tet, const pliant_tet_material *material,
                          double stiffness[144]);
/* Compute the elastic force of every element at positions (num_nodes x 3). forces: (num_blocks x 12 x LANES) [N]. */
void pliant_system_element_forces(const pliant_system *system, const double *positions, double (*forces)[12][LANES]);
/* Sum the element forces on the free nodes, in a fixed order. out: (num_free x 3) [N]. */
void pliant_system_gather(const pliant_system *system, double (*forces)[12][LANES], double *out);
/* Compute the tangents (num_blocks) at these positions. */
void pliant_system_tangents(const pliant_system *system, const double *positions, pliant_twist twist,
                            pliant_tangent *tangents);

/* ---- Implemented in unknowns.c. */
/* Number the free nodes and build the gather lists. fixed: (num_nodes). */
pliant_status pliant_system_number_unknowns(pliant_system *system, const uint8_t *fixed);
/* Do the same, and copy the lists of `before` for nodes whose adjacent tetrahedra are all kept. kept: Nullable */
pliant_status pliant_system_number_next(pliant_system *system, const uint8_t *fixed, const pliant_system *before,
                                        const uint8_t *kept);
/* Return whether the unknowns have the same numbers in both systems. Systems that were numbered after `before` are not
 * read. */
bool pliant_has_same_numbers(const pliant_system *system, const pliant_system *before);
/* Compute system->mean_diagonal, which rotations of elements do not change.
 * @param before, kept  Nullable: a system whose kept contributions are copied.
 * Errors: MEMORY. */
pliant_status pliant_system_find_mean_diagonal(pliant_system *system, const pliant_system *before, const uint8_t *kept);

/* ---- Implemented in pattern.c. */
/* Call pliant_system_number_unknowns and pliant_system_find_pattern. */
pliant_status pliant_system_unknowns(pliant_system *system, const uint8_t *fixed);
/* Build the pattern if it is missing. */
pliant_status pliant_system_find_pattern(pliant_system *system);
/* Assemble the stiffness at given tangents (num_blocks). values: (pattern.num_values), lower triangle by columns. */
void pliant_system_assemble(const pliant_system *system, const pliant_tangent *tangents, double *values);
/* Assemble one 3 x 3 block of the stiffness, by its index in the pattern. */
void pliant_system_assemble_block(const pliant_system *system, const pliant_tangent *tangents, int32_t index,
                                  double block[9]);
/* Compute the stiffness of one element: (3 corners x 3 corners), at most PLIANT_ELEMENT_UNKNOWNS squared. */
void pliant_system_element(const pliant_system *system, const pliant_tangent *tangents, int32_t element,
                           double *stiffness);

/* ---- Implemented in extract_elements.c. */
/* Copy some elements of a system into a new system without unknowns, on a mesh of their nodes.
 * @param element  (count) elements of the whole system.
 * @param place    (nodes of the whole system) number in the new mesh, or -1.
 * @param mesh     In: num_nodes; out: cells, cell_size, rest and, for tetrahedra, tets.
 * Errors: MEMORY; the caller then frees the partial result. */
pliant_status pliant_system_extract(const pliant_system *whole, int32_t count, const int32_t *element,
                                    const int32_t *place, pliant_mesh *mesh, pliant_system *out);

/* ---- Implemented in hexahedra.c. Replaces pliant_system_build_tetrahedra. */
/* Build a hexahedron for every complete lattice cube and every complete fragment of a cube, and tetrahedra for the
 * others.
 * @param complete      Nullable: if pressures carry a part of lambda (element/pressures.h), the complete materials.
 * @param before, kept  Nullable: a system whose kept elements are copied.
 * Errors: MEMORY. */
pliant_status pliant_system_build_hexahedra(pliant_system *system, const pliant_tet_material *material,
                                            const pliant_tet_material *complete, const pliant_system *before,
                                            const uint8_t *kept);
/* ---- Implemented in octree_hexahedra.c.
 * Build a hexahedron for every leaf of the octree. A node in the middle of a larger leaf's edge or face follows that
 * leaf's corners, and so does the centre of a divided leaf. The system's upsampling stores these relations.
 * @param complete  Nullable: as in pliant_system_build_hexahedra.
 * @param before, kept  Nullable: a system whose kept elements are copied.
 * @param fixed  (nodes) in: nodes that the body fixes; out: also the followers, and nodes with a fixed follower.
 * Errors: MEMORY. */
pliant_status pliant_system_octree_hexahedra(pliant_system *system, const pliant_tet_material *material,
                                             const pliant_tet_material *complete, const pliant_system *before,
                                             const uint8_t *kept, uint8_t *fixed);
/* ---- Implemented in coarse/graded.c. */
/* Return whether cuts have separated any tissue of the body. */
bool pliant_body_is_cut(const pliant_body *body);
/* Build the elements of a graded system and the upsampling to its fine nodes. On entry, the system's mesh is the coarse
 * mesh.
 * @param base   System of the coarse mesh alone, with unknowns.
 * @param kept   Nullable: elements unchanged by the cut; the system before the cut may be graded, from the same base.
 * @param fixed  Out: (solved nodes), allocated with pliant_calloc.
 * Errors: MEMORY. */
pliant_status pliant_system_build_graded(pliant_system *system, const pliant_system *base, const pliant_body *body,
                                         const pliant_unchanged_elements *kept, bool hexahedra, uint8_t **fixed);
/* ---- Implemented in coarse/graded_carry.c. */
/* Find each solved node's number in the system before the cut; -1 if it has no number there.
 * @param own  Out: an array that the caller frees, or NULL if `out` points into the map.
 * Errors: MEMORY. */
pliant_status pliant_solved_sources(const pliant_system *system, const pliant_system *before,
                                    const pliant_body_map *map, int32_t **own, const int32_t **out);
/* Compute positions of the solved nodes from positions x before the cut. out: (solved nodes x 3) [m]. Errors:
 * MEMORY. */
pliant_status pliant_solved_positions(const pliant_system *system, const pliant_system *before,
                                      const pliant_body_map *map, const double *x, double *out);
/* Return the fine node at the position of a solved node, or -1. */
int32_t pliant_fine_of_solved(const pliant_system *system, const pliant_body *body, int32_t node);
/* ---- Implemented in hexahedra.c. */
/* Build start, node and cell for the cubes of a lattice of complete cubes, without stiffness. Errors: MEMORY. */
pliant_status pliant_system_cubes(pliant_system *system);

/* ---- Implemented in macro.c: the same functions for macro-elements; forces are (corners x 3). */
void pliant_macro_forces(const pliant_system *system, const double *positions, double *forces);
void pliant_macro_gather(const pliant_system *system, const double *forces, double *out);
void pliant_macro_tangents(const pliant_system *system, const double *positions, pliant_tangent *tangents);
pliant_status pliant_macro_number(pliant_system *system); /* requires that the free nodes are numbered */
pliant_status pliant_macro_find_pattern(pliant_system *system);
void pliant_macro_assemble(const pliant_system *system, const pliant_tangent *tangents, double *values);
/* Compute one block column of an element's stiffness: the column of the given corner. blocks: (corners of the element x
 * 9). */
void pliant_macro_column(const pliant_system *system, const pliant_tangent *tangents, int32_t corner, double *blocks);
/* Return the floating-point operations of pliant_macro_assemble. */
double pliant_macro_operations(const pliant_system *system);
/* Add K x to y, on all nodes, with one thread. */
void pliant_macro_multiply(const pliant_system *system, const pliant_tangent *tangents, const double *x, double *y);
double pliant_macro_mean_diagonal(const pliant_system *system); /* computes the missing entries of the system's trace */
/* Return the contribution of an element to the sum of the diagonal. */
double pliant_macro_trace(const pliant_macros *macros, const int32_t *free_of_node, int32_t element);
void pliant_macro_positions(const pliant_system *system, const double *solved, double *fine);
/* Add the derivative of a fine node's position by the positions of the solved nodes, times a weight. */
void pliant_macro_weights(const pliant_system *system, const double *solved, int32_t fine_node, double weight,
                          pliant_weight_blocks *blocks);
void pliant_macros_free(pliant_macros *macros); /* Nullable */

/* ---- Implemented in homogenize.c. */
pliant_status pliant_homogenize(pliant_system *system, const pliant_scene *scene, const pliant_mesh *fine,
                                const uint8_t *fine_fixed, const pliant_tet_material *fine_material,
                                const int32_t *coarse_of_fine, pliant_progress progress);

/* ---- Implemented in cubes.c: the same for hexahedra on the coarse cubes. Errors: MEMORY, NUMERIC, CANCELLED. */
pliant_status pliant_homogenize_cubes(pliant_system *system, const pliant_scene *scene, const pliant_mesh *fine,
                                      const uint8_t *fine_fixed, uint8_t *coarse_fixed,
                                      const pliant_tet_material *fine_material, const int32_t *coarse_of_fine,
                                      pliant_progress progress);

/* ---- Implemented in held_edges.c.
 * Reduce the stiffness of coarse hexahedra that have a held face adjacent to a free face. fixed: (coarse nodes).
 * Errors: MEMORY. */
pliant_status pliant_soften_held_edges(pliant_system *system, const pliant_body *body, const uint8_t *fixed);

/* ---- Implemented in upsample.c. */
pliant_status pliant_upsample_linear(pliant_system *system, const int32_t *coarse_of_fine);
/* Compute the weights of a cube's corners at a point in the solved lattice. A point that coincides with a node of the
 * fine lattice in a coordinate gets exact weights in that coordinate. */
void pliant_trilinear_weights(const pliant_system *system, int32_t cell, const double *point, double weights[8]);
/* Build the upsampling of coarse hexahedra and of tetrahedra next to a cut. element_of_fine: (fine tetrahedra)
 * macro-element. */
pliant_status pliant_upsample_trilinear(pliant_system *system, const int32_t *element_of_fine);
/* Build the trilinear upsampling from the coarse tetrahedra that form the elements. */
pliant_status pliant_upsample_cubes(pliant_system *system, const int32_t *coarse_of_fine);
/* Return whether the solved mesh is the fine mesh, node by node. */
bool pliant_solves_fine(const pliant_system *system);
/* Return whether the weights turn with the tissue and therefore change in every step. */
bool pliant_upsample_turns(const pliant_system *system);
void pliant_upsample_positions(const pliant_system *system, const double *solved, double *fine);
/* Compute M_j = sum of m_i N_ij over all fine nodes ([H] 10).
 * @param mass   (fine nodes) [kg].
 * @param dense  (num_free x 9) [kg], zeroed by the caller.
 * Errors: MEMORY. */
pliant_status pliant_upsample_masses(const pliant_system *system, const double *mass, double *dense);
/* Convert sparse weights of fine nodes to 3 x 3 blocks on the unknowns ([H] 11), and add them. */
void pliant_upsample_weights(const pliant_system *system, const double *solved, int32_t count, const int32_t *nodes,
                             const double *weights, pliant_weight_blocks *blocks);

/* ---- Implemented in factor.c: a wrapper of CHOLMOD. Only one thread at a time may use a factor. */
pliant_status pliant_factor_analyze(const pliant_pattern *pattern, pliant_factor **out);
/* Analyze the pattern. order: Nullable: (num_columns) elimination order of the columns; NULL: CHOLMOD chooses an
 * order. */
pliant_status pliant_factor_analyze_in(const pliant_pattern *pattern, const int32_t *order, pliant_factor **out);
/* Analyze a scalar matrix: its lower triangle in compressed columns, rows ascending. Errors: MEMORY, SCENE. */
pliant_status pliant_factor_analyze_scalar(int32_t size, const int *column_start, const int *row, pliant_factor **out);
/* Write the elimination order (num_columns) and return the number of columns. */
int32_t pliant_factor_order(const pliant_factor *factor, int32_t *order);
/* Use double precision, beginning with the next numeric factorization. */
void pliant_factor_in_double(pliant_factor *factor);
/* Copy the symbolic analysis without numeric values. */
pliant_status pliant_factor_clone(const pliant_factor *factor, pliant_factor **out);
/* Factor the matrix numerically. Errors: NUMERIC (not positive definite), MEMORY; the previous values are lost then. */
pliant_status pliant_factor_numeric(pliant_factor *factor, double *values);
/* Solve for (columns x 3 num_columns) right sides. `right` and `out` may be the same array. Errors: MEMORY. */
pliant_status pliant_factor_solve(pliant_factor *factor, int32_t columns, const double *right, double *out);
/* Prepare a solve in two halves (panels.h), at the given nodes or at nodes whose half solves are stored (half_solve.h).
 * @param possible  Out: the factor has panels; if false, the functions below must not be called.
 * Errors: MEMORY. */
pliant_status pliant_factor_reach(pliant_factor *factor, int32_t count, const int32_t *nodes, bool *possible);
void pliant_factor_begin(pliant_factor *factor, const double *right, double *out);
void pliant_factor_end(pliant_factor *factor, const double *more, double *out);
typedef struct pliant_half_solve pliant_half_solve;
/* Call after pliant_factor_reach. Errors: MEMORY. */
pliant_status pliant_factor_half(pliant_factor *factor, int32_t node, pliant_half_solve *out);
void pliant_factor_half_product(const pliant_factor *factor, const pliant_half_solve *a, const pliant_half_solve *b,
                                double out[9]);
void pliant_factor_begin_half(pliant_factor *factor, const double *right);
/* The solution at the half's node. */
void pliant_factor_half_answer(const pliant_factor *factor, const pliant_half_solve *half, double out[3]);
/* Add a force at the half's node to the right side. */
void pliant_factor_half_add(pliant_factor *factor, const pliant_half_solve *half, const double force[3]);
void pliant_factor_end_half(pliant_factor *factor, double *out);
double pliant_factor_condition(pliant_factor *factor);
/* Return the floating-point operations of a numeric factorization, counted by the analysis; 0 for clones. */
double pliant_factor_operations(const pliant_factor *factor);
/* Return the number of values in the factor, counted by the analysis; 0 for clones. */
double pliant_factor_values(const pliant_factor *factor);
size_t pliant_factor_bytes(const pliant_factor *factor);
void pliant_factor_free(pliant_factor *factor);

/* ---- Implemented in preconditioner.c: an approximate inverse of the stiffness at one state, either a factor or a
 * multigrid cycle. It is symmetric, positive definite, and constant between refreshes. Only one thread at a time may
 * use it. */
/* Create a preconditioner without values. order: Nullable: as in pliant_factor_analyze_in, for a factor. */
pliant_status pliant_preconditioner_create(const pliant_system *system, pliant_preconditioner_choice choice,
                                           const int32_t *order, pliant_preconditioner **out);
/* Create a preconditioner within a basis (basis.h), without values. The basis is borrowed. */
pliant_status pliant_preconditioner_create_in_basis(const pliant_basis *basis, const pliant_system *system,
                                                    pliant_preconditioner **out);
/* Copy analysis and values for use on another thread. */
pliant_status pliant_preconditioner_clone(const pliant_preconditioner *source, int num_threads,
                                          pliant_preconditioner **out);
/* Applies to all later calls. */
void pliant_preconditioner_threads(pliant_preconditioner *preconditioner, int num_threads);
/* Create a preconditioner that carries over a preconditioner from before a cut (carried.h). It is usable after the
 * earlier preconditioner, the base, has been handed over to it.
 * @param of         Discretization that contains of_base.
 * @param of_base    System of the base.
 * @param source     (num_free) unknown in of_base, or -1; this function takes ownership, also on an error.
 * @param positions  (num_nodes x 3) [m]; NULL: pliant_preconditioner_correct corrects the preconditioner later.
 * @param axes       Nullable: (num_free x 9) current axes of the nodes. */
pliant_status pliant_preconditioner_carry(const pliant_system *system, const pliant_discretization *of,
                                          const pliant_system *of_base, int32_t *source, const double *positions,
                                          const double *axes, pliant_preconditioner **out);
/* Correct a carried preconditioner that was created without positions. Call it before the first solve. Other
 * preconditioners are unchanged. Errors: MEMORY, NUMERIC. */
pliant_status pliant_preconditioner_correct(pliant_preconditioner *preconditioner, const double *positions,
                                            const double *axes);
/* Sets *base to NULL. */
void pliant_preconditioner_take_base(pliant_preconditioner *carried, pliant_preconditioner **base);
/* Return the address of a carried preconditioner's base pointer; NULL: it is not carried. */
pliant_preconditioner **pliant_preconditioner_base(pliant_preconditioner *preconditioner);
/* Return the discretization of a carried preconditioner's base, and the source map; NULL: it is not carried. */
const pliant_discretization *pliant_preconditioner_source(const pliant_preconditioner *preconditioner,
                                                          const int32_t **source);
bool pliant_preconditioner_is_multigrid(const pliant_preconditioner *preconditioner); /* true for a multigrid */
/* As pliant_factor_order; 0: it has no factor. */
int32_t pliant_preconditioner_order(const pliant_preconditioner *preconditioner, int32_t *order);
/* Compute the values at these tangents (num_blocks). Errors: NUMERIC, MEMORY; the previous values are lost then. */
pliant_status pliant_preconditioner_numeric(pliant_preconditioner *preconditioner, const pliant_tangent *tangents);
/* Apply the preconditioner. right, out: (columns x 3 num_free); they may be the same array. */
pliant_status pliant_preconditioner_solve(pliant_preconditioner *preconditioner, int32_t columns, const double *right,
                                          double *out);
pliant_factor *pliant_preconditioner_factor(pliant_preconditioner *preconditioner); /* NULL: it has no factor */
/* Return whether a matrix that is not positive definite causes an error. A multigrid does not detect such a matrix. */
bool pliant_preconditioner_can_fail(const pliant_preconditioner *preconditioner);
double pliant_preconditioner_condition(pliant_preconditioner *preconditioner); /* 0: unknown */
double pliant_preconditioner_operations(const pliant_preconditioner *preconditioner); /* of one refresh */
double pliant_preconditioner_apply_operations(const pliant_preconditioner *preconditioner); /* of one application */
/* For a reduction of the residual to 1e-4. */
double pliant_preconditioner_solve_operations(const pliant_preconditioner *preconditioner);
/* Not counted by pliant_memory_in_use. */
size_t pliant_preconditioner_bytes(const pliant_preconditioner *preconditioner);
void pliant_preconditioner_free(pliant_preconditioner *preconditioner);

/* Free the system and its preconditioner. Nullable */
void pliant_system_free(pliant_system *system);

#ifdef __cplusplus
}
#endif

#endif
