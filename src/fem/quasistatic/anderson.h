/* Rules of safeguarded Anderson acceleration (type II: Walker and Ni 2011, Anderson acceleration for fixed-point
 * iterations, 2.1). The CPU solver and the kernels in cuda/fem/quasistatic/anderson.cu share them. The solver evaluates
 * states and reports their merit; the rules return the next state to evaluate. The merit of a state is the energy norm
 * of the preconditioned step.
 *
 * Every accepted trial has a lower merit than the state before. After a refusal the rules try, in this order:
 * - a trial with the secant of the refused state;
 * - a trial without secants much larger than the merit, which are too inaccurate for it and become useful again in the
 *   next step;
 * - the preconditioner's plain step;
 * - ever shorter plain steps, continued in the next step if this step ends first.
 *
 * A final step without evaluation (BLIND) is taken after a good step, or if the state would not move otherwise. The
 * first evaluation of the next step judges it. It is usually done at the end of this step. */
#ifndef PLIANT_FEM_QUASISTATIC_ANDERSON_H
#define PLIANT_FEM_QUASISTATIC_ANDERSON_H

#include "base/inline.h"
#include "fem/quasistatic/settings.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_MAX_HISTORY = 20 };
#define PLIANT_ANDERSON_MIN_RATE 1e-3 /* smaller rates are rounding: they count as this one */
typedef enum pliant_anderson_next {
    PLIANT_NEXT_DONE,     /* end the step at the present state */
    PLIANT_NEXT_FIRST,    /* evaluate the initial state of the step */
    PLIANT_NEXT_PREVIOUS, /* evaluate the last evaluated state, from before a doubtful blind step */
    PLIANT_NEXT_TRIAL,
    PLIANT_NEXT_DESCENT, /* take the longest plain step that lowered the potential energy, for any merit */
    PLIANT_NEXT_REST,    /* evaluate the rest state */
    PLIANT_NEXT_BLIND    /* take the proposed step; the step ends */
} pliant_anderson_next;

typedef struct pliant_anderson {
    /* Limits of a step. */
    int32_t max_evaluations;
    int32_t depth;                /* minimum number of secants to keep; 0: none */
    int32_t capacity;             /* maximum number of secants to keep */
    int32_t limits_secants;       /* after refusals, very large secants are left out */
    double tolerance;             /* error at which a step ends, as a fraction of the largest displacement */
    double smallest_displacement; /* lower bound of the largest displacement in this fraction [m] */
    int32_t is_cycle;             /* the preconditioner is a V-cycle */
    /* There is contact. The solver then limits the length of the step, and a doubtful blind step may be as long as any
     * other. */
    int32_t is_bounded;

    /* State between steps. */
    int32_t refused;             /* number of trials since the last accepted trial */
    int32_t omits_large_secants; /* the last trial left out large secants */
    int32_t slow;                /* consecutive steps that hardly lowered the merit */
    int32_t follows_blind_step;  /* the present state follows a blind step and is not evaluated */
    int32_t refused_any;         /* a trial of the last step was refused */
    int32_t last_evaluations;    /* number of evaluations of the last step */
    /* Initial merit of the last step that was compared with the state before its blind step, or that had no blind step
     * before it. */
    double trusted_merit;
    double rate;    /* mean merit ratio per evaluation in the last step; 0: no work was needed */
    double descent; /* largest damping of a plain step that lowered the potential energy; 0: none */
    /* Logarithm of the merit ratio per evaluation, smoothed over steps: a lower bound of the remaining error. */
    double log_contraction;
    double reported_error;               /* reported error of the last step [m] */
    uint64_t num_secants;                /* number of secants so far */
    uint64_t number[PLIANT_MAX_HISTORY]; /* number of the secant in each slot, from 1; 0: empty */

    /* State within this step. */
    int32_t evaluations, rejected;
    int32_t accepted; /* a trial was accepted */
    int32_t last;     /* the trial replaces a blind step and the evaluation of its end */
    int32_t converged;
    double merit;       /* of the present state */
    double first_merit; /* merit at the start of the step */
    double before;      /* merit of the state before the present one */
    /* Estimated error of the final state: largest distance of a node from its converged position [m]. */
    double error;
    /* The same error of the previous step, estimated with this step's secants [m]. */
    double error_before;

    /* Actions for the solver, in this order. */
    int32_t secant_slot;   /* slot for the secant from the present state to the evaluated state; -1: do not store it */
    int32_t accepts_state; /* the evaluated state becomes the present state */
    int32_t drops_secants; /* drop all secants */
    int32_t next;          /* pliant_anderson_next */
    int32_t uses_secants;  /* the proposal uses secants */
    double largest_secant; /* upper limit of a used secant's step energy [J] */
    double damping;
} pliant_anderson;

