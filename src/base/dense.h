/* Dense linear algebra for small matrices, such as submeshes of coarse elements and spaces of a few modes. Matrices are
 * row-major. */
#ifndef PLIANT_BASE_DENSE_H
#define PLIANT_BASE_DENSE_H

#include "base/dot.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Overwrite the lower triangle of a symmetric positive definite (n x n) matrix by its Cholesky factor. Return false if
 * the matrix is not positive definite. */
bool pliant_dense_cholesky(int32_t n, double *a);

/* Overwrite right (n x columns) by A^-1 right. */
void pliant_dense_cholesky_solve(int32_t n, const double *factor, int32_t columns, double *right);

/* Overwrite right (n x columns) by A^-1 right, with partial pivoting. `a` is overwritten. Return false if it is
 * singular. */
bool pliant_dense_solve(int32_t n, double *a, int32_t columns, double *right);

/* Compute a root of a symmetric positive semidefinite (n x n) matrix: A = root' root. The lower triangle of a is read.
 * Return the rank up to rounding, which is the number of rows written to root (n x n). */
int32_t pliant_dense_root(int32_t n, const double *a, double *root);

/* Compute eigenvalues, and eigenvectors in the columns of vectors, of a symmetric (n x n) matrix. `a` becomes
 * diagonal. */
void pliant_dense_symmetric_eigen(int32_t n, double *a, double *values, double *vectors);

#ifdef __cplusplus
}
#endif

#endif
