#include "fem/element/rotation.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <random>

namespace {

using Matrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

// Reference: U V' of Eigen's singular value decomposition, with the sign on the smallest singular value.
Matrix reference(const Matrix &f)
{
    Eigen::JacobiSVD<Eigen::Matrix3d> svd(f, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix3d u = svd.matrixU(), v = svd.matrixV();
    if ((u * v.transpose()).determinant() < 0) u.col(2) *= -1;
    return u * v.transpose();
}

Matrix one(const Matrix &f)
{
    Matrix r;
    pliant_rotation_signed_svd(f.data(), r.data());
    return r;
}

Matrix lanes(const Matrix &f, int lane)
{
    double in[9][LANES], out[9][LANES];
    for (int m = 0; m < 9; m++)
        // other values in the other lanes
        for (int l = 0; l < LANES; l++) in[m][l] = l == lane ? f.data()[m] : (m % 4 == 0) * (1 + 0.1 * l);
    pliant_rotations(in, out);
    Matrix r;
    for (int m = 0; m < 9; m++) r.data()[m] = out[m][lane];
    return r;
}

TEST(Rotation, AgreesWithSingularValues)
{
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    for (int n = 0; n < 2000; n++) {
        Matrix f;
        for (int m = 0; m < 9; m++) f.data()[m] = normal(random);
        Eigen::Vector3d s = Eigen::JacobiSVD<Eigen::Matrix3d>(f).singularValues();
        // the rotation is not unique there
        if (f.determinant() < 0 ? s[1] - s[2] < 0.05 * s[0] : s[2] < 1e-3 * s[0]) continue;
        EXPECT_LT((one(f) - reference(f)).norm(), 1e-8) << f;
        EXPECT_LT((lanes(f, n % LANES) - reference(f)).norm(), 1e-8) << f;
    }
}

TEST(Rotation, RestIsExact)
{
    EXPECT_EQ(lanes(Matrix::Identity(), 3), Matrix(Matrix::Identity()));
}

TEST(Rotation, ContinuousThroughTheFlatState)
{
    // Compress along z through zero. The rotation stays the identity, so the element pushes back
    // (src/fem/element/NUMERICS.md).
    for (double z : {1.0, 1e-2, 1e-5, 1e-9, 0.0, -1e-9, -1e-5, -1e-2, -0.5}) {
        Matrix f = Matrix::Identity();
        f(2, 2) = z;
        EXPECT_LT((one(f) - Matrix(Matrix::Identity())).norm(), 1e-7) << z;
        EXPECT_LT((lanes(f, 0) - Matrix(Matrix::Identity())).norm(), 1e-7) << z;
    }
}

TEST(Rotation, AlwaysARotation)
{
    std::vector<Matrix> states(6, Matrix::Zero());
    states[1](0, 0) = 1;                          // a line
    states[2] = -Matrix::Identity();              // a point reflection
    states[3] = 1e-200 * Matrix::Identity();
    states[4] = 1e150 * Matrix::Random();
    states[5](1, 2) = 3;
    for (const Matrix &f : states)
        for (const Matrix &r : {one(f), lanes(f, 5)}) {
            EXPECT_LT((r * r.transpose() - Matrix(Matrix::Identity())).norm(), 1e-9) << f;
            EXPECT_NEAR(r.determinant(), 1, 1e-9) << f;
        }
}

} // namespace
