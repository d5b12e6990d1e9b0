// Pictures and radiographs of exact balls and boxes, and of tissue under rigid motion.
#include "base/memory.h"
#include "pliant/pliant.h"
#include "warp/picture.h"
#include "warp/warp.h"
#include "warp_cases.h"

#include <cstring>

namespace {

const double pi = 3.14159265358979323846;
using warp_cases::vector3;
using warp_cases::volume_ptr;

pliant_geometry cube(int32_t size, double spacing)
{
    const double first = -0.5 * spacing * (size - 1);
    return {{size, size, size}, {first, first, first}, {spacing, spacing, spacing}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
}

template <class Function>
volume_ptr volume_of(const pliant_geometry &geometry, pliant_encoding encoding, const Function &value)
{
    volume_ptr volume(new pliant_volume());
    EXPECT_EQ(pliant_volume_create(&geometry, encoding, volume.get()), PLIANT_OK) << pliant_last_error();
    volume->slope = 1;
    size_t v = 0;
    for (int k = 0; k < geometry.size[2]; k++)
        for (int j = 0; j < geometry.size[1]; j++)
            for (int i = 0; i < geometry.size[0]; i++, v++) {
                const double index[3] = {double(i), double(j), double(k)};
                double x[3];
                pliant_geometry_to_world(&geometry, index, x);
                const double is = value(vector3{x[0], x[1], x[2]});
                if (encoding == PLIANT_UINT8) static_cast<uint8_t *>(volume->voxels)[v] = uint8_t(is);
                if (encoding == PLIANT_INT16) static_cast<int16_t *>(volume->voxels)[v] = int16_t(std::lrint(is));
                if (encoding == PLIANT_FLOAT32) static_cast<float *>(volume->voxels)[v] = float(is);
            }
    return volume;
}

double length(const vector3 &x) { return std::sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]); }

pliant_camera camera_at(int32_t width, int32_t height, double view, const vector3 &from, const vector3 &at)
{
    pliant_camera camera;
    const double up[3] = {0, 0, 1};
    pliant_camera_of_view(width, height, view, &camera);
    EXPECT_EQ(pliant_camera_look_at(&camera, from.data(), at.data(), up), PLIANT_OK) << pliant_last_error();
    return camera;
}

// Return the ray of a pixel in LPS, one metre along z.
vector3 ray_of(const pliant_camera &camera, int column, int row)
{
    const double c[3] = {(column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, 1};
    vector3 out;
    for (int d = 0; d < 3; d++)
        out[d] = camera.pose[4 * d] * c[0] + camera.pose[4 * d + 1] * c[1] + camera.pose[4 * d + 2] * c[2];
    return out;
}

struct Picture {
    std::vector<uint8_t> rgb, label;
    std::vector<float> depth;
    pliant_image image;
    explicit Picture(const pliant_camera &camera)
        : rgb(3 * size_t(camera.width) * camera.height), label(rgb.size() / 3),
          depth(label.size()), image{rgb.data(), depth.data(), label.data()}
    {
    }
};

pliant_style style_of(const pliant_volume &volume, float threshold)
{
    pliant_style style;
    EXPECT_EQ(pliant_style_defaults(&volume, &style), PLIANT_OK) << pliant_last_error();
    style.threshold = threshold;
    return style;
}

} // namespace

