// Bodies for tests: a block of voxels whose stored value is the index of a material.
#ifndef PLIANT_TEST_BODY_H
#define PLIANT_TEST_BODY_H

#include "fem/quasistatic/solver.h"
#include "model_data/data.h"
#include "pliant/pliant.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <vector>

struct Material {
    double young, poisson, density;
    bool empty;
};

class Body {
public:
    pliant_scene scene;
    pliant_volume scan{};
    pliant_material_table table{};
    pliant_model *model = nullptr;
    pliant_data *data = nullptr;

    // size: voxels; box: metres; material(i, j, k): index
    Body(const int size[3], const double box[3], const std::vector<Material> &materials,
         const std::function<int(int, int, int)> &material = [](int, int, int) { return 0; })
    {
        pliant_scene_defaults(&scene);
        scene.model.method = PLIANT_FINE;
        scene.element.kind = PLIANT_LINEAR; // the elements of most tests; others set theirs
        scene.solver.iterations = 200;
        scene.solver.tolerance = 1e-9;
        scene.solver.threads = 2;
        // scaled from a patient, because the blocks are smaller
        scene.grasp.radius = 0.006;
        scene.cut.drag = 0.003;
        scene.warp.margin = 0.03;
        pliant_geometry geometry{};
        for (int d = 0; d < 3; d++) {
            geometry.size[d] = size[d];
            geometry.spacing[d] = box[d] / size[d];
            geometry.origin[d] = 0.5 * geometry.spacing[d];
            geometry.direction[4 * d] = 1;
        }
        EXPECT_EQ(pliant_volume_create(&geometry, PLIANT_UINT8, &scan), PLIANT_OK);
        scan.slope = 1;
        auto *voxels = static_cast<uint8_t *>(scan.voxels);
        for (int k = 0; k < size[2]; k++)
            for (int j = 0; j < size[1]; j++)
                for (int i = 0; i < size[0]; i++) *voxels++ = static_cast<uint8_t>(material(i, j, k));
        records.resize(materials.size());
        for (size_t m = 0; m < materials.size(); m++) {
            pliant_material &record = records[m];
            std::memset(&record, 0, sizeof record);
            std::snprintf(record.name, sizeof record.name, "m%zu", m);
            record.young_modulus = materials[m].young;
            record.poisson_ratio = materials[m].poisson;
            record.density = materials[m].density;
            record.empty = materials[m].empty;
            record.num_range = 2;
            record.range[0] = static_cast<double>(m) - 0.5;
            record.range[1] = static_cast<double>(m) + 0.5;
        }
        table.materials = records.data();
        table.num_materials = static_cast<uint32_t>(records.size());
    }
    Body(const Body &) = delete;
    Body &operator=(const Body &) = delete;
    ~Body()
    {
        pliant_data_free(data);
        pliant_model_free(model);
        pliant_volume_free(&scan);
    }

    // Add a tool with a spherical shape; return its index.
    int add_ball(double radius)
    {
        pliant_tool_shape ball{};
        ball.num_parts = 1;
        ball.part[0].kind = PLIANT_PART_SPHERE;
        ball.part[0].radius = radius;
        int tool = -1;
        EXPECT_EQ(pliant_tool_add(model, data, "ball", &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_shape(data, tool, &ball), PLIANT_OK);
        return tool;
    }

    void cells(int a, int b, int c, int ratio)
    {
        scene.mesh.coarse_cells[0] = a;
        scene.mesh.coarse_cells[1] = b;
        scene.mesh.coarse_cells[2] = c;
        scene.mesh.ratio = ratio;
    }
    // Fix the nodes with normal . (x - point) <= 0.
    void fix_plane(double px, double py, double pz, double nx, double ny, double nz)
    {
        pliant_fixed_plane &plane = scene.fixed.planes[scene.fixed.num_planes++];
        plane = {{px, py, pz}, {nx, ny, nz}};
    }
    pliant_status build()
    {
        pliant_data_free(data);
        pliant_model_free(model);
        data = nullptr;
        model = nullptr;
        pliant_status status = pliant_model_build(&scene, &scan, nullptr, &table, {nullptr, nullptr}, &model);
        return status == PLIANT_OK ? pliant_data_create(model, &data) : status;
    }
    // Step until the residual is below the tolerance.
    pliant_status settle(int steps = 50)
    {
        pliant_status status = PLIANT_NOT_CONVERGED;
        for (int s = 0; s < steps && status == PLIANT_NOT_CONVERGED; s++) status = pliant_step(model, data);
        return status;
    }
    // Return the elastic force on every solved node, including fixed ones, at given positions of the solved mesh.
    std::vector<double> elastic_force(const std::vector<double> &positions) const
    {
        const pliant_system *system = model->system;
        std::vector<double> forces(12 * LANES * static_cast<size_t>(system->num_blocks)), out(positions.size());
        auto blocks = reinterpret_cast<double (*)[12][LANES]>(forces.data());
        pliant_system_element_forces(system, positions.data(), blocks);
        for (int32_t c = 0; system->macros && c < system->macros->start[system->macros->count]; c++)
            for (int d = 0; d < 3; d++) out[3 * system->macros->node[c] + d] += forces[3 * static_cast<size_t>(c) + d];
        if (system->macros) return out;
        for (int32_t t = 0; t < system->mesh->num_tets; t++)
            for (int m = 0; m < 12; m++)
                out[3 * system->mesh->tets[4 * t + m / 3] + m % 3] += blocks[t / LANES][m][t % LANES];
        return out;
    }

private:
    std::vector<pliant_material> records;
};

// Return the positions a x + b of all nodes.
inline std::vector<double> affine(const pliant_mesh &mesh, const double a[9], const double b[3])
{
    std::vector<double> out(3 * static_cast<size_t>(mesh.num_nodes));
    for (int32_t n = 0; n < mesh.num_nodes; n++)
        for (int r = 0; r < 3; r++) {
            const double *x = mesh.rest + 3 * n;
            out[3 * n + r] = a[3 * r] * x[0] + a[3 * r + 1] * x[1] + a[3 * r + 2] * x[2] + b[r];
        }
    return out;
}

inline double largest(const std::vector<double> &v)
{
    double maximum = 0;
    for (double x : v) maximum = std::fmax(maximum, std::fabs(x));
    return maximum;
}

#endif
