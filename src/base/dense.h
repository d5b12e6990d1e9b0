/* Small dense linear algebra: submeshes of coarse elements, spaces of a few modes. Matrices are row-major. */
#ifndef PLIANT_BASE_DENSE_H
#define PLIANT_BASE_DENSE_H

#include "base/dot.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* In place: the lower triangle of a symmetric positive definite (n x n) becomes its Cholesky factor. False: it is not
 * positive definite. */
bool pliant_dense_cholesky(int32_t n, double *a);

/* In place: right (n x columns) becomes A^-1 right. */
void pliant_dense_cholesky_solve(int32_t n, const double *factor, int32_t columns, double *right);

/* In place, with partial pivoting: right (n x columns) becomes A^-1 right; a is overwritten. False: singular. */
bool pliant_dense_solve(int32_t n, double *a, int32_t columns, double *right);

/* A = root' root of a symmetric positive semidefinite (n x n), lower triangle given; root (n x n), of which as many
 * rows are written as are returned: the rank, up to rounding. */
int32_t pliant_dense_root(int32_t n, const double *a, double *root);

/* Eigenvalues, and eigenvectors in the columns of vectors, of a symmetric (n x n); a becomes diagonal. */
void pliant_dense_symmetric_eigen(int32_t n, double *a, double *values, double *vectors);

#ifdef __cplusplus
}
#endif

#endif
