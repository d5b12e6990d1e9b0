// Contacts of a body with moving half-spaces, spheres and upright cylinders, for tests of the contact solvers.
#ifndef PLIANT_TEST_CONTACTS_H
#define PLIANT_TEST_CONTACTS_H

#include "pipeline/body.h"
#include "backend/backend.h"
#include "base/memory.h"

struct Obstacle {
    enum Kind { HALF_SPACE, SPHERE, PUNCH } kind;
    double place[3];     // a point of the plane; the sphere's centre; the middle of the punch's lower face
    double normal[3];    // of the half-space
    double radius, friction; // for a half-space, its extent around `place`; 0: unbounded
    double drift[3];     // motion in the last step
    int tool;            // tool's number; -1: the ground

    void move(double x, double y, double z)
    {
        const double to[3] = {x, y, z};
        for (int d = 0; d < 3; d++) {
            drift[d] = to[d];
            place[d] += to[d];
        }
    }
    // Return the outward normal and the nearest point of the surface; false if the point is too far away.
    bool touch(const double x[3], double n[3], double p[3]) const
    {
        if (kind == PUNCH) {
            const double across = std::hypot(x[0] - place[0], x[1] - place[1]);
            if (across > radius) return false;
            n[0] = n[1] = 0, n[2] = -1;
            p[0] = x[0], p[1] = x[1], p[2] = place[2];
            return true;
        }
        double along = 0, length = 0;
        for (int d = 0; d < 3; d++) {
            n[d] = kind == SPHERE ? x[d] - place[d] : normal[d];
            length += n[d] * n[d];
        }
        length = std::sqrt(length);
        for (int d = 0; d < 3; d++) {
            n[d] /= length;
            along += n[d] * (x[d] - place[d]);
        }
        double square = 0;
        for (int d = 0; d < 3; d++) square += (x[d] - place[d]) * (x[d] - place[d]);
        if (kind == HALF_SPACE && radius > 0 && square - along * along > radius * radius) return false;
        for (int d = 0; d < 3; d++) p[d] = kind == SPHERE ? place[d] + radius * n[d] : x[d] - along * n[d];
        return true;
    }
};

// Contact points at the surface nodes within reach of an obstacle.
class NodeContacts {
public:
    std::vector<Obstacle> obstacles;
    double reach = 0.01;

    explicit NodeContacts(const pliant_body *body) : body_(body), area_(static_cast<size_t>(body->fine.num_nodes))
    {
        for (int32_t t = 0; t < body->num_triangles; t++) {
            const int32_t *n = body->triangles + 3 * t;
            double u[3], v[3];
            for (int d = 0; d < 3; d++) {
                u[d] = body->fine.rest[3 * n[1] + d] - body->fine.rest[3 * n[0] + d];
                v[d] = body->fine.rest[3 * n[2] + d] - body->fine.rest[3 * n[0] + d];
            }
            const double c[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
            for (int k = 0; k < 3; k++)
                area_[static_cast<size_t>(n[k])] += std::sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) / 6;
        }
    }
    void find(pliant_data *data)
    {
        std::vector<pliant_contact_point> points;
        for (int32_t n = 0; n < body_->fine.num_nodes; n++)
            for (size_t o = 0; o < obstacles.size() && area_[static_cast<size_t>(n)] > 0; o++) {
                pliant_contact_point point{};
                const double *x = data->positions + 3 * n;
                double height = 0;
                if (!obstacles[o].touch(x, point.normal, point.place)) continue;
                for (int d = 0; d < 3; d++) height += point.normal[d] * (x[d] - point.place[d]);
                if (height > reach) continue;
                point.feature = static_cast<uint64_t>(n) << 8 | o;
                point.kind = obstacles[o].tool >= 0 ? PLIANT_OBSTACLE_TOOL : PLIANT_OBSTACLE_GROUND;
                point.tool = obstacles[o].tool;
                point.part = point.tool < 0 ? -1 : 0;
                point.count = 1;
                point.node[0] = n;
                point.weight[0] = 1;
                std::memcpy(point.drift, obstacles[o].drift, sizeof point.drift);
                point.area = area_[static_cast<size_t>(n)];
                point.friction = obstacles[o].friction;
                points.push_back(point);
            }
        for (auto &point : points)
            for (int32_t p = 0; p < data->contacts.count; p++)
                if (data->contacts.point[p].feature == point.feature)
                    pliant_contact_warm_start(data->contacts.point + p, data->positions, &point);
        pliant_free(data->contacts.point);
        data->contacts.point =
            static_cast<pliant_contact_point *>(pliant_calloc(points.size() + 1, sizeof *data->contacts.point));
        data->contacts.count = data->contacts.capacity = static_cast<int32_t>(points.size());
        for (size_t p = 0; p < points.size(); p++) data->contacts.point[p] = points[p];
    }
    // Run the stages of a step with these contacts instead of the tools' contacts.
    static pliant_status solve(const pliant_model *model, pliant_data *data)
    {
        pliant_status status = data->backend->interact(model, data);
        if (status >= 0) status = data->backend->solve(model, data);
        if (status >= 0) data->backend->upsample(model, data);
        if (status >= 0) data->statistics.step++;
        return status;
    }
    // Detect contacts, run a step, and stop the obstacles.
    pliant_status step(const pliant_model *model, pliant_data *data)
    {
        find(data);
        const pliant_status status = solve(model, data);
        for (auto &o : obstacles) o.drift[0] = o.drift[1] = o.drift[2] = 0;
        return status;
    }
    pliant_status settle(const pliant_model *model, pliant_data *data, int steps = 30)
    {
        pliant_status status = PLIANT_NOT_CONVERGED;
        for (int s = 0; s < steps && status == PLIANT_NOT_CONVERGED; s++) status = step(model, data);
        return status;
    }
    // Return the force on the tissue, of one obstacle or of all obstacles (-1).
    static void force(const pliant_data *data, double out[3], int obstacle = -1)
    {
        out[0] = out[1] = out[2] = 0;
        for (int32_t p = 0; p < data->contacts.count; p++)
            for (int d = 0; d < 3; d++)
                if (obstacle < 0 || static_cast<int>(data->contacts.point[p].feature & 255) == obstacle)
                    out[d] += data->contacts.point[p].force[d];
    }

private:
    const pliant_body *body_;
    std::vector<double> area_;
};

#endif
