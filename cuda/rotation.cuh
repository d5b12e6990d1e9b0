/* The rotation nearest to a deformation gradient, as src/fem/rotation.h and .c find it. Row-major 3 x 3. */
#ifndef PLIANT_CUDA_ROTATION_CUH
#define PLIANT_CUDA_ROTATION_CUH

static __device__ __forceinline__ double determinant3(const double *m)
{
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
}

/* one Jacobi rotation of rows and columns p, q of a symmetric matrix; columns of v are its eigenvectors in the end */
template <int P, int Q> static __device__ __forceinline__ void jacobi_rotate(double *a, double *v)
{
    double apq = a[3 * P + Q];
    if (apq == 0) return;
    double theta = (a[4 * Q] - a[4 * P]) / (2 * apq);
    double t = (theta >= 0 ? 1 : -1) / (fabs(theta) + sqrt(theta * theta + 1));
    double c = 1 / sqrt(t * t + 1), s = t * c;
#pragma unroll
    for (int r = 0; r < 3; r++) {
        double p = a[3 * r + P], q = a[3 * r + Q];
        a[3 * r + P] = c * p - s * q;
        a[3 * r + Q] = s * p + c * q;
    }
#pragma unroll
    for (int r = 0; r < 3; r++) {
        double p = a[3 * P + r], q = a[3 * Q + r];
        a[3 * P + r] = c * p - s * q;
        a[3 * Q + r] = s * p + c * q;
        p = v[3 * r + P], q = v[3 * r + Q];
        v[3 * r + P] = c * p - s * q;
        v[3 * r + Q] = s * p + c * q;
    }
}

/* bring the larger of columns A and B to A, by the sizes on the diagonal */
template <int A, int B> static __device__ __forceinline__ void sort_columns(double *size, double *v)
{
    if (size[A] >= size[B]) return;
    double swap = size[A];
    size[A] = size[B];
    size[B] = swap;
#pragma unroll
    for (int r = 0; r < 3; r++) {
        swap = v[3 * r + A];
        v[3 * r + A] = v[3 * r + B];
        v[3 * r + B] = swap;
    }
}

static __device__ __forceinline__ double normalize3(double *v)
{
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    if (length > 0) {
        v[0] /= length;
        v[1] /= length;
        v[2] /= length;
    }
    return length;
}

static __device__ __forceinline__ void cross3(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static __device__ __forceinline__ void orthogonal_to(const double *v, double *out)
{
    double x = fabs(v[0]), y = fabs(v[1]), z = fabs(v[2]);
    const double axis[3] = {x <= y && x <= z ? 1.0 : 0.0, y < x && y <= z ? 1.0 : 0.0, z < x && z < y ? 1.0 : 0.0};
    cross3(v, axis, out);
    normalize3(out);
}

/* Any state. By the signed singular value decomposition (Irving et al. 2004). */
static __device__ __noinline__ void rotation_signed_svd(const double *deformation, double *rotation)
{
    double largest = 0, f[9], gram[9], v[9];
    for (int m = 0; m < 9; m++) largest = fmax(largest, fabs(deformation[m]));
    if (!(largest > 0) || !isfinite(largest)) {
        for (int m = 0; m < 9; m++) rotation[m] = m % 4 == 0;
        return;
    }
    for (int m = 0; m < 9; m++) {
        f[m] = deformation[m] / largest;
        v[m] = m % 4 == 0;
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) gram[3 * r + c] = f[r] * f[c] + f[3 + r] * f[3 + c] + f[6 + r] * f[6 + c];
    for (int sweep = 0; sweep < 12; sweep++) {
        double off = gram[1] * gram[1] + gram[2] * gram[2] + gram[5] * gram[5];
        double on = gram[0] * gram[0] + gram[4] * gram[4] + gram[8] * gram[8];
        if (off <= 1e-30 * on) break;
        jacobi_rotate<0, 1>(gram, v);
        jacobi_rotate<0, 2>(gram, v);
        jacobi_rotate<1, 2>(gram, v);
    }
    double size[3] = {gram[0], gram[4], gram[8]};
    sort_columns<0, 1>(size, v);
    sort_columns<1, 2>(size, v);
    sort_columns<0, 1>(size, v);
    double v0[3] = {v[0], v[3], v[6]}, v1[3] = {v[1], v[4], v[7]}, v2[3], u0[3], u1[3], u2[3];
    cross3(v0, v1, v2);
    for (int r = 0; r < 3; r++) {
        u0[r] = f[3 * r] * v0[0] + f[3 * r + 1] * v0[1] + f[3 * r + 2] * v0[2];
        u1[r] = f[3 * r] * v1[0] + f[3 * r + 1] * v1[1] + f[3 * r + 2] * v1[2];
    }
    double stretch = normalize3(u0), along = u0[0] * u1[0] + u0[1] * u1[1] + u0[2] * u1[2];
    for (int d = 0; d < 3; d++) u1[d] -= along * u0[d];
    if (normalize3(u1) <= 1e-12 * stretch) orthogonal_to(u0, u1);
    cross3(u0, u1, u2);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) rotation[3 * r + c] = u0[r] * v0[c] + u1[r] * v1[c] + u2[r] * v2[c];
}

/* Newton's iteration with determinant scaling (Higham 1986); the signed decomposition where it is flat or inverted. */
static __device__ __forceinline__ void rotation_of(const double *deformation, double *x)
{
    double norm = 0;
#pragma unroll
    for (int m = 0; m < 9; m++) {
        x[m] = deformation[m];
        norm += x[m] * x[m];
    }
    if (!(determinant3(x) - 1e-4 * norm * sqrt(norm) > 0)) {
        rotation_signed_svd(deformation, x);
        return;
    }
    for (int pass = 0; pass < 12; pass++) {
        double cofactor[9] = {x[4] * x[8] - x[5] * x[7], x[5] * x[6] - x[3] * x[8], x[3] * x[7] - x[4] * x[6],
                              x[2] * x[7] - x[1] * x[8], x[0] * x[8] - x[2] * x[6], x[1] * x[6] - x[0] * x[7],
                              x[1] * x[5] - x[2] * x[4], x[2] * x[3] - x[0] * x[5], x[0] * x[4] - x[1] * x[3]};
        double determinant = x[0] * cofactor[0] + x[1] * cofactor[1] + x[2] * cofactor[2], scale = 1, moved = 0;
        if (pass < 2) {
            double size = 0, cofactors = 0;
#pragma unroll
            for (int m = 0; m < 9; m++) {
                size += x[m] * x[m];
                cofactors += cofactor[m] * cofactor[m];
            }
            scale = sqrt(sqrt(cofactors / (size * determinant * determinant)));
        }
        double a = 0.5 * scale, b = 0.5 / (scale * determinant);
#pragma unroll
        for (int m = 0; m < 9; m++) {
            double next = a * x[m] + b * cofactor[m];
            moved += (next - x[m]) * (next - x[m]);
            x[m] = next;
        }
        if (!(moved > 1e-20)) return;
    }
}

#endif