TEST(Render, BallHasItsOutlineDepthAndLabels)
{
    // An oblique, mirrored grid of three spacings. Half of the ball is another tissue.
    pliant_geometry geometry = {{60, 48, 40}, {0, 0, 0}, {0.001, 0.00125, 0.0015}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    warp_cases::turn(geometry, 0.7, true);
    vector3 centre, split = {0.6, 0, 0.8};
    const double middle[3] = {30.2, 23.7, 19.4}, radius = 0.021;
    pliant_geometry_to_world(&geometry, middle, centre.data());
    auto outwards = [&](const vector3 &x) { return length({x[0] - centre[0], x[1] - centre[1], x[2] - centre[2]}); };
    auto side = [&](const vector3 &x) {
        return (x[0] - centre[0]) * split[0] + (x[1] - centre[1]) * split[1] + (x[2] - centre[2]) * split[2];
    };
    const volume_ptr ball =
        volume_of(geometry, PLIANT_FLOAT32, [&](const vector3 &x) { return 100 * (1 - outwards(x) / radius); });
    const volume_ptr labels = volume_of(geometry, PLIANT_UINT8, [&](const vector3 &x) {
        return outwards(x) > radius ? 0 : side(x) > 0 ? 3 : 7;
    });
    const pliant_camera camera = camera_at(80, 60, 0.6, {centre[0] + 0.05, centre[1] - 0.08, centre[2] + 0.03}, centre);
    const pliant_style style = style_of(*ball, 0);
    Picture seen(camera);
    ASSERT_EQ(pliant_render(ball.get(), labels.get(), &camera, &style, 2, &seen.image), PLIANT_OK)
        << pliant_last_error();
    int inside = 0, outline = 0, lit = 0;
    for (int row = 0; row < camera.height; row++)
        for (int column = 0; column < camera.width; column++) {
            const size_t pixel = size_t(row) * camera.width + column;
            const vector3 ray = ray_of(camera, column, row),
                          from = {camera.pose[3] - centre[0], camera.pose[7] - centre[1], camera.pose[11] - centre[2]};
            const double a = ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2],
                         b = ray[0] * from[0] + ray[1] * from[1] + ray[2] * from[2];
            const double under = b * b - a * (length(from) * length(from) - radius * radius),
                         depth = (-b - std::sqrt(under)) / a;
            const double distance = std::sqrt(std::max(length(from) * length(from) - b * b / a, 0.0)) - radius;
            if (std::abs(distance) < 0.0001) { // closer than a tenth of a voxel: either result is valid
                outline++;
                continue;
            }
            ASSERT_EQ(std::isfinite(seen.depth[pixel]), distance < 0) << column << " " << row;
            if (distance > 0) {
                EXPECT_EQ(seen.label[pixel], 0);
                EXPECT_EQ(seen.rgb[3 * pixel], 0);
                continue;
            }
            inside++;
            // Trilinear interpolation of a ball cuts chords: the depth grows by at most h^2 / 8 R, and more for a
            // grazing ray.
            EXPECT_NEAR(seen.depth[pixel], depth, 3e-5 / std::max(std::sqrt(under) / (std::sqrt(a) * radius), 0.05))
                << column << " " << row;
            const vector3 hit = {camera.pose[3] + depth * ray[0], camera.pose[7] + depth * ray[1],
                                 camera.pose[11] + depth * ray[2]};
            if (std::abs(side(hit)) > 0.002)
                EXPECT_EQ(seen.label[pixel], side(hit) > 0 ? 3 : 7) << column << " " << row;
            lit += seen.rgb[3 * pixel] > 30;
        }
    EXPECT_GT(inside, 600);
    EXPECT_LT(outline, 60);
    EXPECT_EQ(lit, inside);
}

TEST(Render, TissuesThatAreShownAlone)
{
    const pliant_geometry geometry = cube(40, 0.001);
    const volume_ptr scan = volume_of(geometry, PLIANT_INT16, [](const vector3 &) { return 40; });
    const volume_ptr labels = volume_of(geometry, PLIANT_UINT8, [](const vector3 &x) {
        return length(x) < 0.008 ? 5 : length(x) < 0.015 ? 6 : 0;
    });
    const pliant_camera camera = camera_at(31, 31, 0.3, {0, -0.1, 0}, {0, 0, 0});
    pliant_style style = style_of(*scan, 0);
    style.by_label = true;
    for (int shown : {5, 6}) {
        Picture seen(camera);
        std::memset(style.shown, 0, sizeof style.shown);
        style.shown[shown] = 1;
        ASSERT_EQ(pliant_render(scan.get(), labels.get(), &camera, &style, 1, &seen.image), PLIANT_OK)
            << pliant_last_error();
        const size_t pixel = 15 * 31 + 15;
        EXPECT_NEAR(seen.depth[pixel], shown == 5 ? 0.092 : 0.085, 0.0007);
        EXPECT_EQ(seen.label[pixel], shown);
    }
}

TEST(Render, TissueNearerThanNearIsClippedAndShowsTheScan)
{
    const volume_ptr scan =
        volume_of(cube(40, 0.001), PLIANT_INT16, [](const vector3 &x) { return x[0] < 0 ? 0 : 100; });
    pliant_camera camera = camera_at(21, 21, 0.2, {0, -0.1, 0}, {0, 0, 0});
    pliant_style style = style_of(*scan, -300);
    style.num_colours = 2;
    style.colours[0] = {0, {0, 0, 1}};
    style.colours[1] = {100, {1, 0, 0}};
    camera.near = 0.095;
    Picture seen(camera);
    ASSERT_EQ(pliant_render(scan.get(), nullptr, &camera, &style, 1, &seen.image), PLIANT_OK) << pliant_last_error();
    for (int column : {0, 20}) {
        const size_t pixel = 10 * 21 + size_t(column); // a view from the front: the patient's left is on the right
        EXPECT_NEAR(seen.depth[pixel], 0.095, 1e-7);
        EXPECT_EQ(seen.rgb[3 * pixel], column == 20 ? 255 : 0);
        EXPECT_EQ(seen.rgb[3 * pixel + 2], column == 20 ? 0 : 255);
    }
}