/* Return the merit of a state from energy = step . residual and the norm of the load. A negative energy beyond rounding
 * means that the preconditioner is not positive definite at this state. Return INFINITY then; such a state is never
 * accepted. */
PLIANT_INLINE double pliant_anderson_merit(double energy, double scale)
{
    const double rounding = 1e-10;
    if (!isfinite(scale) || !isfinite(energy) || !(energy > -rounding * scale * scale)) return INFINITY;
    return energy > 0 ? sqrt(energy) : 0.0;
}

/* Return the number of secants to keep. They cover one and a half steps, and number at least the scene's minimum. Fewer
 * secants do not span the changes within a step. More secants are outdated.
 *
 * Errors with 110 k tetrahedra and rotating gravity:
 *   evaluations per step   secants   error
 *   8                      6         1 to 3 %
 *   8                      10 to 14  0.1 %
 *   8                      18        up to 1.5 %
 *   4                      6         1 %
 *   4                      9         2 % */
PLIANT_INLINE int32_t pliant_anderson_depth(int32_t minimum, int32_t evaluations)
{
    if (minimum == 0) return 0;
    int32_t wanted = evaluations >= PLIANT_MAX_HISTORY
                         ? PLIANT_MAX_HISTORY
                         : (int32_t)(pliant_get_quasistatic_settings().secants_per_evaluation * evaluations + 0.5);
    wanted = wanted > minimum ? wanted : minimum;
    return wanted < PLIANT_MAX_HISTORY ? wanted : PLIANT_MAX_HISTORY;
}

PLIANT_INLINE void pliant_anderson_drop_secants(pliant_anderson *rules)
{
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++) rules->number[h] = 0;
}

PLIANT_INLINE int32_t pliant_anderson_secants(const pliant_anderson *rules)
{
    int32_t count = 0;
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++) count += rules->number[h] > 0;
    return count;
}

/* Return a slot for the next secant. The oldest secants are dropped when all slots are in use. */
PLIANT_INLINE int32_t pliant_anderson_free_slot(pliant_anderson *rules)
{
    int32_t maximum = pliant_anderson_depth(rules->depth, rules->last_evaluations),
            count = pliant_anderson_secants(rules), empty = -1;
    if (maximum > rules->capacity) maximum = rules->capacity;
    for (; count >= maximum; count--) {
        int32_t oldest = -1;
        for (int32_t h = 0; h < rules->capacity; h++)
            if (rules->number[h] > 0 && (oldest < 0 || rules->number[h] < rules->number[oldest])) oldest = h;
        rules->number[oldest] = 0;
    }
    for (int32_t h = rules->capacity - 1; h >= 0; h--)
        if (rules->number[h] == 0) empty = h;
    rules->number[empty] = ++rules->num_secants;
    return empty;
}

/* Return the scaling factor of a secant in the equations of the weights, from its step energy. 0: do not use the
 * secant. */
PLIANT_INLINE double pliant_anderson_scale(double energy, double largest)
{
    return energy > 0 && energy <= largest ? 1.0 / sqrt(energy) : 0.0;
}

/* Return the relative noise of a secant in the error estimate. It grows with the secant's age. Without noise, secants
 * explain small residuals by large motions that cancel. */
PLIANT_INLINE double pliant_anderson_noise(const pliant_anderson *rules, int32_t place)
{
    const double age = (double)(rules->num_secants - rules->number[place]);
    return pliant_get_quasistatic_settings().estimate_noise +
           pliant_get_quasistatic_settings().estimate_noise_growth * age * age;
}

/* Return the factor by which an unexplained error exceeds the next correction. Each evaluation leaves the fraction c of
 * an error that no secant explains. The value is 0.5 for a factor and 0.7 for a V-cycle, which reduces smooth errors
 * slowly. It is not below the smoothed ratio of the merits. The corrections form a geometric series (Aitken), with the
 * sum 1 / (1
 * - c). */
