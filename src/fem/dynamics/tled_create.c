/* Constant data of TLED: gradients, moduli, masses, gather lists, the largest stable time step. */
#include "base/fail.h"
#include "base/buffer.h"
#include "base/threads.h"
#include "fem/dynamics/loss_factor.h"
#include "fem/dynamics/tled_cubes.h"
#include "fem/dynamics/tled_pressure.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

int pliant_tled_walls(const pliant_scene *scene, pliant_wall walls[PLIANT_MAX_WALLS])
{
    int count = 0;
    const double *normal = scene->ground.normal;
    double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    if (length > 0) {
        pliant_wall *wall = walls + count++;
        wall->offset = 0;
        for (int d = 0; d < 3; d++) {
            wall->normal[d] = normal[d] / length;
            wall->offset += wall->normal[d] * scene->ground.point[d];
        }
    }
    const double nowhere = 1e3; /* a limit of the box at this value means that it is unbounded */
    for (int d = 0; d < 3; d++)
        for (int side = 0; side < 2; side++) {
            double at = side ? scene->ground.box_high[d] : scene->ground.box_low[d];
            if (fabs(at) >= nowhere) continue;
            pliant_wall *wall = walls + count++;
            for (int k = 0; k < 3; k++) wall->normal[k] = 0;
            wall->normal[d] = side ? -1 : 1;
            wall->offset = wall->normal[d] * at;
        }
    return count;
}

/* Set the Prony series of tled/loss_factor. Dynamic relaxation ends at the static modulus anyway. */
static pliant_status set_loss(pliant_tled_system *system, const pliant_scene *scene)
{
    const double widest = 100, low = scene->tled.loss_low, high = scene->tled.loss_high;
    system->stiffening = 1;
    if (scene->tled.loss_factor == 0 || system->quasi_static) return PLIANT_OK;
    if (system->num_prony > 0)
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "tled/loss_factor is %g and makes a Prony series; set it or tled/prony_share to 0",
                           scene->tled.loss_factor);
    if (!(low <= high && high <= widest * low * (1 + 1e-9)))
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "tled/loss_low and loss_high are %g and %g Hz; set the second to 1 to %g times the first",
                           low, high, widest);
    system->num_prony = pliant_loss_terms(scene->tled.loss_factor, low, high, system->prony_share, system->prony_time);
    double fractions = 0;
    for (int term = 0; term < system->num_prony; term++) fractions += system->prony_share[term];
    if (system->num_prony == 0 || fractions >= 1)
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "tled/loss_factor is %g, which no Prony series has from %g to %g Hz; set a smaller one",
                           scene->tled.loss_factor, low, high);
    system->stiffening = 1 / (1 - fractions);
    return PLIANT_OK;
}

static pliant_status set_options(pliant_tled_system *system, const pliant_scene *scene)
{
    double fractions = 0;
    system->law = scene->tled.law;
    system->num_threads = pliant_threads_or_cores(scene->solver.threads);
    system->nodal_pressure = scene->tled.nodal_pressure;
    system->quasi_static = scene->tled.quasi_static;
    system->damping = scene->tled.damping;
    system->stiffness_damping = system->quasi_static ? 0 : scene->tled.stiffness_damping;
    system->safety = scene->tled.safety;
    for (int d = 0; d < 3; d++) {
        if (scene->tled.prony_share[d] > 0) {
            system->prony_share[system->num_prony] = scene->tled.prony_share[d];
            system->prony_time[system->num_prony++] = scene->tled.prony_time[d];
        }
        fractions += scene->tled.prony_share[d];
    }
    if (fractions >= 1)
        return pliant_fail(PLIANT_ERROR_SCENE, "tled/prony_share: the parts that relax add up to %g; less than 1 must",
                           fractions);
    if (system->nodal_pressure && system->law == PLIANT_LAW_SAINT_VENANT_KIRCHHOFF)
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "tled/nodal_pressure: saint_venant_kirchhoff has no separate pressure; take another law");
    system->num_walls = pliant_tled_walls(scene, system->walls);
    system->friction = scene->ground.friction;
    system->restitution = scene->ground.restitution;
    return set_loss(system, scene);
}

