/* Cubics of a fraction t from 0 to 1, as Bernstein coefficients. */
#ifndef PLIANT_BASE_CUBIC_H
#define PLIANT_BASE_CUBIC_H

#ifdef __cplusplus
extern "C" {
#endif

/* Compute the Bernstein coefficients of the triple product of three vectors that move from a to b. They bound it from
 * below and above. */
void pliant_cubic_coefficients(const double a[3][3], const double b[3][3], double out[4]);

/* Return a fraction, 0 to 1, up to which a cubic with these coefficients stays above a limit. */
double pliant_cubic_time(const double coefficient[4], double limit);

#ifdef __cplusplus
}
#endif
#endif
