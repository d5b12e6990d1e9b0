#include "fem/element/rotation.h"

#include "fem/element/signed_svd.h"

#include <string.h>

void pliant_symmetric_eigen(const double matrix[9], double values[3], double vectors[9])
{
    double a[9];
    memcpy(a, matrix, sizeof a);
    pliant_jacobi(a, vectors);
    for (int k = 0; k < 3; k++) values[k] = a[4 * k];
}

void pliant_rotation_signed_svd(const double deformation[9], double rotation[9])
{
    pliant_signed_svd(deformation, rotation);
}
