#include "base/dense.h"

#include <math.h>

/* The factorization runs row by row (Golub and Van Loan, 4.2), so that inner products run along rows. */
bool pliant_dense_cholesky(int32_t n, double *a)
{
    for (int32_t i = 0; i < n; i++) {
        double *row = a + (int64_t)i * n;
        for (int32_t j = 0; j < i; j++)
            row[j] = (row[j] - pliant_dot((size_t)j, row, a + (int64_t)j * n)) / a[(int64_t)j * n + j];
        double pivot = row[i] - pliant_dot((size_t)i, row, row);
        if (!(pivot > 1e-14 * row[i]) || !(row[i] > 0)) return false;
        row[i] = sqrt(pivot);
    }
    return true;
}

void pliant_dense_cholesky_solve(int32_t n, const double *factor, int32_t columns, double *right)
{
    for (int32_t i = 0; i < n; i++) {
        double *to = right + (int64_t)i * columns;
        for (int32_t j = 0; j < i; j++) {
            double l = factor[(int64_t)i * n + j];
            const double *from = right + (int64_t)j * columns;
            for (int32_t c = 0; c < columns; c++) to[c] -= l * from[c];
        }
        for (int32_t c = 0; c < columns; c++) to[c] /= factor[(int64_t)i * n + i];
    }
    for (int32_t i = n - 1; i >= 0; i--) {
        double *from = right + (int64_t)i * columns;
        for (int32_t c = 0; c < columns; c++) from[c] /= factor[(int64_t)i * n + i];
        for (int32_t j = 0; j < i; j++) {
            double l = factor[(int64_t)i * n + j], *to = right + (int64_t)j * columns;
            for (int32_t c = 0; c < columns; c++) to[c] -= l * from[c];
        }
    }
}

bool pliant_dense_solve(int32_t n, double *a, int32_t columns, double *right)
{
    for (int32_t k = 0; k < n; k++) {
        int32_t pivot = k;
        for (int32_t i = k + 1; i < n; i++)
            if (fabs(a[(int64_t)i * n + k]) > fabs(a[(int64_t)pivot * n + k])) pivot = i;
        if (!(fabs(a[(int64_t)pivot * n + k]) > 0)) return false;
        for (int32_t c = 0; c < n && pivot != k; c++) {
            double swap = a[(int64_t)k * n + c];
            a[(int64_t)k * n + c] = a[(int64_t)pivot * n + c];
            a[(int64_t)pivot * n + c] = swap;
        }
        for (int32_t c = 0; c < columns && pivot != k; c++) {
            double swap = right[(int64_t)k * columns + c];
            right[(int64_t)k * columns + c] = right[(int64_t)pivot * columns + c];
            right[(int64_t)pivot * columns + c] = swap;
        }
        for (int32_t i = k + 1; i < n; i++) {
            double factor = a[(int64_t)i * n + k] / a[(int64_t)k * n + k];
            for (int32_t c = k; c < n; c++) a[(int64_t)i * n + c] -= factor * a[(int64_t)k * n + c];
            for (int32_t c = 0; c < columns; c++)
                right[(int64_t)i * columns + c] -= factor * right[(int64_t)k * columns + c];
        }
    }
    for (int32_t k = n - 1; k >= 0; k--)
        for (int32_t c = 0; c < columns; c++) {
            double *at = right + (int64_t)k * columns + c;
            for (int32_t i = k + 1; i < n; i++) *at -= a[(int64_t)k * n + i] * right[(int64_t)i * columns + c];
            *at /= a[(int64_t)k * n + k];
        }
    return true;
}

/* Cholesky with complete pivoting (Higham, Accuracy and Stability, 10.3). The last row holds the remaining diagonal. */
int32_t pliant_dense_root(int32_t n, const double *a, double *root)
{
    const double rounding = 1e-13;
    double *left = root + (int64_t)(n - 1) * n, maximum = 0;
    for (int32_t i = 0; i < n; i++) maximum = fmax(maximum, left[i] = a[(int64_t)i * (n + 1)]);
    for (int32_t rank = 0; rank < n; rank++) {
        int32_t pivot = 0;
        for (int32_t i = 1; i < n; i++)
            if (left[i] > left[pivot]) pivot = i;
        if (!(left[pivot] > rounding * maximum)) return rank;
        double *row = root + (int64_t)rank * n, scale = sqrt(left[pivot]);
        if (rank + 1 == n) { /* the last row replaces the remaining diagonal, which has one nonzero entry */
            for (int32_t i = 0; i < n; i++) row[i] = i == pivot ? scale : 0;
            return n;
        }
        for (int32_t i = 0; i < n; i++) row[i] = i < pivot ? a[(int64_t)pivot * n + i] : a[(int64_t)i * n + pivot];
        for (int32_t m = 0; m < rank; m++) {
            const double *before = root + (int64_t)m * n;
            for (int32_t i = 0; i < n; i++) row[i] -= before[pivot] * before[i];
        }
        for (int32_t i = 0; i < n; i++) {
            row[i] /= scale;
            left[i] -= row[i] * row[i];
        }
        left[pivot] = 0;
    }
    return n;
}

/* Rotate columns (or with step n: rows) p and q by an angle. */
static void turn(int32_t n, double *a, int32_t p, int32_t q, int32_t step, int32_t stride, double cosine, double sine)
{
    for (int32_t i = 0; i < n; i++) {
        double *x = a + (int64_t)i * stride + (int64_t)p * step, *y = a + (int64_t)i * stride + (int64_t)q * step;
        double old = *x;
        *x = cosine * old - sine * *y;
        *y = sine * old + cosine * *y;
    }
}

/* Cyclic Jacobi (Golub and Van Loan, 8.5). */
void pliant_dense_symmetric_eigen(int32_t n, double *a, double *values, double *vectors)
{
    for (int32_t m = 0; m < n * n; m++) vectors[m] = m % (n + 1) == 0;
    for (int sweep = 0; sweep < 60; sweep++) {
        double off = 0, whole = 0;
        for (int32_t m = 0; m < n * n; m++) {
            whole += a[m] * a[m];
            off += m % (n + 1) == 0 ? 0 : a[m] * a[m];
        }
        if (!(off > 1e-32 * whole)) break;
        for (int32_t p = 0; p < n; p++)
            for (int32_t q = p + 1; q < n; q++) {
                double off_diagonal = a[p * n + q];
                if (off_diagonal == 0) continue;
                double tau = (a[q * n + q] - a[p * n + p]) / (2 * off_diagonal);
                double tangent = (tau < 0 ? -1 : 1) / (fabs(tau) + hypot(1, tau)), cosine = 1 / hypot(1, tangent);
                turn(n, a, p, q, 1, n, cosine, cosine * tangent);
                turn(n, a, p, q, n, 1, cosine, cosine * tangent);
                turn(n, vectors, p, q, 1, n, cosine, cosine * tangent);
            }
    }
    for (int32_t i = 0; i < n; i++) values[i] = a[i * n + i];
}
