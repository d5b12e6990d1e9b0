/* Settings of the quasi-static solver that no scene option sets: Anderson acceleration (anderson.h), even steps
 * (evaluation_limit.h) and the first step after a cut (newton_rules.h). They are constants: CPU and GPU compile the
 * same values.
 *
 * Not listed here: capacities of arrays, and rounding tolerances. They stand in the code that needs them. */
#ifndef PLIANT_FEM_QUASISTATIC_SETTINGS_H
#define PLIANT_FEM_QUASISTATIC_SETTINGS_H

#include <stdint.h>

/* SETTING(type, name, value, unit, meaning, source, effect of half the value, effect of twice the value).
 * "Merit" is the energy norm of the next step, "rate" is the merit after an evaluation divided by the merit before it,
 * and a "body length" is the longest side of the mesh. "NUMERICS.md" means the file in this folder.
 *
 * Effects are measured with one setting changed; effects that no such scene shows follow from the meaning.
 * pull: pliant_deform launch/scenes/demo.yaml --tools demo_pull.yaml --steps 25 --set solver/iterations=5. Takes 85
 *     evaluations, with a mean residual of 0.0011, and all steps converge. Differences refer to the last positions.
 * cut: pliant_deform launch/scenes/resect.yaml --tools resect_path.yaml. Takes 42 evaluations in 51 steps. */