static pliant_status allocate(pliant_tled_system *system)
{
    size_t nodes = (size_t)system->mesh->num_nodes, blocks = (size_t)system->num_blocks + 1; /* all may be hexahedra */
    system->gradients = pliant_calloc(blocks, sizeof *system->gradients);
    system->moduli = pliant_calloc(blocks, sizeof *system->moduli);
    system->nodes = pliant_calloc(blocks, sizeof *system->nodes);
    system->corner_start = pliant_calloc(nodes + 1, sizeof *system->corner_start);
    system->corner =
        pliant_calloc(system->cubes ? 4 * (size_t)system->cubes->num_tets + 8 * (size_t)system->cubes->count
                                    : 4 * (size_t)system->mesh->num_tets,
                      sizeof *system->corner);
    system->inverse_mass = pliant_calloc(nodes, sizeof *system->inverse_mass);
    if (system->nodal_pressure) {
        system->node_modulus = pliant_calloc(nodes, sizeof *system->node_modulus);
        system->node_volume = pliant_calloc(nodes, sizeof *system->node_volume);
        if (!system->node_modulus || !system->node_volume) return pliant_fail_memory("the nodal pressures");
    }
    return system->gradients && system->moduli && system->nodes && system->corner_start && system->corner &&
                   system->inverse_mass
               ? PLIANT_OK
               : pliant_fail_memory("the elements");
}

/* Return the number of tetrahedra that are separate elements. */
static int32_t num_own(const pliant_tled_system *system)
{
    return system->cubes ? system->cubes->num_tets : system->mesh->num_tets;
}
static int32_t own_tet(const pliant_tled_system *system, int32_t element)
{
    return system->cubes ? system->cubes->tet[element] : element;
}

static void gather_lists(pliant_tled_system *system)
{
    const pliant_mesh *mesh = system->mesh;
    const pliant_tled_cubes *cubes = system->cubes;
    int32_t *start = system->corner_start;
    const int32_t tets = num_own(system), of_cubes = system->num_blocks * 12 * LANES;
    for (int32_t v = 0; v < 4 * tets; v++) start[mesh->tets[4 * own_tet(system, v / 4) + v % 4] + 1]++;
    for (int32_t v = 0; cubes && v < 8 * cubes->count; v++) start[cubes->cube[v / 8].node[v % 8] + 1]++;
    for (int32_t n = 0; n < mesh->num_nodes; n++) start[n + 1] += start[n];
    /* start[n] first counts up; afterwards it is the start of node n + 1. */
    for (int32_t v = 0; v < 4 * tets; v++) {
        int32_t e = v / 4, place = 12 * LANES * (e / LANES) + 3 * LANES * (v % 4) + e % LANES;
        system->corner[start[mesh->tets[4 * own_tet(system, e) + v % 4]]++] = place;
    }
    for (int32_t v = 0; cubes && v < 8 * cubes->count; v++) {
        int32_t e = v / 8, place = of_cubes + 24 * LANES * (e / LANES) + 3 * LANES * (v % 8) + e % LANES;
        system->corner[start[cubes->cube[e].node[v % 8]]++] = place;
    }
    for (int32_t n = mesh->num_nodes; n > 0; n--) start[n] = start[n - 1];
    start[0] = 0;
}

/* Fill the elements. pseudo_mass (num_nodes) gets the corner masses that give each element a critical step of 1, for
 * dynamic relaxation. A corner needs a fourth of the element's largest eigenvalue: no frequency of the mesh exceeds the
 * largest element frequency (Irons and Treharne 1972). */
static void fill_elements(pliant_tled_system *system, const pliant_tet_material *material, double *pseudo_mass,
                          double *compliance)
{
    const pliant_mesh *mesh = system->mesh;
    for (int32_t e = 0; e < system->num_blocks * LANES; e++) {
        int32_t block = e / LANES, lane = e % LANES,
                tet = own_tet(system, e < num_own(system) ? e : num_own(system) - 1);
        const int32_t *nodes = mesh->tets + 4 * tet;
        double g[12];
        double volume = pliant_mesh_gradients(mesh, tet, g);
        for (int m = 0; m < 9; m++) system->gradients[block][m][lane] = (float)g[3 + m];
        for (int v = 0; v < 4; v++) system->nodes[block][v][lane] = nodes[v];
        if (e >= num_own(system)) continue;
        double lambda = material[tet].lambda, mu = material[tet].mu,
               modulus = pliant_law_modulus(system->law, lambda, mu);
        system->moduli[block][0][lane] = (float)(volume * mu * system->stiffening);
        system->moduli[block][1][lane] = (float)(volume * modulus);
        system->moduli[block][2][lane] = (float)volume;
        double largest = system->quasi_static ? pliant_element_largest_eigenvalue(g, lambda, mu) : 0;
        for (int v = 0; v < 4; v++) {
            pseudo_mass[nodes[v]] += 0.25 * volume * largest;
            compliance[2 * nodes[v]] += 0.25 * volume;
            compliance[2 * nodes[v] + 1] += 0.25 * volume / modulus;
        }
    }
}