TEST(Render, ThreadsDrawTheSameBits)
{
    const volume_ptr scan = volume_of(cube(48, 0.001), PLIANT_UINT8, [](const vector3 &x) {
        return 100 + 90 * std::sin(900 * x[0]) * std::cos(700 * x[1] + 400 * x[2]);
    });
    const pliant_camera camera = camera_at(70, 50, 0.7, {0.02, -0.06, 0.01}, {0, 0, 0});
    const pliant_style style = style_of(*scan, 120);
    Picture one(camera), three(camera);
    std::vector<float> ray_one(70 * 50), ray_three(70 * 50);
    ASSERT_EQ(pliant_render(scan.get(), nullptr, &camera, &style, 1, &one.image), PLIANT_OK);
    ASSERT_EQ(pliant_render(scan.get(), nullptr, &camera, &style, 3, &three.image), PLIANT_OK);
    ASSERT_EQ(pliant_radiograph(scan.get(), &camera, PLIANT_WATER_ATTENUATION, 1, ray_one.data()), PLIANT_OK);
    ASSERT_EQ(pliant_radiograph(scan.get(), &camera, PLIANT_WATER_ATTENUATION, 3, ray_three.data()), PLIANT_OK);
    EXPECT_EQ(one.rgb, three.rgb);
    EXPECT_EQ(std::memcmp(one.depth.data(), three.depth.data(), one.depth.size() * sizeof(float)), 0);
    EXPECT_EQ(ray_one, ray_three);
    EXPECT_GT(std::count_if(one.depth.begin(), one.depth.end(), [](float z) { return z > 0; }), 500);
}

TEST(Radiograph, BoxAndBallOfWater)
{
    const double h = 0.002, half = 0.02 - 0.5 * h, radius = 0.03;
    // The outermost voxels, 19 from the middle, end half a voxel further out.
    const volume_ptr box = volume_of(cube(61, h), PLIANT_INT16, [&](const vector3 &x) {
        return std::max({std::abs(x[0]), std::abs(x[1]), std::abs(x[2])}) < half - 0.5 * h + 1e-9 ? 0 : -1000;
    });
    const volume_ptr ball = volume_of(cube(61, h), PLIANT_FLOAT32, [&](const vector3 &x) {
        // 1.5 times the density of water
        return -1000 + 1500 * std::min(std::max((radius - length(x)) / h + 0.5, 0.0), 1.0);
    });
    pliant_c_arm arm = {{0, 0, 0}, 0.8, 1.2, 0, 0, 41, 41, 0.003};
    for (double primary : {0.0, 0.5, -1.1})
        for (double secondary : {0.0, 0.35}) {
            arm.primary_angle = primary;
            arm.secondary_angle = secondary;
            pliant_camera camera;
            ASSERT_EQ(pliant_c_arm_camera(&arm, &camera), PLIANT_OK) << pliant_last_error();
            std::vector<float> of_box(41 * 41), of_ball(41 * 41);
            ASSERT_EQ(pliant_radiograph(box.get(), &camera, 20, 2, of_box.data()), PLIANT_OK) << pliant_last_error();
            ASSERT_EQ(pliant_radiograph(ball.get(), &camera, 20, 2, of_ball.data()), PLIANT_OK);
            // the central ray leaves the box through the face that is most perpendicular to it
            const vector3 ray = ray_of(camera, 20, 20);
            const double maximum = std::max({std::abs(ray[0]), std::abs(ray[1]), std::abs(ray[2])}) / length(ray),
                         edge = half;
            EXPECT_NEAR(of_box[20 * 41 + 20], 20 * 2 * edge / maximum, 0.005) << primary << " " << secondary;
            for (int pixel : {20 * 41 + 20, 14 * 41 + 20, 22 * 41 + 27, 12 * 41 + 14}) {
                const vector3 through = ray_of(camera, pixel % 41, pixel / 41);
                const double along =
                    (through[0] * camera.pose[3] + through[1] * camera.pose[7] + through[2] * camera.pose[11]) /
                    length(through);
                const double square = 0.8 * 0.8 - along * along,
                             chord = square < radius * radius ? 2 * std::sqrt(radius * radius - square) : 0;
                EXPECT_NEAR(of_ball[pixel], 1.5 * 20 * chord, 0.01) << primary << " " << secondary << " " << pixel;
            }
        }
}

