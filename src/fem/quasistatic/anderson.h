/* The rules of safeguarded Anderson acceleration (type II: Walker and Ni 2011, Anderson acceleration for fixed-point iterations, 2.1),
 * for the CPU's solver and for the kernels of cuda/fem/quasistatic/anderson.cu: whoever evaluates states tells their merit, and is told what to evaluate
 * next. A merit is the energy norm of the step that the preconditioner finds for a state.
 *
 * Every trial that is accepted has a lower merit than the state before. After a refusal: once more with what the refused state taught;
 * then without secants that are far larger than what is left, of which they are not true enough, though they will be of the next step;
 * then the preconditioner's own step; then ever shorter ones, into the next step where this one ends first. A last step that is not judged
 * (BLIND) is taken where the one before went well, or where the frame would not move otherwise, and judged by the first evaluation of the
 * next step, which is most often made at the end of this one. */
#ifndef PLIANT_FEM_QUASISTATIC_ANDERSON_H
#define PLIANT_FEM_QUASISTATIC_ANDERSON_H

#include "base/inline.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_MAX_HISTORY = 20 };
enum { PLIANT_MOST_REFUSED = 12, PLIANT_MOST_SLOW = 10 };

/* Secants are not exact: of their steps, relative, in a trial that is looked at before it is taken. */
#define PLIANT_NOISE_OF_TRIAL 1e-5
/* Merit after over before an evaluation above which the preconditioner serves badly: it is made anew, or in other axes. */
#define PLIANT_SERVES_BADLY 0.15
/* Evaluations after which the axes of the nodes follow the tissue (nodal_rotations.h): it costs little beside them. */
#define PLIANT_EVALUATIONS_A_TURN 2

/* In thousandths of the body's length (smallest_displacement): a blind step that nothing speaks for moves no node farther than this, where
 * plain steps still mean something: of tissue that hangs by little they are metres; and what is farther from rest than that is no state. */
#define PLIANT_FARTHEST_DOUBTED 100.0
#define PLIANT_FARTHEST 100000.0

typedef enum pliant_anderson_next {
    PLIANT_NEXT_DONE,      /* the step ends where it is */
    PLIANT_NEXT_FIRST,     /* the state that the step begins with */
    PLIANT_NEXT_PREVIOUS,  /* the last state that was evaluated, before a blind step that is in doubt */
    PLIANT_NEXT_TRIAL,
    PLIANT_NEXT_DESCENT,   /* the longest plain step along which the potential energy fell, whatever the merit */
    PLIANT_NEXT_REST,      /* the body at rest */
    PLIANT_NEXT_BLIND      /* take the proposed step; the step ends */
} pliant_anderson_next;