/* Add the corner masses that the largest eigenvalue of each hexahedron needs. */
static void add_cubes(const pliant_tled_system *system, const pliant_tet_material *material, double *pseudo_mass)
{
    for (int32_t c = 0; c < system->cubes->count; c++) {
        const pliant_cube *cube = system->cubes->cube + c;
        double size[3], lambda, mu, density,
            volume = pliant_tled_cube_mean(system->mesh, cube, material, &lambda, &mu, &density);
        pliant_tled_cube_size(system->mesh, system->cubes, c, size);
        for (int v = 0; v < 8; v++)
            pseudo_mass[cube->node[v]] += 0.25 * volume * pliant_cube_largest_eigenvalue(size, lambda, mu);
    }
}

/* Compute the bounds. A body that can be cut keeps its bounds from load time. */
static pliant_status find_bounds(const pliant_body *body, const pliant_tled_system *before, pliant_tled_system *system)
{
    if (!before || !body->voxels) return pliant_tled_find_bounds(body, system);
    system->edge_bound = before->edge_bound;
    system->eigenvalue_bound = before->eigenvalue_bound;
    return PLIANT_OK;
}

pliant_status pliant_tled_system_create(const pliant_scene *scene, const pliant_body *body,
                                        const pliant_tled_system *before, pliant_tled_system **out)
{
    const pliant_mesh *mesh = &body->fine;
    size_t nodes = (size_t)mesh->num_nodes;
    pliant_tled_system *system = pliant_calloc(1, sizeof *system);
    double *pseudo_mass = pliant_calloc(nodes, sizeof *pseudo_mass),
           *compliance = pliant_calloc(nodes, 2 * sizeof *compliance);
    pliant_status status = system && pseudo_mass && compliance ? PLIANT_OK : pliant_fail_memory("the elements");
    if (status != PLIANT_OK) goto failed;
    system->mesh = mesh;
    if ((status = set_options(system, scene)) != PLIANT_OK) goto failed;
    if (pliant_tled_has_pressures(system, body, before) &&
        (status = pliant_tled_groups_create(body, &system->groups)) != PLIANT_OK)
        goto failed;
    const pliant_tet_material *material = system->groups ? system->groups->soft : body->fine_material;
    if (scene->element.kind == PLIANT_HEXAHEDRA) {
        double relaxed = 0;
        for (int term = 0; term < system->num_prony; term++) relaxed += system->prony_share[term];
        status = pliant_tled_cubes_create(mesh, material, body->fine_material, system->law, relaxed,
                                          system->stiffening, &system->cubes);
        if (status != PLIANT_OK) goto failed;
    }
    system->num_blocks = (num_own(system) + LANES - 1) / LANES;
    if ((double)pliant_tled_force_count(system) > INT32_MAX) {
        status = pliant_fail(PLIANT_ERROR_SCENE, "%d tetrahedra are too many for tled; use fewer mesh/coarse_cells",
                             mesh->num_tets);
        goto failed;
    }
    if ((status = allocate(system)) != PLIANT_OK) goto failed;
    system->node_mass = system->cubes ? system->cubes->node_mass : body->node_mass;
    fill_elements(system, material, pseudo_mass, compliance);
    if (system->cubes) add_cubes(system, material, pseudo_mass);
    if ((status = find_bounds(body, before, system)) != PLIANT_OK) goto failed;
    gather_lists(system);
    for (size_t n = 0; n < nodes; n++) {
        double mass = system->quasi_static ? pseudo_mass[n] / (system->safety * system->safety) : system->node_mass[n];
        if (!body->fine_fixed[n] && mass > 0) system->inverse_mass[n] = 1 / mass;
        if (!system->nodal_pressure) continue;
        /* The harmonic mean is not stiffer than the elements, so their bound of the time step is valid
         * (Cauchy-Schwarz). */
        system->node_volume[n] = (float)(1 / compliance[2 * n]);
        system->node_modulus[n] = (float)(compliance[2 * n] / compliance[2 * n + 1]);
    }
    if (system->groups &&
        (status = pliant_tled_groups_find(system, body->fine_material, system->groups)) != PLIANT_OK)
        goto failed;
    pliant_free(pseudo_mass);
    pliant_free(compliance);
    *out = system;
    return PLIANT_OK;
failed:
    pliant_free(pseudo_mass);
    pliant_free(compliance);
    pliant_tled_system_free(system);
    return status;
}

