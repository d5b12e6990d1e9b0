// The same tissue in meshes of different resolution.
#include "base/memory.h"
#include "pipeline/body.h"
#include "report/report.h"

namespace {

const int size[3] = {12, 12, 12};
const double box[3] = {0.12, 0.12, 0.12};
const std::vector<Material> soft = {{5e3, 0.45, 1000, false}, {10, 0, 1, true}};
const double field[9] = {1.1, 0.02, 0, -0.03, 0.9, 0.1, 0.05, 0, 1.2}, shift[3] = {0.01, 0, -0.02};

void expect_field(const std::vector<double> &rest, const pliant_points &points, const std::vector<double> &moved)
{
    for (int32_t p = 0; p < points.count; p++) {
        if (!points.found[p]) continue;
        for (int r = 0; r < 3; r++) {
            double wanted = shift[r];
            for (int c = 0; c < 3; c++) wanted += field[3 * r + c] * rest[3 * p + c];
            EXPECT_NEAR(moved[3 * p + r], wanted, 1e-12);
        }
    }
}

TEST(Points, FollowAnAffineFieldInNestedAndOtherMeshes)
{
    for (int ratio : {1, 2, 3}) {
        Body body(size, box, soft), other(size, box, soft);
        body.cells(3, 3, 3, 2);
        other.cells(3, 3, 3, ratio); // ratio 3 does not nest in ratio 2
        for (Body *b : {&body, &other}) {
            b->fix_plane(1e-9, 0, 0, 1, 0, 0);
            ASSERT_EQ(b->build(), PLIANT_OK) << pliant_last_error();
        }
        int32_t count = 0;
        double *rest = nullptr;
        ASSERT_EQ(pliant_body_points(body.model, &count, &rest), PLIANT_OK);
        EXPECT_EQ(count, 7 * 7 * 7);
        pliant_points points{};
        ASSERT_EQ(pliant_points_create(&other.model->body->fine, count, rest, &points), PLIANT_OK);
        EXPECT_EQ(points.num_found, count);
        std::vector<double> moved(3 * static_cast<size_t>(count)),
            positions = affine(other.model->body->fine, field, shift);
        pliant_points_move(&points, positions.data(), moved.data());
        expect_field(std::vector<double>(rest, rest + 3 * count), points, moved);
        pliant_points_free(&points);
        pliant_free(rest);
    }
}

TEST(Points, PointsOutsideTheMeshAreNotFound)
{
    Body body(size, box, soft, [](int i, int, int) { return i >= 6 ? 1 : 0; });
    body.cells(3, 3, 3, 2);
    body.fix_plane(1e-9, 0, 0, 1, 0, 0);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const double rest[9] = {0.03, 0.033, 0.07, 0.11, 0.05, 0.05, -1, 0, 0};
    pliant_points points{};
    ASSERT_EQ(pliant_points_create(&body.model->body->fine, 3, rest, &points), PLIANT_OK);
    EXPECT_EQ(points.num_found, 1);
    EXPECT_EQ(points.found[0], 1);
    EXPECT_EQ(points.found[1], 0);
    std::vector<double> moved(9);
    pliant_points_move(&points, body.model->body->fine.rest, moved.data());
    EXPECT_NEAR(moved[1], 0.033, 1e-15);
    EXPECT_EQ(moved[3], 0);
    pliant_points_free(&points);
    EXPECT_EQ(pliant_points_create(&body.model->body->fine, 0, rest, &points), PLIANT_ERROR_ARGUMENT);
}

} // namespace