PLIANT_INLINE double pliant_anderson_error_factor(const pliant_anderson *rules)
{
    const pliant_quasistatic_settings settings = pliant_get_quasistatic_settings();
    const double expected = rules->is_cycle ? settings.cycle_contraction : settings.factor_contraction;
    return 1 / (1 - fmin(fmax(expected, exp(rules->log_contraction)), settings.max_contraction));
}

/* Return the error estimate of a node from the remaining motion of an evaluated state. The factor corrects for secants
 * that explain a little too much. */
PLIANT_INLINE double pliant_anderson_error(double left)
{
    return pliant_get_quasistatic_settings().error_safety * left;
}

/* Report the error of the previous step.
 * @param start_is_evaluated  The end of the previous step was evaluated with the present preconditioner.
 * @param left  Remaining motion at that state, with the present secants [m]. */
PLIANT_INLINE void pliant_anderson_report_error(pliant_anderson *rules, bool start_is_evaluated, double left)
{
    rules->error_before = start_is_evaluated ? pliant_anderson_error(left) : rules->reported_error;
    rules->reported_error = rules->error;
}

/* Reset to the rest state without history. The limits stay. */
PLIANT_INLINE void pliant_anderson_reset(pliant_anderson *rules)
{
    rules->refused = rules->omits_large_secants = rules->slow = rules->follows_blind_step = rules->refused_any =
        rules->last_evaluations = 0;
    rules->trusted_merit = rules->rate = rules->descent = 0;
    rules->error = rules->error_before = rules->reported_error = 0;
    rules->log_contraction = log(pliant_get_quasistatic_settings().expected_contraction);
    rules->next = PLIANT_NEXT_DONE;
    pliant_anderson_drop_secants(rules);
}

/* Reset after the state was changed by the caller. */
PLIANT_INLINE void pliant_anderson_reset_after_move(pliant_anderson *rules)
{
    rules->refused = rules->omits_large_secants = rules->slow = rules->follows_blind_step = 0;
    pliant_anderson_drop_secants(rules);
}

PLIANT_INLINE void pliant_anderson_begin(pliant_anderson *rules)
{
    rules->evaluations = rules->rejected = rules->accepted = rules->converged = rules->refused_any = rules->last = 0;
    rules->merit = rules->before = INFINITY;
    rules->accepts_state = rules->drops_secants = 0;
    rules->secant_slot = -1;
    rules->next = PLIANT_NEXT_FIRST;
}

/* ---- After an evaluation. */

PLIANT_INLINE void pliant_anderson_first(pliant_anderson *rules, bool sound)
{
    if (rules->follows_blind_step && sound)
        rules->refused = rules->omits_large_secants = 0; /* the attempts after refusals were successful */
    rules->first_merit = rules->merit;
    rules->follows_blind_step = 0;
}

/* Judge a trial. falls: the potential energy still decreases at the end of a plain step. */
PLIANT_INLINE void pliant_anderson_judge_trial(pliant_anderson *rules, double merit, bool falls)
{
    if (merit < rules->merit) {
        const double weight = pliant_get_quasistatic_settings().contraction_weight;
        if (rules->accepted)
            rules->log_contraction +=
                weight * (log(fmax(merit / rules->merit, PLIANT_ANDERSON_MIN_RATE)) - rules->log_contraction);
        rules->secant_slot = isfinite(merit) && rules->depth > 0 ? 0 : -1;
        rules->accepts_state = rules->accepted = 1;
        rules->before = rules->merit;
        rules->merit = merit;
        rules->refused = 0;
        rules->descent = 0;
        return;
    }
    if (rules->refused < 2 || rules->uses_secants)
        rules->secant_slot = isfinite(merit) && rules->depth > 0 ? 0 : -1;
    else if (falls)
        rules->descent = fmax(rules->descent, rules->damping);
    rules->refused += !(rules->omits_large_secants && rules->uses_secants);
    rules->refused_any = 1;
    rules->rejected++;
}