void pliant_tled_system_free(pliant_tled_system *system)
{
    if (!system) return;
    pliant_tled_cubes_free(system->cubes);
    pliant_tled_groups_free(system->groups);
    void *blocks[] = {system->gradients, system->moduli,       system->nodes,        system->corner_start,
                      system->corner,    system->inverse_mass, system->node_modulus, system->node_volume};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    pliant_free(system);
}

static pliant_status allocate_state(pliant_tled *tled)
{
    const pliant_tled_system *system = tled->system;
    size_t nodes = (size_t)system->mesh->num_nodes, blocks = (size_t)pliant_tled_blocks(system);
    tled->u = pliant_calloc_pages(nodes, 3 * sizeof *tled->u);
    tled->d = pliant_calloc_pages(nodes, 3 * sizeof *tled->d);
    tled->start_u = pliant_calloc_pages(nodes, 3 * sizeof *tled->start_u);
    tled->start_d = pliant_calloc_pages(nodes, 3 * sizeof *tled->start_d);
    tled->acceleration = pliant_calloc(nodes, 3 * sizeof *tled->acceleration);
    tled->forces = pliant_calloc(pliant_tled_force_count(system), sizeof *tled->forces);
    tled->sums = pliant_calloc((nodes + PLIANT_CHUNK - 1) / PLIANT_CHUNK, sizeof *tled->sums);
    tled->limit = pliant_calloc(nodes, sizeof *tled->limit);
    bool good = tled->u && tled->d && tled->start_u && tled->start_d && tled->acceleration && tled->forces &&
                tled->sums && tled->limit;
    if (good && system->quasi_static) good = (tled->own = pliant_calloc(nodes, 3 * sizeof *tled->own)) != NULL;
    if (good && system->num_prony > 0) {
        tled->memory = pliant_calloc_pages(blocks, sizeof *tled->memory);
        tled->start_memory = pliant_calloc_pages(blocks, sizeof *tled->start_memory);
        good = tled->memory && tled->start_memory;
    }
    if (good && system->nodal_pressure) {
        tled->change = pliant_calloc(blocks, sizeof *tled->change);
        tled->pressure = pliant_calloc(nodes, sizeof *tled->pressure);
        good = tled->change && tled->pressure;
    }
    return good ? PLIANT_OK : pliant_fail_memory("the state of the dynamics");
}

/* Limit stable motion per step to half of the shortest adjacent edge: that is the speed of sound. */
static void set_limits(pliant_tled *tled)
{
    const pliant_mesh *mesh = tled->system->mesh;
    tled->shortest_edge = INFINITY;
    for (int32_t n = 0; n < mesh->num_nodes; n++) tled->limit[n] = INFINITY;
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        const double shortest = pliant_tled_shortest_edge(mesh, mesh->tets + 4 * t), edge = 0.5 * shortest;
        tled->shortest_edge = fmin(tled->shortest_edge, shortest);
        for (int v = 0; v < 4; v++)
            tled->limit[mesh->tets[4 * t + v]] = fmin(tled->limit[mesh->tets[4 * t + v]], edge * edge);
    }
    tled->reach = 0.1 * tled->shortest_edge;
}

/* Set the reference load: it moves every node by a hundredth of half an edge in its first step. It is needed when moved
 * fixed nodes are the only load. */
static void set_smallest_load(pliant_tled *tled)
{
    double mass = 0;
    for (int32_t n = 0; n < tled->system->mesh->num_nodes; n++)
        if (tled->system->inverse_mass[n] > 0) mass += 1 / tled->system->inverse_mass[n];
    tled->smallest_load = tled->system->quasi_static ? mass * pow(0.05 * tled->reach, 2) : 0;
}