// A slab of water, wider than the cone of rays: each ray passes through thickness / cos, for any slice spacing.
TEST(Radiograph, ASlabIsAsLongAsTheRayIsOblique)
{
    const double thickness = 0.04, water = 20;
    for (double slice : {0.002, 0.005}) {
        pliant_geometry geometry = cube(121, 0.002);
        geometry.size[2] = int32_t(std::lrint(0.16 / slice)) + 1;
        geometry.spacing[2] = slice;
        geometry.origin[2] = -0.08;
        const volume_ptr slab = volume_of(geometry, PLIANT_FLOAT32, [&](const vector3 &x) {
            return -1000 + 1000 * std::min(std::max((0.5 * thickness - std::abs(x[2])) / slice + 0.5, 0.0), 1.0);
        });
        for (double angle : {0.0, 0.4}) {
            const pliant_camera camera =
                camera_at(31, 31, 1.0, {0.12 * std::sin(angle), 1e-6, 0.12 * std::cos(angle)}, {0, 0, 0});
            std::vector<float> image(31 * 31);
            ASSERT_EQ(pliant_radiograph(slab.get(), &camera, water, 2, image.data()), PLIANT_OK) << pliant_last_error();
            for (int pixel : {15 * 31 + 15, 15 * 31 + 27, 3 * 31 + 15, 4 * 31 + 4, 26 * 31 + 26}) {
                const vector3 ray = ray_of(camera, pixel % 31, pixel / 31);
                const double expected = water * thickness * length(ray) / std::abs(ray[2]);
                EXPECT_NEAR(image[size_t(pixel)], expected, 0.005 * expected)
                    << "slices " << slice << ", angle " << angle << ", pixel " << pixel;
            }
        }
    }
}

TEST(Radiograph, LeftIsOnTheRightAndTheHeadUp)
{
    const vector3 bead = {0.02, 0.01, 0.015}; // left, behind, towards the head
    const volume_ptr scan = volume_of(cube(61, 0.001), PLIANT_INT16, [&](const vector3 &x) {
        return length({x[0] - bead[0], x[1] - bead[1], x[2] - bead[2]}) < 0.003 ? 2000 : -1000;
    });
    auto brightest = [&](double primary, double secondary) {
        const pliant_c_arm arm = {{0, 0, 0}, 0.8, 1.2, primary, secondary, 81, 81, 0.001};
        pliant_camera camera;
        std::vector<float> image(81 * 81);
        EXPECT_EQ(pliant_c_arm_camera(&arm, &camera), PLIANT_OK);
        EXPECT_EQ(pliant_radiograph(scan.get(), &camera, PLIANT_WATER_ATTENUATION, 1, image.data()), PLIANT_OK);
        const int at = int(std::max_element(image.begin(), image.end()) - image.begin());
        return std::array<int, 2>{at % 81 - 40, at / 81 - 40};
    };
    // 1 cm nearer to the source than the isocentre: magnified by 1.2 / 0.79
    EXPECT_NEAR(brightest(0, 0)[0], 20 * 1.2 / 0.79, 1.5);
    EXPECT_NEAR(brightest(0, 0)[1], -15 * 1.2 / 0.79, 1.5);
    // The detector is at the patient's left: posterior is on the right of the image.
    EXPECT_NEAR(brightest(pi / 2, 0)[0], 10 * 1.2 / 0.82, 1.5);
    // The detector is above the patient's head: posterior is up.
    EXPECT_LT(brightest(0, pi / 2 - 0.01)[1], 0);
}

TEST(CArm, TheHeadIsUpAtAnyAngle)
{
    for (double primary : {0.0, 0.6, -1.2})
        for (double secondary : {0.0, 0.4, -0.7}) {
            const pliant_c_arm arm = {{0.1, 0.2, 0.3}, 0.8, 1.2, primary, secondary, 8, 8, 0.001};
            pliant_camera camera;
            ASSERT_EQ(pliant_c_arm_camera(&arm, &camera), PLIANT_OK) << pliant_last_error();
            const double *pose = camera.pose; // rows: left, posterior, superior; columns: right, down, ahead, position
            EXPECT_NEAR(pose[8], 0, 1e-12) << "the head axis is vertical in the image: " << primary << " " << secondary;
            EXPECT_NEAR(pose[9], -std::cos(secondary), 1e-12) << primary << " " << secondary;
            EXPECT_NEAR(pose[10], std::sin(secondary), 1e-12) << primary << " " << secondary;
            for (int d = 0; d < 3; d++) EXPECT_NEAR(pose[4 * d + 3] + 0.8 * pose[4 * d + 2], arm.isocentre[d], 1e-12);
        }
}