/* Judge the evaluated state. Return true if `next` already holds the next action. */
PLIANT_INLINE bool pliant_anderson_judge_state(pliant_anderson *rules, double merit, bool falls)
{
    const double too_high = pliant_get_quasistatic_settings().max_blind_growth;
    const bool lower = merit < rules->merit;
    switch (rules->next) {
    case PLIANT_NEXT_FIRST:
        rules->merit = rules->first_merit = merit;
        if (rules->follows_blind_step && !(merit < too_high * rules->trusted_merit)) {
            rules->next = PLIANT_NEXT_PREVIOUS;
            return true;
        }
        if (!rules->follows_blind_step || merit < rules->trusted_merit) rules->trusted_merit = merit;
        pliant_anderson_first(rules, true);
        return false;
    case PLIANT_NEXT_PREVIOUS:
        rules->accepts_state = rules->drops_secants = lower;
        if (lower) rules->merit = merit;
        rules->trusted_merit = rules->merit;
        pliant_anderson_first(rules, !lower);
        return false;
    case PLIANT_NEXT_REST:
        rules->accepts_state = rules->drops_secants = lower;
        if (lower) rules->merit = merit;
        rules->next = PLIANT_NEXT_DONE;
        return true;
    case PLIANT_NEXT_DESCENT:
        /* For other loads or tools, a descent direction found several steps ago may no longer descend. It is dropped
         * then. */
        rules->descent = 0;
        if (!falls) return false;
        rules->accepts_state = rules->drops_secants = 1;
        rules->merit = merit;
        rules->refused = 0;
        return false;
    default: pliant_anderson_judge_trial(rules, merit, falls); return false;
    }
}

/* End the step. Return false if no trial makes progress. */
PLIANT_INLINE bool pliant_anderson_finish(pliant_anderson *rules)
{
    const double slow = pliant_get_quasistatic_settings().slow_rate; /* ratio of successive merits */
    const int32_t steps = rules->evaluations - 1;
    rules->last_evaluations = rules->evaluations;
    rules->rate = steps > 0 && rules->first_merit > 0 ? pow(rules->merit / rules->first_merit, 1.0 / steps) : 0.0;
    if (rules->accepted) rules->refused = 0;
    rules->slow = rules->rate > slow && !rules->converged ? rules->slow + 1 : 0;
    return rules->refused < pliant_get_quasistatic_settings().max_refused &&
           rules->slow < pliant_get_quasistatic_settings().max_slow;
}

/* Evaluate the rest state. It may be the better start of the next step, for example after a collapse. */
PLIANT_INLINE void pliant_anderson_try_rest(pliant_anderson *rules)
{
    rules->refused = rules->slow = 0;
    rules->next = PLIANT_NEXT_REST;
}

PLIANT_INLINE void pliant_anderson_propose(pliant_anderson *rules)
{
    const double still_true =
        pliant_get_quasistatic_settings().secant_limit; /* largest used secant as a multiple of the merit */
    rules->omits_large_secants =
        rules->refused == 2 && !rules->omits_large_secants && isfinite(rules->merit) && rules->limits_secants;
    rules->uses_secants = rules->refused < 2 || rules->omits_large_secants;
    rules->largest_secant = rules->omits_large_secants ? pow(still_true * rules->merit, 2.0) : INFINITY;
    rules->damping = rules->refused < 3 ? 1.0 : ldexp(1.0, 2 - rules->refused);
}

/* Judge the evaluated state and choose the next action.
 * @param slope       For a trial without secants: product of its step with the residual at its end. 0 with springs,
 *     whose energy is not part of the potential energy.
 * @param affordable  Number of evaluations that fit in the time budget, including the evaluation at the end of the
 *     step.
 *
 * A step that would not end blindly has another trial instead. */