typedef struct pliant_anderson {
    /* limits of a step */
    int32_t most_evaluations;
    int32_t depth;             /* secants that are kept at least; 0: none */
    int32_t room;              /* and at most */
    int32_t limits_secants;    /* after refusals, secants may be too large to be used */
    double tolerance;          /* of the largest displacement: error at which a step ends */
    double smallest_displacement; /* which counts for at least so much [m] */
    int32_t is_cycle;          /* the preconditioner is a V-cycle */
    int32_t is_bounded;        /* something touches: who asks bounds how far the step may go, and a blind one that nothing speaks for may go as far as any */

    /* from step to step */
    int32_t refused;           /* trials since the last accepted one */
    int32_t limited;           /* the last of them was without large secants */
    int32_t slow;              /* steps in a row that hardly lowered the merit */
    int32_t blind;             /* the state is one step beyond what was evaluated */
    int32_t refused_any;          /* a trial of the last step was refused */
    int32_t last_evaluations;  /* of the last step */
    double sound_merit;        /* that the last step began with that was compared with the state before a blind step, or followed none */
    double rate;               /* merit after over before an evaluation, last step's mean; 0: there was nothing to do */
    double descent;            /* longest damping of a plain step along which the potential energy fell; 0: none */
    double log_contraction;    /* of the merit by an evaluation, smoothed over steps: what it leaves of an error at least */
    double told;               /* error of the last step [m] */
    uint64_t num_secants;      /* that there ever were */
    uint64_t number[PLIANT_MAX_HISTORY]; /* of the secant in a place, counted from 1; 0: none */

    /* this step */
    int32_t evaluations, rejected;
    int32_t accepted;          /* a trial was */
    int32_t last;              /* the trial is in place of a blind step and the evaluation of its end */
    int32_t converged;
    double merit;              /* of the present state */
    double first_merit;        /* that the step began with */
    double before;             /* of the state before the present one */
    double error;              /* estimate of the state that the step ends with: largest distance of a node from where it would converge [m] */
    double error_before;       /* the same of the step before, as this one's secants have it [m] */

    /* what is to be done, in this order */
    int32_t keep;              /* the secant from the present state to the one evaluated, in this place; -1: none */
    int32_t take;              /* what was evaluated becomes the present state */
    int32_t forget;            /* all secants */
    int32_t next;              /* pliant_anderson_next */
    int32_t mixes;             /* its proposal: with secants */
    double largest_secant;     /* those whose step's energy is not above this [J] */
    double damping;
} pliant_anderson;

/* The merit of a state from energy = step . residual and the norm of the load. Below zero by more than rounding, what stands for the
 * inverse of the stiffness is not positive there: no measure, and such a state is never accepted. */
PLIANT_INLINE double pliant_anderson_merit(double energy, double scale)
{
    const double rounding = 1e-10;
    if (!isfinite(scale) || !isfinite(energy) || !(energy > -rounding * scale * scale)) return INFINITY;
    return energy > 0 ? sqrt(energy) : 0.0;
}

/* Secants worth keeping: those of a step and a half, of so many evaluations each, and no fewer than the scene asks for. Less does not
 * span what a step learns, more reaches back to where the tissue was another. (110 k tetrahedra, gravity that turns: of 8 evaluations a
 * step 6 secants leave 1 to 3 % of error, 10 to 14 0.1 %, 18 up to 1.5 %; of 4, 6 leave 1 %, 9 2 %.) */
PLIANT_INLINE int32_t pliant_anderson_depth(int32_t least, int32_t evaluations)
{
    if (least == 0) return 0;
    int32_t wanted = evaluations >= PLIANT_MAX_HISTORY ? PLIANT_MAX_HISTORY : (3 * evaluations + 1) / 2;
    wanted = wanted > least ? wanted : least;
    return wanted < PLIANT_MAX_HISTORY ? wanted : PLIANT_MAX_HISTORY;
}

PLIANT_INLINE void pliant_anderson_forget(pliant_anderson *rules)
{
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++) rules->number[h] = 0;
}

PLIANT_INLINE int32_t pliant_anderson_secants(const pliant_anderson *rules)
{
    int32_t count = 0;
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++) count += rules->number[h] > 0;
    return count;
}

/* A place for the next secant: the oldest ones give way. */
PLIANT_INLINE int32_t pliant_anderson_place(pliant_anderson *rules)
{
    int32_t most = pliant_anderson_depth(rules->depth, rules->last_evaluations), count = pliant_anderson_secants(rules), empty = -1;
    if (most > rules->room) most = rules->room;
    for (; count >= most; count--) {
        int32_t oldest = -1;
        for (int32_t h = 0; h < rules->room; h++)
            if (rules->number[h] > 0 && (oldest < 0 || rules->number[h] < rules->number[oldest])) oldest = h;
        rules->number[oldest] = 0;
    }
    for (int32_t h = rules->room - 1; h >= 0; h--)
        if (rules->number[h] == 0) empty = h;
    rules->number[empty] = ++rules->num_secants;
    return empty;
}