TEST(Render, LightOnAPlaneFollowsItsNormalWhateverTheSpacing)
{
    const pliant_geometry geometry = {
        {41, 33, 17}, {-0.02, -0.024, -0.024}, {0.001, 0.0015, 0.003}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    const double n[3] = {0.36, 0.8, 0.48}; // unit normal into the tissue, in the direction of increasing values
    auto along_normal = [&](const vector3 &x) { return n[0] * x[0] + n[1] * x[1] + n[2] * x[2]; };
    auto rises = [&](const vector3 &x) { return 1e4 * along_normal(x); };
    const volume_ptr scan = volume_of(geometry, PLIANT_FLOAT32, rises);
    const pliant_camera camera = camera_at(21, 21, 0.2, {0.01, -0.1, 0.02}, {0, 0, 0});
    pliant_style style = style_of(*scan, 0);
    style.num_colours = 1;
    style.colours[0] = {0, {0.8f, 0.4f, 0.2f}};
    style.ambient = 0.2f;
    style.diffuse = 0.7f;
    style.specular = 0;
    Picture seen(camera);
    ASSERT_EQ(pliant_render(scan.get(), nullptr, &camera, &style, 1, &seen.image), PLIANT_OK) << pliant_last_error();
    for (int row = 0; row < 21; row++)
        for (int column = 0; column < 21; column++) {
            const vector3 ray = ray_of(camera, column, row);
            const double light = 0.2 + 0.7 * along_normal(ray) / length(ray);
            for (int c = 0; c < 3; c++) {
                const double colour = 255 * light * double(style.colours[0].rgb[c]);
                EXPECT_NEAR(seen.rgb[3 * (21 * row + column) + c], colour, 1) << column << " " << row;
            }
        }
}

TEST(Render, WrongArgumentsAndMissingMemory)
{
    const volume_ptr scan = volume_of(cube(20, 0.001), PLIANT_INT16, [](const vector3 &) { return 40; });
    const pliant_camera camera = camera_at(8, 6, 0.3, {0, -0.1, 0}, {0, 0, 0});
    const pliant_style style = style_of(*scan, 0);
    Picture seen(camera);
    auto refused = [&](const std::function<void(pliant_camera &, pliant_style &)> &change, const char *word) {
        pliant_camera other = camera;
        pliant_style another = style;
        change(other, another);
        EXPECT_EQ(pliant_render(scan.get(), nullptr, &other, &another, 1, &seen.image), PLIANT_ERROR_ARGUMENT) << word;
        EXPECT_NE(std::strstr(pliant_last_error(), word), nullptr) << pliant_last_error();
    };
    refused([](pliant_camera &c, pliant_style &) { c.width = 0; }, "pixels");
    refused([](pliant_camera &c, pliant_style &) { c.fx = 0; }, "fx");
    refused([](pliant_camera &c, pliant_style &) { c.pose[3] = NAN; }, "finite");
    refused([](pliant_camera &c, pliant_style &) { c.pose[0] *= 2; }, "rotation");
    refused([](pliant_camera &, pliant_style &s) { s.num_colours = 0; }, "colours");
    refused([](pliant_camera &, pliant_style &s) { s.by_label = true; }, "labels");
    float out[48];
    EXPECT_EQ(pliant_radiograph(scan.get(), &camera, -1, 1, out), PLIANT_ERROR_ARGUMENT);
    pliant_memory_fail_after(0);
    EXPECT_EQ(pliant_render(scan.get(), nullptr, &camera, &style, 1, &seen.image), PLIANT_ERROR_MEMORY);
    pliant_memory_fail_after(-1);
    const pliant_c_arm arm = {{0, 0, 0}, 0, 1.2, 0, 0, 8, 8, 0.001};
    pliant_camera made;
    EXPECT_EQ(pliant_c_arm_camera(&arm, &made), PLIANT_ERROR_ARGUMENT);
}

TEST(Labels, AreThoseOfTheNearestVoxel)
{
    const pliant_geometry geometry = cube(24, 0.001);
    const volume_ptr labels = volume_of(geometry, PLIANT_UINT8, [](const vector3 &x) {
        return std::lrint(125 + 1e5 * (x[0] + 2 * x[1] * x[2] / 0.01)) & 63;
    });
    const warp_cases::mesh_ptr mesh = warp_cases::make_mesh(geometry, 4, 4, 4);
    const warp_cases::warp_ptr warp = warp_cases::make_warp(*labels, *mesh, geometry),
                               floats = warp_cases::make_warp(
                                   *volume_of(geometry, PLIANT_INT16, [](const vector3 &) { return 0; }), *mesh,
                                   geometry);
    EXPECT_EQ(pliant_warp_nearest(floats.get()), PLIANT_ERROR_ARGUMENT);
    ASSERT_EQ(pliant_warp_nearest(warp.get()), PLIANT_OK) << pliant_last_error();
    const double stretch = 1.13, turn = 0.21;
    const std::vector<double> x = warp_cases::moved(*mesh, [&](const vector3 &p) {
        return vector3{stretch * p[0] - turn * p[1], p[1] + turn * p[0], p[2] + 0.0003};
    });
    ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
    const uint8_t *drawn = static_cast<const uint8_t *>(pliant_warp_volume(warp.get())->voxels),
                  *from = static_cast<const uint8_t *>(labels->voxels);
    int compared = 0;
    for (int k = 3; k < 21; k++)
        for (int j = 6; j < 18; j++)
            for (int i = 6; i < 18; i++) {
                const double index[3] = {double(i), double(j), double(k)}, det = stretch + turn * turn;
                double p[3], rest[3];
                pliant_geometry_to_world(&geometry, index, p);
                const double back[3] = {(p[0] + turn * p[1]) / det, (stretch * p[1] - turn * p[0]) / det,
                                        p[2] - 0.0003};
                pliant_geometry_to_index(&geometry, back, rest);
                size_t nearest = 0;
                bool between = false;
                for (int d = 2; d >= 0; d--) {
                    nearest = nearest * 24 + size_t(std::lrint(rest[d]));
                    between = between || std::abs(rest[d] - std::floor(rest[d]) - 0.5) < 1e-3;
                }
                if (between) continue;
                EXPECT_EQ(drawn[size_t(i) + 24 * (size_t(j) + 24 * size_t(k))], from[nearest])
                    << i << " " << j << " " << k;
                compared++;
            }
    EXPECT_GT(compared, 2000);
}

// ---- a view of a model

namespace {

// A ball of tissue that fades out, with a harder kernel.
struct Tissue {
    volume_ptr scan;
    pliant_scene scene;
    pliant_material_table materials{};
    pliant_model *model = nullptr;
    Tissue()
    {
        scan = volume_of(cube(40, 0.002), PLIANT_INT16, [](const vector3 &x) {
            return 1000 - 3e4 * length({x[0], 0.8 * x[1], 1.2 * x[2]});
        });
        scan->background = -2000;
        pliant_scene_defaults(&scene);
        for (int32_t &cells : scene.mesh.coarse_cells) cells = 10;
        scene.mesh.ratio = 1;
        scene.element.kind = PLIANT_LINEAR;
        scene.solver.threads = 1;
        scene.solver.backend = PLIANT_CPU;
        scene.cut.kind = PLIANT_CUT_SEVER;
        const char *table =
            "materials:\n"
            "  - {name: air, young_modulus: 10, poisson_ratio: 0, density: 1, empty: true, range: [-1e9, 200]}\n"
            "  - {name: soft, young_modulus: 3000, poisson_ratio: 0.4, density: 1000, range: [200, 600]}\n"
            "  - {name: hard, young_modulus: 9000, poisson_ratio: 0.4, density: 1000, fixed: true, "
            "range: [600, 1e9]}\n";
        EXPECT_EQ(pliant_material_table_parse(table, "table", &materials), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_model_build(&scene, scan.get(), nullptr, &materials, pliant_progress{}, &model), PLIANT_OK)
            << pliant_last_error();
    }
    ~Tissue()
    {
        pliant_model_free(model);
        pliant_material_table_free(&materials);
    }
};

// Return the lowest node number of each node's connected component.
std::vector<int32_t> parts_of(const pliant_mesh &mesh)
{
    std::vector<int32_t> part(mesh.num_nodes);
    for (int32_t n = 0; n < mesh.num_nodes; n++) part[n] = n;
    for (bool changed = true; changed;) {
        changed = false;
        for (int32_t t = 0; t < mesh.num_tets; t++) {
            const int32_t *nodes = mesh.tets + 4 * t;
            const int32_t minimum = std::min({part[nodes[0]], part[nodes[1]], part[nodes[2]], part[nodes[3]]});
            for (int v = 0; v < 4; v++) changed = changed || part[nodes[v]] != minimum, part[nodes[v]] = minimum;
        }
    }
    return part;
}

} // namespace

TEST(View, MovingTheTissueEqualsTheOppositeCameraMotion)
{
    const Tissue tissue;
    const pliant_body *body = pliant_model_get_body(tissue.model);
    const double c = std::cos(0.5), s = std::sin(0.5);
    const double move[12] = {c, -s, 0, 0.004, s, c, 0, -0.003, 0, 0, 1, 0.005};
    const pliant_geometry target = cube(56, 0.002);
    std::vector<double> x(body->fine.rest, body->fine.rest + 3 * body->fine.num_nodes);
    const pliant_camera camera = camera_at(64, 48, 0.5, {0.02, -0.11, 0.04}, {0, 0, 0});
    pliant_camera follows = camera;
    for (size_t n = 0; n < x.size(); n += 3) {
        const double at[3] = {x[n], x[n + 1], x[n + 2]};
        for (int d = 0; d < 3; d++)
            x[n + d] = move[4 * d] * at[0] + move[4 * d + 1] * at[1] + move[4 * d + 2] * at[2] + move[4 * d + 3];
    }
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++) {
            follows.pose[4 * row + column] = column == 3 ? move[4 * row + 3] : 0;
            for (int d = 0; d < 3; d++)
                follows.pose[4 * row + column] += move[4 * row + d] * camera.pose[4 * d + column];
        }
    pliant_view *view = nullptr;
    ASSERT_EQ(pliant_view_create(tissue.model, &target, &view), PLIANT_OK) << pliant_last_error();
    for (bool by_label : {false, true}) {
        Picture rest(camera), moved(camera);
        pliant_style style = style_of(*tissue.scan, 350);
        style.by_label = by_label;
        if (by_label) style.shown[2] = 0; // only the kernel
        ASSERT_EQ(pliant_view_set(view, body, body->fine.rest, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_view_render(view, &camera, &style, &rest.image), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_view_set(view, body, x.data(), nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_view_render(view, &follows, &style, &moved.image), PLIANT_OK) << pliant_last_error();
        int both = 0, one = 0, far = 0, other = 0, darker = 0;
        for (size_t pixel = 0; pixel < rest.depth.size(); pixel++) {
            const bool here = std::isfinite(rest.depth[pixel]), there = std::isfinite(moved.depth[pixel]);
            both += here && there;
            one += here != there;
            if (!here || !there) continue;
            far += std::abs(rest.depth[pixel] - moved.depth[pixel]) > (by_label ? 0.004 : 0.0004);
            other += rest.label[pixel] != moved.label[pixel];
            darker += std::abs(rest.rgb[3 * pixel] - moved.rgb[3 * pixel]) > (by_label ? 64 : 16);
            EXPECT_EQ(rest.label[pixel], by_label ? 3 : 2);
        }
        EXPECT_GT(both, by_label ? 90 : 700);
        // Labels begin up to a voxel further out or in. This changes a ball's outline by 2 h / R, and the depth by more
        // at grazing rays.
        EXPECT_LT(one, both / (by_label ? 6 : 25)) << by_label;
        EXPECT_LT(far, both / (by_label ? 10 : 50)) << by_label;
        EXPECT_EQ(other, 0) << by_label;
        EXPECT_LT(darker, both / 10) << by_label; // at grazing rays, the light falls off within a fraction of a voxel
    }
    pliant_view_free(view);
}

TEST(View, ChangedLabelsAreDrawnImmediately)
{
    const Tissue tissue;
    const pliant_camera camera = camera_at(64, 48, 0.5, {0.02, -0.11, 0.04}, {0, 0, 0});
    pliant_style soft = style_of(*tissue.scan, 350), hard = soft;
    soft.by_label = hard.by_label = true;
    hard.shown[2] = 0; // only the kernel
    pliant_view *view = nullptr, *fresh = nullptr;
    ASSERT_EQ(pliant_view_create(tissue.model, nullptr, &view), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_view_create(tissue.model, nullptr, &fresh), PLIANT_OK) << pliant_last_error();
    Picture kernel(camera), ball(camera), alone(camera);
    EXPECT_EQ(pliant_view_render(view, &camera, &hard, &kernel.image), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_view_render(view, &camera, &soft, &ball.image), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_view_render(fresh, &camera, &soft, &alone.image), PLIANT_OK) << pliant_last_error();
    EXPECT_NE(kernel.label, ball.label);
    EXPECT_EQ(ball.label, alone.label);
    EXPECT_EQ(ball.rgb, alone.rgb);
    pliant_view_free(view);
    pliant_view_free(fresh);
}

TEST(View, FollowsACutAndTheVolumesOfOtherViews)
{
    const Tissue tissue;
    pliant_data *data = nullptr;
    ASSERT_EQ(pliant_data_create(tissue.model, &data), PLIANT_OK) << pliant_last_error();
    const double line[6] = {-0.06, -0.06, 0.0007, 0.06, -0.06, 0.0007}, depth[3] = {0, 0.12, 0};
    ASSERT_EQ(pliant_data_cut(tissue.model, data, 2, line, depth, nullptr), PLIANT_OK) << pliant_last_error();
    const pliant_body *body = pliant_data_get_body(data);
    std::vector<double> x(pliant_data_get_positions(data, nullptr),
                          pliant_data_get_positions(data, nullptr) + 3 * body->fine.num_nodes);
    const std::vector<int32_t> part = parts_of(body->fine);
    int32_t highest = 0;
    for (int32_t n = 0; n < body->fine.num_nodes; n++)
        if (body->fine.rest[3 * n + 2] > body->fine.rest[3 * highest + 2]) highest = n;
    for (size_t n = 0; n < part.size(); n++) x[3 * n + 2] += part[n] == part[highest] ? 0.012 : 0;
    const pliant_geometry target = cube(60, 0.002);
    pliant_view *view = nullptr;
    pliant_warp *warp = nullptr;
    ASSERT_EQ(pliant_view_create(tissue.model, &target, &view), PLIANT_OK) << pliant_last_error();
    const pliant_camera camera = camera_at(64, 48, 0.6, {0, -0.12, 0}, {0, 0, 0});
    pliant_style style = style_of(*tissue.scan, 350);
    Picture whole(camera), own(camera), borrowed(camera);
    ASSERT_EQ(pliant_view_render(view, &camera, &style, &whole.image), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_view_set(view, body, x.data(), nullptr), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_view_render(view, &camera, &style, &own.image), PLIANT_OK) << pliant_last_error();
    // The view between the two parts is free.
    const size_t middle = size_t(std::lrint(camera.cy - camera.fy * 0.0065 / 0.12)) * 64 + 32;
    EXPECT_TRUE(std::isfinite(whole.depth[middle]));
    EXPECT_TRUE(std::isnan(own.depth[middle]));
    EXPECT_NE(part[highest], part[0]);
    ASSERT_EQ(pliant_warp_create(tissue.scan.get(), &pliant_model_get_body(tissue.model)->fine, &target, 1, &warp),
              PLIANT_OK);
    ASSERT_EQ(pliant_warp_set_body(warp, body), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_warp_update(warp, x.data()), PLIANT_OK);
    ASSERT_EQ(pliant_view_set(view, body, x.data(), warp), PLIANT_OK);
    ASSERT_EQ(pliant_view_render(view, &camera, &style, &borrowed.image), PLIANT_OK);
    EXPECT_EQ(own.rgb, borrowed.rgb);
    EXPECT_EQ(own.label, borrowed.label);
    x[5] = NAN;
    EXPECT_EQ(pliant_view_set(view, body, x.data(), nullptr), PLIANT_ERROR_ARGUMENT);
    pliant_view_free(view);
    pliant_warp_free(warp);
    pliant_data_free(data);
}

TEST(View, WithoutMemoryNothingIsLost)
{
    const Tissue tissue;
    const pliant_camera camera = camera_at(16, 12, 0.5, {0.02, -0.11, 0.04}, {0, 0, 0});
    Picture good(camera), late(camera);
    pliant_view *view = nullptr;
    ASSERT_EQ(pliant_view_create(tissue.model, nullptr, &view), PLIANT_OK);
    ASSERT_EQ(pliant_view_render(view, &camera, nullptr, &good.image), PLIANT_OK) << pliant_last_error();
    pliant_view_free(view);
    const size_t before = pliant_memory_in_use();
    pliant_status status = PLIANT_ERROR_MEMORY;
    for (int calls = 0; status == PLIANT_ERROR_MEMORY; calls++) {
        view = nullptr;
        pliant_memory_fail_after(calls);
        status = pliant_view_create(tissue.model, nullptr, &view);
        if (status == PLIANT_OK && (status = pliant_view_render(view, &camera, nullptr, &late.image)) != PLIANT_OK) {
            pliant_memory_fail_after(-1);
            EXPECT_EQ(pliant_view_render(view, &camera, nullptr, &late.image), PLIANT_OK) << "after call " << calls;
            EXPECT_EQ(good.rgb, late.rgb) << "after call " << calls;
        }
        pliant_memory_fail_after(-1);
        pliant_view_free(view);
        EXPECT_EQ(pliant_memory_in_use(), before) << "after call " << calls;
        ASSERT_TRUE(status == PLIANT_OK || status == PLIANT_ERROR_MEMORY) << pliant_last_error();
    }
    EXPECT_EQ(good.rgb, late.rgb);
}