#define PLIANT_QUASISTATIC_SETTING_LIST(SETTING) \
    /* ---- Anderson acceleration */ \
    SETTING(int32_t, max_refused, 12, "trials", "successive refused trials after which the solver tries other states", \
            "the last of them is 1/1024 of a plain step", "cut and pull: the same", "cut and pull: the same") \
    SETTING(int32_t, max_slow, 10, "steps", "successive slow steps after which the solver tries the rest state", \
            "a collapsed body leaves its state within 0.2 s", "cut and pull: the same", "cut and pull: the same") \
    SETTING(double, slow_rate, 0.9, "1", "rate above which a step is slow", "as for max_slow", \
            "cut and pull: the same", "cut and pull: the same") \
    SETTING(double, poor_rate, 0.15, "1", "rate above which the preconditioner is rebuilt or rotated", "NUMERICS.md", \
            "cut and pull: the same", "pull: 85 evaluations, residual 0.0015") \
    SETTING(double, good_rate, 0.5, "1", "rate below which a step may end with a blind step", "NUMERICS.md", \
            "cut and pull: the same", "pull: 85 evaluations, residual 0.0017, 4 steps do not converge") \
    SETTING(double, max_blind_growth, 2, "1", "growth of the merit by a blind step above which the step is in doubt", \
            "NUMERICS.md", "cut and pull: the same", "cut and pull: the same") \
    SETTING(int32_t, rotation_interval, 2, "evaluations", "evaluations between rotations of the nodes' axes", \
            "a rotation costs little compared with them", "cut and pull: the same", "cut and pull: the same") \
    SETTING(double, secants_per_evaluation, 1.5, "1", "secants that are kept, per evaluation of a step", \
            "110 k tetrahedra, rotating gravity: table at pliant_anderson_depth", \
            "pull: 85 evaluations, residual 0.0013", "pull: 91 evaluations, residual 0.0013, 2 steps do not converge") \
    SETTING(double, secant_limit, 30, "merit", "largest secant that is used after two refusals", "NUMERICS.md", \
            "pull: 85 evaluations, residual 0.0011", "pull: 81 evaluations, residual 0.0012") \
    SETTING(double, trial_noise, 1e-5, "1", "relative error of the secants in a trial", "NUMERICS.md", \
            "pull: 88 evaluations, residual 0.0011", "pull: 82 evaluations, residual 0.0013") \
    SETTING(double, estimate_noise, 0.01, "1", "relative error of the newest secant in the error estimate", \
            "error_estimates_test", "cut and pull: the same", "cut and pull: the same") \
    SETTING(double, estimate_noise_growth, 0.03, "1", "growth of that error with the square of the secant's age", \
            "error_estimates_test", "cut and pull: the same", "pull: 84 evaluations, residual 0.0014") \
    SETTING(double, factor_contraction, 0.5, "1", \
            "fraction of an unexplained error that an evaluation leaves, with a factor", "error_estimates_test", \
            "pull: 83 evaluations, residual 0.0011", "pull: 85 evaluations, residual 0.0013") \
    SETTING(double, cycle_contraction, 0.7, "1", "the same with a V-cycle", "error_estimates_test", \
            "as factor_contraction, with solver/preconditioner multigrid", "limited by max_contraction") \
    SETTING(double, max_contraction, 0.8, "1", "limit of that fraction", "error_estimates_test", \
            "pull: 84 evaluations, residual 0.0011", "cut and pull: the same") \
    SETTING(double, expected_contraction, 0.3, "1", "rate that is expected of an evaluation nobody has seen", \
            "mean over the scenes", "cut and pull: the same", "cut and pull: the same") \
    SETTING(double, contraction_weight, 0.2, "1", "weight of a new rate in the smoothed rate", "error_estimates_test", \
            "cut and pull: the same", "cut and pull: the same") \
    SETTING(double, error_safety, 1.25, "1", "factor on the error estimate", "error_estimates_test", \
            "pull: 74 evaluations, residual 0.0025", \
            "pull: 99 evaluations, residual 0.00075, 3 steps do not converge") \
    SETTING(double, smallest_displacement, 1e-3, "body length", \
            "the tolerance is relative to this displacement or a larger one", \
            "one node moved by a thousandth of the body", "cut and pull: the same", \
            "pull: 85 evaluations, residual 0.001") \
    SETTING(double, max_doubtful_step, 100, "0.001 body length", "longest blind step without supporting evidence", \
            "plain steps of weakly attached tissue can be metres long", "cut and pull: the same", \
            "cut and pull: the same") \
    SETTING(double, max_displacement, 1e5, "0.001 body length", "displacement above which a state is invalid", \
            "a hundred body lengths", "cut and pull: the same", "cut and pull: the same") \
    /* ---- even steps of a live simulation */ \
    SETTING(int32_t, limit_first_steps, 31, "steps", "steps that are known before the limit applies", "half a second", \
            "the limit holds after 16 live steps", "after 62 live steps") \
    SETTING(int32_t, limit_median_factor, 2, "median", "evaluations of a step, at most", \
            "no step is late by a second one", "live steps end at the median", \
            "live steps may take four times the median") \
    SETTING(double, limit_merit_weight, 0.02, "1", "weight of a new step in the smoothed initial merit", \
            "motion that has begun counts as normal after a dozen steps", \
            "sudden loads count as normal after 100 steps", "after 25 steps") \
    SETTING(double, limit_sudden_merit, 4, "mean", "initial merit above which the limit does not apply", \
            "smooth motion 1.6, a jump of 2 cm 30", "fast motion of tools counts as sudden", \
            "a jump of 2 cm still counts as sudden") \
    /* ---- the first step after a cut */ \
    SETTING(int32_t, newton_products, 8, "products", "products with the stiffness matrix, at most", "NUMERICS.md", \
            "cut: the same", "cut: the same") \
    SETTING(int32_t, newton_parts, 8, "parts", "parts that the step is taken in, at most", "NUMERICS.md", \
            "cut: the same", "cut: the same") \
    SETTING(int32_t, newton_evaluation_fraction, 3, "1", \
            "the step may take one evaluation more for each of so many, on the CPU", "NUMERICS.md", "cut: the same", \
            "cut: the same") \
    SETTING(int32_t, newton_evaluation_fraction_gpu, 2, "1", \
            "the same on a GPU, where begin and end of a step cost more", "NUMERICS.md", \
            "on a GPU: one evaluation more for each", "on a GPU: one evaluation more for each four") \
    SETTING(double, newton_residual, 0.01, "1", "fraction of the residual's norm at which the products end", \
            "with 0.05 a hinge does not open", "cut: the same", "cut: the same") \
    SETTING(double, newton_negligible, 0.1, "tolerance", \
            "length of the first step below which a cut released nothing", \
            "the carried inverse makes a hinge's first step too short, up to a hundred times", "cut: the same", \
            "cut: the same") \
    SETTING(double, newton_still, 0.01, "first direction", "motion below which the held nodes have not moved", \
            "NUMERICS.md", "cut: the same", "cut: the same") \
    SETTING(double, newton_part_length, 20, "0.001 body length", "length of one part", "NUMERICS.md", "cut: the same", \
            "cut: the same") \
    SETTING(double, newton_check_length, 250, "0.001 body length", "length above which each part is checked", \
            "NUMERICS.md", "cut: the same", "cut: the same") \
    SETTING(double, newton_max_length, 800, "0.001 body length", "length of the step, at most", \
            "Newton steps of weakly attached tissue can be metres long", "cut: the same", "cut: the same") \
    /* ---- background work */ \
    SETTING(double, background_rate, 5e9, "operations/s", "speed of a core, from which delays in steps follow", \
            "test/bench/bench_budget", "a factor is used twice as many steps later", \
            "half as many steps later; a busy core makes steps wait")

#define PLIANT_SETTING_MEMBER(type, name, ...) type name;
typedef struct pliant_quasistatic_settings {
    PLIANT_QUASISTATIC_SETTING_LIST(PLIANT_SETTING_MEMBER)
} pliant_quasistatic_settings;
#undef PLIANT_SETTING_MEMBER

#ifdef __CUDACC__
__host__ __device__
#endif
static inline pliant_quasistatic_settings pliant_get_quasistatic_settings(void)
{
    pliant_quasistatic_settings settings;
#define PLIANT_SETTING_VALUE(type, name, value, ...) settings.name = value;
    PLIANT_QUASISTATIC_SETTING_LIST(PLIANT_SETTING_VALUE)
#undef PLIANT_SETTING_VALUE
    return settings;
}

#endif