/* Of a secant whose step has this energy: what it is divided by in the equations of the weights, as an inverse; 0: it is not used. */
PLIANT_INLINE double pliant_anderson_scale(double energy, double largest) { return energy > 0 && energy <= largest ? 1.0 / sqrt(energy) : 0.0; }

/* And in an estimate of what is left, where secants taken for exact explain small residuals by large moves that cancel: the less exact, the
 * more secants have come since the one in a place. */
PLIANT_INLINE double pliant_anderson_noise(const pliant_anderson *rules, int32_t place)
{
    const double newest = 0.01, aged = 0.03, age = (double)(rules->num_secants - rules->number[place]);
    return newest + aged * age * age;
}

/* Of an error that no secant explains every evaluation leaves a part c: half, of a V-cycle, which hides slow errors, more, and no less than the
 * merits have shown. Corrections are a geometric series then (Aitken), and that part of the error is so many times the next one, 1 / (1 - c). */
PLIANT_INLINE double pliant_anderson_unexplained(const pliant_anderson *rules)
{
    const double factor = 0.5, cycle = 0.7, most = 0.8;
    return 1 / (1 - fmin(fmax(rules->is_cycle ? cycle : factor, exp(rules->log_contraction)), most));
}

/* Largest error of a node, from what is left at an evaluated state, of which secants explain a little too much away. */
PLIANT_INLINE double pliant_anderson_error(double left)
{
    const double too_little = 1.25;
    return too_little * left;
}

/* Evaluations of a step, but for that of its end, and the trial in its place. */
PLIANT_INLINE int32_t pliant_anderson_iterations(const pliant_anderson *rules) { return rules->evaluations - rules->last; }

/* The last word of a step: on the step before. seen: its end was evaluated, with what is the preconditioner now; left: there, with the secants
 * of now. */
PLIANT_INLINE void pliant_anderson_tell(pliant_anderson *rules, bool seen, double left)
{
    rules->error_before = seen ? pliant_anderson_error(left) : rules->told;
    rules->told = rules->error;
}

/* at rest, nothing known; limits stay */
PLIANT_INLINE void pliant_anderson_reset(pliant_anderson *rules)
{
    rules->refused = rules->limited = rules->slow = rules->blind = rules->refused_any = rules->last_evaluations = 0;
    rules->sound_merit = rules->rate = rules->descent = 0;
    rules->error = rules->error_before = rules->told = 0;
    rules->log_contraction = log(0.3);
    rules->next = PLIANT_NEXT_DONE;
    pliant_anderson_forget(rules);
}

/* The state was changed from outside. */
PLIANT_INLINE void pliant_anderson_moved(pliant_anderson *rules)
{
    rules->refused = rules->limited = rules->slow = rules->blind = 0;
    pliant_anderson_forget(rules);
}

PLIANT_INLINE void pliant_anderson_begin(pliant_anderson *rules)
{
    rules->evaluations = rules->rejected = rules->accepted = rules->converged = rules->refused_any = rules->last = 0;
    rules->merit = rules->before = INFINITY;
    rules->take = rules->forget = 0;
    rules->keep = -1;
    rules->next = PLIANT_NEXT_FIRST;
}

/* ---- after an evaluation */

PLIANT_INLINE void pliant_anderson_first(pliant_anderson *rules, bool sound)
{
    if (rules->blind && sound) rules->refused = rules->limited = 0; /* what was tried after refusals was good */
    rules->first_merit = rules->merit;
    rules->blind = 0;
}

/* falls: the potential energy still does where a plain step has led to */
PLIANT_INLINE void pliant_anderson_judge_trial(pliant_anderson *rules, double merit, bool falls)
{
    if (merit < rules->merit) {
        const double weight = 0.2, least = 1e-3;
        if (rules->accepted) rules->log_contraction += weight * (log(fmax(merit / rules->merit, least)) - rules->log_contraction);
        rules->keep = isfinite(merit) && rules->depth > 0 ? 0 : -1;
        rules->take = rules->accepted = 1;
        rules->before = rules->merit;
        rules->merit = merit;
        rules->refused = 0;
        rules->descent = 0;
        return;
    }
    if (rules->refused < 2 || rules->mixes) rules->keep = isfinite(merit) && rules->depth > 0 ? 0 : -1;
    else if (falls) rules->descent = fmax(rules->descent, rules->damping);
    rules->refused += !(rules->limited && rules->mixes);
    rules->refused_any = 1;
    rules->rejected++;
}