pliant_status pliant_tled_create(const pliant_scene *scene, const pliant_tled_system *system, pliant_tled **out)
{
    const double maximum = 1e5;
    pliant_tled *tled = pliant_calloc(1, sizeof *tled);
    if (!tled) return pliant_fail_memory("the state of the dynamics");
    tled->system = system;
    tled->inverse_mass = system->inverse_mass;
    tled->frame = scene->solver.step;
    tled->thread_choice = (pliant_thread_choice){.faster_choice = 1, .wait = 32};
    tled->relaxation_steps = scene->tled.relaxation_steps;
    tled->tolerance = scene->solver.tolerance;
    pliant_status status = PLIANT_OK;
    double count = ceil(tled->frame / (system->safety * fmin(system->edge_bound, system->eigenvalue_bound)) - 1e-9);
    if (system->quasi_static) {
        tled->substeps = tled->relaxation_steps;
        tled->time_step = 1;
    } else if (!(count <= maximum)) {
        status = pliant_fail(
            PLIANT_ERROR_SCENE,
            "tled: the stiffest or lightest element allows sub-steps of %.3g s. So solver/step (%g s) needs %.3g "
            "sub-steps, more than %.0f. Fix bone, use a coarser mesh, or set tled/quasi_static",
            fmin(system->edge_bound, system->eigenvalue_bound), tled->frame, count, maximum);
    } else {
        tled->substeps = (int32_t)fmax(count, 1);
        tled->time_step = tled->frame / tled->substeps;
    }
    if (status == PLIANT_OK) status = allocate_state(tled);
    if (status == PLIANT_OK) status = pliant_tled_pressure_create(tled);
    if (status != PLIANT_OK) {
        pliant_tled_free(tled);
        return status;
    }
    if (!system->quasi_static)
        pliant_log(
            PLIANT_LOG_INFO,
            "tled: at rest steps of %.3g s (edge over speed of sound, [C] 1) and %.3g s (largest eigenvalue) are "
            "stable; %d sub-steps of %.3g s in a step",
            system->edge_bound, system->eigenvalue_bound, tled->substeps, tled->time_step);
    set_limits(tled);
    set_smallest_load(tled);
    pliant_tled_reset(tled);
    *out = tled;
    return PLIANT_OK;
}

void pliant_tled_reset(pliant_tled *tled)
{
    size_t nodes = (size_t)tled->system->mesh->num_nodes;
    memset(tled->u, 0, 3 * nodes * sizeof *tled->u);
    if (tled->memory) memset(tled->memory, 0, (size_t)pliant_tled_blocks(tled->system) * sizeof *tled->memory);
    tled->substeps >>= tled->halvings;
    tled->time_step = ldexp(tled->time_step, tled->halvings);
    tled->halvings = 0;
    pliant_tled_pressure_reset(tled);
    pliant_tled_stop_motion(tled);
}

void pliant_tled_stop_motion(pliant_tled *tled)
{
    size_t nodes = (size_t)tled->system->mesh->num_nodes;
    memset(tled->d, 0, 3 * nodes * sizeof *tled->d);
    if (tled->own) memset(tled->own, 0, 3 * nodes * sizeof *tled->own); /* it may contain NaN */
    memset(tled->quotient, 0, sizeof tled->quotient);
    tled->contact_energy = 0;
}

void pliant_tled_set_limits(pliant_tled *tled, int32_t steps, double tolerance)
{
    tled->tolerance = tolerance;
    if (tled->system->quasi_static) tled->substeps = steps;
}

void pliant_tled_set_node_position(pliant_tled *tled, int32_t node, const double position[3])
{
    for (int d = 0; d < 3; d++) {
        tled->u[3 * node + d] = position[d] - tled->system->mesh->rest[3 * node + d];
        tled->d[3 * node + d] = 0;
    }
}

pliant_status pliant_tled_allow_stop(pliant_tled *tled)
{
    const size_t bytes = (size_t)tled->system->mesh->num_nodes * sizeof *tled->own_inverse_mass;
    if (!(tled->own_inverse_mass = pliant_calloc(1, bytes))) return pliant_fail_memory("the state of the dynamics");
    memcpy(tled->own_inverse_mass, tled->system->inverse_mass, bytes);
    return PLIANT_OK;
}

void pliant_tled_fix_nodes(pliant_tled *tled, int32_t count, const int32_t *nodes)
{
    for (int32_t i = 0; i < count; i++) {
        tled->own_inverse_mass[nodes[i]] = 0;
        memset(tled->d + 3 * (size_t)nodes[i], 0, 3 * sizeof *tled->d);
        memset(tled->acceleration + 3 * (size_t)nodes[i], 0, 3 * sizeof *tled->acceleration);
    }
    tled->inverse_mass = tled->own_inverse_mass;
}

void pliant_tled_free(pliant_tled *tled)
{
    if (!tled) return;
    void *blocks[] = {tled->u,        tled->d,
                      tled->memory,   tled->start_u,
                      tled->start_d,   tled->start_memory,
                      tled->forces,   tled->change,
                      tled->pressure, tled->sums,
                      tled->limit,    tled->acceleration,
                      tled->own,      tled->own_inverse_mass};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    pliant_tled_contacts_free(tled);
    pliant_tled_pressure_free(tled->pressure_of_groups);
    pliant_free(tled);
}
