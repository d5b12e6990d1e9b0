// Cost of contact detection in a step. Three instruments with six parts press the liver of the test data's abdomen,
// which is alone in air and fixed at its back. They move by 1 mm per frame, then by 0.1 mm. Reported are the times of
// the stage and of the solve [ms], minimum and median of the frames, and the number of points.
//
// Usage:
//   bench_instruments [group/name=value ...]
#include "frames.h"
#include "pliant/contact.h"

namespace {

struct Times {
    std::vector<double> contact, solve, points;

    void add(const pliant_data *data)
    {
        contact.push_back(1e3 * data->statistics.seconds[PLIANT_STEP_contact]);
        solve.push_back(1e3 * data->statistics.seconds[PLIANT_STEP_solve]);
        points.push_back(data->contacts.count);
    }
    static double at(std::vector<double> values, double fraction)
    {
        std::sort(values.begin(), values.end());
        return values[static_cast<size_t>(fraction * (values.size() - 1))];
    }
    void print(const char *what) const
    {
        std::printf("%-28s contact %.3f (median %.3f) ms, solve %.1f (%.1f) ms, points %.0f\n", what, at(contact, 0),
                    at(contact, 0.5), at(solve, 0), at(solve, 0.5), at(points, 0.5));
    }
};

// Find the foremost surface node (minimum y) within 25 mm of a lateral position.
void find_front(const pliant_data *data, double x, double z, double out[3])
{
    out[1] = INFINITY;
    for (int32_t c = 0; c < 3 * data->body->num_triangles; c++) {
        const double *at = data->positions + 3 * data->body->triangles[c];
        if (std::hypot(at[0] - x, at[2] - z) < 0.025 && at[1] < out[1]) std::memcpy(out, at, 3 * sizeof *out);
    }
}

} // namespace

int main(int argc, char **argv)
{
    Inputs inputs;
    const std::string scan = inputs.set_abdomen(PLIANT_TEST_DATA);
    inputs.set("material/file", PLIANT_SOURCE_DIR "/test/bench/liver_alone.yaml");
    inputs.scene.mesh.keep_air = false;
    inputs.set("mesh/coarse_cells", "24 16 24");
    inputs.set_options(argc, argv, 1);
    inputs.read(scan);
    inputs.scene.fixed.planes[inputs.scene.fixed.num_planes++] = {{0, -0.20, 0}, {0, -1, 0}};
    pliant_model *model = inputs.build();
    pliant_data *data = nullptr;
    check(pliant_data_create(model, &data));
    std::printf("%d tetrahedra, %d triangles of the surface\n", data->body->fine.num_tets, data->body->num_triangles);
    const char *const names[] = {"large_needle_driver", "probe", "camera"};
    const double into[4] = {-std::sqrt(0.5), 0, 0, std::sqrt(0.5)}; // the instruments' z axis along y, to the back
    double from[3][3];
    int parts = 0;
    for (int t = 0; t < 3; t++) {
        pliant_tool_shape shape;
        int tool = -1;
        check(pliant_tool_shape_find(names[t], &shape));
        parts += shape.num_parts;
        find_front(data, liver[0] + 0.03 * (t - 1), liver[2], from[t]);
        check(pliant_tool_add(model, data, names[t], &tool));
        check(pliant_tool_set_shape(data, tool, &shape));
        check(pliant_tool_set_jaw(data, tool, 0.5));
    }
    Times away, fast, slow;
    for (int frame = 0; frame < 60; frame++) {
        const double depth = frame < 20 ? -0.05 : frame < 40 ? 0.001 * (frame - 30) : 0.01 + 1e-4 * (frame - 40);
        for (int t = 0; t < 3; t++) {
            const double tip[3] = {from[t][0], from[t][1] + depth, from[t][2]};
            check(pliant_tool_set_pose(data, t, tip, into));
        }
        check(pliant_step(model, data));
        if (frame > 0) (frame < 20 ? away : frame < 40 ? fast : slow).add(data);
    }
    std::printf("%d parts\n", parts);
    away.print("5 cm away");
    fast.print("pressed by 1 mm a frame");
    slow.print("pressed by 0.1 mm a frame");
    pliant_data_free(data);
    pliant_model_free(model);
    return 0;
}