/* what has been evaluated; true: the step goes on with what is in next already */
PLIANT_INLINE bool pliant_anderson_judge_state(pliant_anderson *rules, double merit, bool falls)
{
    const double too_high = 2;
    const bool lower = merit < rules->merit;
    switch (rules->next) {
    case PLIANT_NEXT_FIRST:
        rules->merit = rules->first_merit = merit;
        if (rules->blind && !(merit < too_high * rules->sound_merit)) {
            rules->next = PLIANT_NEXT_PREVIOUS;
            return true;
        }
        if (!rules->blind || merit < rules->sound_merit) rules->sound_merit = merit;
        pliant_anderson_first(rules, true);
        return false;
    case PLIANT_NEXT_PREVIOUS:
        rules->take = rules->forget = lower;
        if (lower) rules->merit = merit;
        rules->sound_merit = rules->merit;
        pliant_anderson_first(rules, !lower);
        return false;
    case PLIANT_NEXT_REST:
        rules->take = rules->forget = lower;
        if (lower) rules->merit = merit;
        rules->next = PLIANT_NEXT_DONE;
        return true;
    case PLIANT_NEXT_DESCENT:
        /* found steps ago, for other loads or tools, it may no longer lead down: then it is left */
        rules->descent = 0;
        if (!falls) return false;
        rules->take = rules->forget = 1;
        rules->merit = merit;
        rules->refused = 0;
        return false;
    default:
        pliant_anderson_judge_trial(rules, merit, falls);
        return false;
    }
}

/* The step's end; false: nothing leads on from here, and the body at rest may be the better place to start from, after collapses and
 * other states that no tissue is in. */
PLIANT_INLINE bool pliant_anderson_finish(pliant_anderson *rules)
{
    const double slow = 0.9; /* merit over the merit before */
    const int32_t steps = rules->evaluations - 1;
    rules->last_evaluations = rules->evaluations;
    rules->rate = steps > 0 && rules->first_merit > 0 ? pow(rules->merit / rules->first_merit, 1.0 / steps) : 0.0;
    if (rules->accepted) rules->refused = 0;
    rules->slow = rules->rate > slow && !rules->converged ? rules->slow + 1 : 0;
    if (rules->refused < PLIANT_MOST_REFUSED && rules->slow < PLIANT_MOST_SLOW) return true;
    rules->refused = rules->slow = 0;
    return false;
}

PLIANT_INLINE void pliant_anderson_propose(pliant_anderson *rules)
{
    const double still_true = 30; /* secants up to so many times the merit */
    rules->limited = rules->refused == 2 && !rules->limited && isfinite(rules->merit) && rules->limits_secants;
    rules->mixes = rules->refused < 2 || rules->limited;
    rules->largest_secant = rules->limited ? pow(still_true * rules->merit, 2.0) : INFINITY;
    rules->damping = rules->refused < 3 ? 1.0 : ldexp(1.0, 2 - rules->refused);
}

/* After an evaluation of what was asked for. slope: for a trial without secants its step's own product with the residual where it leads
 * to; 0 where springs pull, which have no part in the potential energy. affordable: evaluations that there is time for, that of the step's
 * end too. A step that would not end blindly has another trial in its place. */