PLIANT_INLINE void pliant_anderson_judge(pliant_anderson *rules, double merit, double slope, int32_t affordable)
{
    const double went_well = pliant_get_quasistatic_settings().good_rate; /* ratio of successive merits */
    const bool falls = isfinite(merit) && slope > 0;
    rules->evaluations++;
    rules->accepts_state = rules->drops_secants = 0;
    rules->secant_slot = -1;
    if (pliant_anderson_judge_state(rules, merit, falls)) return;
    if (rules->secant_slot == 0) rules->secant_slot = pliant_anderson_free_slot(rules);
    if (rules->drops_secants) pliant_anderson_drop_secants(rules);
    const int32_t iterations = rules->max_evaluations + 1 - rules->evaluations,
                  left = iterations < affordable ? iterations : affordable;
    if (rules->refused >= pliant_get_quasistatic_settings().max_refused && rules->descent > 0 && left >= 1) {
        /* The merit has a minimum here that is no equilibrium, next to a state that the tissue leaves by snapping. The
         * potential energy still decreases. */
        rules->next = PLIANT_NEXT_DESCENT;
        rules->last = rules->last || left == 1;
        rules->uses_secants = 0;
        rules->damping = rules->descent;
        return;
    }
    pliant_anderson_propose(rules);
    const bool goes_on =
        rules->accepted ? rules->refused == 0 && rules->merit < went_well * rules->before : isfinite(rules->merit);
    if (rules->refused < pliant_get_quasistatic_settings().max_refused && !rules->last &&
        (left > 1 || (left == 1 && !goes_on))) {
        rules->last = left == 1;
        rules->next = PLIANT_NEXT_TRIAL;
        return;
    }
    rules->next = goes_on && !rules->last ? PLIANT_NEXT_BLIND : PLIANT_NEXT_DONE;
    if (pliant_anderson_finish(rules) || left < 1) return;
    rules->last = rules->last || left == 1;
    pliant_anderson_try_rest(rules);
}

/* Finish a proposal (TRIAL, BLIND, DONE).
 * @param mixed  Weights of secants were found.
 * @param left   Largest remaining motion of a node, from the secants and the residual [m].
 * @param made   Largest motion of a node by the proposal [m]. */
PLIANT_INLINE void pliant_anderson_finish_proposal(pliant_anderson *rules, bool mixed, double left, double made,
                                                   double displacement)
{
    const double foreseen = pliant_get_quasistatic_settings().expected_contraction;
    /* Rounding has made the secants' products inconsistent; no step can use them. */
    const bool useless = rules->uses_secants && !mixed && pliant_anderson_secants(rules) > 0;
    rules->uses_secants = rules->uses_secants && mixed;
    rules->drops_secants =
        rules->next != PLIANT_NEXT_DONE && ((rules->refused == 2 && !rules->uses_secants) || useless);
    rules->error = pliant_anderson_error(left);
    if (isfinite(rules->merit) && rules->error <= rules->tolerance * fmax(displacement, rules->smallest_displacement)) {
        rules->converged = 1;
        rules->drops_secants = 0;
        if (rules->next == PLIANT_NEXT_TRIAL) pliant_anderson_finish(rules);
        rules->next = PLIANT_NEXT_DONE;
    }
    if (rules->drops_secants) pliant_anderson_drop_secants(rules);
    const bool ends = rules->next == PLIANT_NEXT_BLIND,
               doubted = !rules->accepted && !(rules->refused == 0 && rules->uses_secants);
    if (ends && !(made <= rules->smallest_displacement * (doubted && !rules->is_bounded
                                                              ? pliant_get_quasistatic_settings().max_doubtful_step
                                                              : pliant_get_quasistatic_settings().max_displacement)))
        rules->next = PLIANT_NEXT_DONE;
    if (!ends) return;
    /* Until the final state is evaluated. */
    if (rules->next == PLIANT_NEXT_BLIND && rules->refused == 0) rules->error *= foreseen;
    rules->follows_blind_step = rules->next == PLIANT_NEXT_BLIND;
    if (!doubted) return;
    rules->omits_large_secants = 1; /* if this step fails, these attempts are not repeated */
    rules->refused = rules->uses_secants ? 2 : rules->refused < 3 ? 3 : rules->refused + 1;
}

/* ---- After the blind step at the end of a step. */

/* Judge the end of a blind step, evaluated in advance of the next step. It becomes the present state, and the blind
 * step becomes a secant. Return false if the state is invalid. */
PLIANT_INLINE bool pliant_anderson_judge_end(pliant_anderson *rules, double merit)
{
    const bool good = isfinite(merit);
    rules->accepts_state = 1;
    rules->drops_secants = 0;
    rules->secant_slot = good && rules->depth > 0 ? pliant_anderson_free_slot(rules) : -1;
    return good;
}

#ifdef __cplusplus
}
#endif
#endif