PLIANT_INLINE void pliant_anderson_judge(pliant_anderson *rules, double merit, double slope, int32_t affordable)
{
    const double went_well = 0.5; /* merit over the merit before */
    const bool falls = isfinite(merit) && slope > 0;
    rules->evaluations++;
    rules->take = rules->forget = 0;
    rules->keep = -1;
    if (pliant_anderson_judge_state(rules, merit, falls)) return;
    if (rules->keep == 0) rules->keep = pliant_anderson_place(rules);
    if (rules->forget) pliant_anderson_forget(rules);
    if (rules->refused >= PLIANT_MOST_REFUSED && rules->descent > 0) {
        /* The merit has a minimum here that is no equilibrium: beside a state that the tissue leaves, as it snaps over. Its energy falls on. */
        rules->next = PLIANT_NEXT_DESCENT;
        rules->mixes = 0;
        rules->damping = rules->descent;
        return;
    }
    pliant_anderson_propose(rules);
    const int32_t iterations = rules->most_evaluations + 1 - rules->evaluations, left = iterations < affordable ? iterations : affordable;
    const bool goes_on = rules->accepted ? rules->refused == 0 && rules->merit < went_well * rules->before : isfinite(rules->merit);
    if (rules->refused < PLIANT_MOST_REFUSED && !rules->last && (left > 1 || (left == 1 && !goes_on))) {
        rules->last = left == 1;
        rules->next = PLIANT_NEXT_TRIAL;
        return;
    }
    rules->next = !pliant_anderson_finish(rules) ? PLIANT_NEXT_REST : goes_on && !rules->last ? PLIANT_NEXT_BLIND : PLIANT_NEXT_DONE;
}

/* After a proposal (TRIAL, BLIND, DONE). mixed: weights were to be had. left: the largest move of a node that the secants and the residual
 * call for; made: by the proposal [m]. */
PLIANT_INLINE void pliant_anderson_settle(pliant_anderson *rules, bool mixed, double left, double made, double displacement)
{
    const double foreseen = 0.3;
    /* secants whose products are no longer those of any vectors, by rounding, are of no use to any step */
    const bool useless = rules->mixes && !mixed && pliant_anderson_secants(rules) > 0;
    rules->mixes = rules->mixes && mixed;
    rules->forget = rules->next != PLIANT_NEXT_DONE && ((rules->refused == 2 && !rules->mixes) || useless);
    rules->error = pliant_anderson_error(left);
    if (isfinite(rules->merit) && rules->error <= rules->tolerance * fmax(displacement, rules->smallest_displacement)) {
        rules->converged = 1;
        rules->forget = 0;
        if (rules->next == PLIANT_NEXT_TRIAL) pliant_anderson_finish(rules);
        rules->next = PLIANT_NEXT_DONE;
    }
    if (rules->forget) pliant_anderson_forget(rules);
    const bool ends = rules->next == PLIANT_NEXT_BLIND, doubted = !rules->accepted && !(rules->refused == 0 && rules->mixes);
    if (ends && !(made <= rules->smallest_displacement * (doubted && !rules->is_bounded ? PLIANT_FARTHEST_DOUBTED : PLIANT_FARTHEST))) rules->next = PLIANT_NEXT_DONE;
    if (!ends) return;
    if (rules->next == PLIANT_NEXT_BLIND && rules->refused == 0) rules->error *= foreseen; /* until the end is evaluated, if it is */
    rules->blind = rules->next == PLIANT_NEXT_BLIND;
    if (!doubted) return;
    rules->limited = 1; /* where it turns out to lead nowhere, these have been tried */
    rules->refused = rules->mixes ? 2 : rules->refused < 3 ? 3 : rules->refused + 1;
}

/* ---- after the blind step that a step ends with */

/* The state there was evaluated as well, in place of the beginning of the next step: it is the present one now, and the way to it a secant.
 * false: it is no state */
PLIANT_INLINE bool pliant_anderson_judge_end(pliant_anderson *rules, double merit)
{
    const bool good = isfinite(merit);
    rules->take = 1;
    rules->forget = 0;
    rules->keep = good && rules->depth > 0 ? pliant_anderson_place(rules) : -1;
    return good;
}

#ifdef __cplusplus
}
#endif
#endif
