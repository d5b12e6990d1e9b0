// Cost of one leg of the advancement on one thread. The body is a wavy sheet of 3,200 or 31,250 triangles, 150 mm wide.
// Needle drivers touch it and move along it; boxes and solids press it.
//
// Usage:
//   bench_advance [threads]
#include "contact/advance/advance.h"
#include "contact/shapes/shapes.h"
extern "C" {
#include "contact/advance/advance_workspace.h"
}
#include "../solids.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <random>

namespace
{

const pliant_contact_settings settings = pliant_contact_settings_default();

// CPU time of all threads of this process [s]
double now()
{
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

struct Sheet {
    std::vector<double> from, to;
    std::vector<int32_t> triangles;
    static double height(double x, double y) { return 1.5e-3 * std::sin(60 * x) * std::cos(45 * y); }
    explicit Sheet(int across)
    {
        for (int j = 0; j <= across; j++)
            for (int i = 0; i <= across; i++) {
                const double x = 0.15 * (static_cast<double>(i) / across - 0.5),
                             y = 0.15 * (static_cast<double>(j) / across - 0.5);
                from.insert(from.end(), {x, y, height(x, y)});
            }
        for (int j = 0; j < across; j++)
            for (int i = 0; i < across; i++) {
                const int32_t a = j * (across + 1) + i, b = a + 1, c = a + across + 1, d = c + 1;
                triangles.insert(triangles.end(), {a, b, d, a, d, c});
            }
        to = from;
    }
};

// Move the tools so that their lowest core points have a height above the sheet.
void place(const Sheet &sheet, std::vector<pliant_advance_part> &parts, pliant_advance *advance, double gap)
{
    double low = -0.02, high = 0.1;
    for (int round = 0; round < 40; round++) {
        const double z = 0.5 * (low + high);
        for (auto &each : parts) each.from.tip[2] = z;
        pliant_advance_audit_result found{};
        pliant_advance_audit(advance, static_cast<int32_t>(sheet.triangles.size() / 3), sheet.triangles.data(),
                             sheet.from.data(), static_cast<int32_t>(parts.size()), parts.data(), 1, &found);
        (found.minimum < gap || found.crossings > 0 ? low : high) = z;
    }
    for (auto &each : parts) each.from.tip[2] = high;
}

void measure(const char *name, const std::vector<pliant_tool_shape> &shapes, int across, double way, double angle,
             int threads)
{
    Sheet sheet(across);
    const int32_t triangles = static_cast<int32_t>(sheet.triangles.size() / 3);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> any(-1, 1);
    std::vector<double> times, pairs, fractions;
    pliant_advance *advance = nullptr;
    pliant_advance_create(nullptr, &advance);
    size_t num_parts = 0;
    for (int n = 0; n < 60; n++) {
        std::vector<pliant_advance_part> parts;
        for (size_t s = 0; s < shapes.size(); s++) {
            std::vector<pliant_advance_part> own;
            const double x = 0.05 * any(random), y = 0.05 * any(random), tilt = M_PI + 0.8 * any(random),
                         turn = angle * any(random), jaw = 0.5;
            const double to[3] = {any(random), any(random), 0.3 * any(random)},
                         size = std::sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2]);
            for (int p = 0; p < shapes[s].num_parts; p++) {
                pliant_advance_part part{};
                part.part = &shapes[s].part[p];
                part.shape = &shapes[s];
                part.guard = pliant_advance_guard(&settings, part.part, 0.01);
                part.from = {{x, y, 0}, {std::sin(0.5 * tilt), 0, 0, std::cos(0.5 * tilt)}, jaw};
                own.push_back(part);
            }
            place(sheet, own, advance, 1e-4);
            for (auto &part : own) {
                part.to = part.from;
                for (int d = 0; d < 3; d++) part.to.tip[d] += way * to[d] / size;
                part.to.rotation[0] = std::sin(0.5 * (tilt + turn));
                part.to.rotation[3] = std::cos(0.5 * (tilt + turn));
                part.to.jaw -= turn;
                parts.push_back(part);
            }
        }
        for (size_t c = 0; c < sheet.to.size(); c++)
            sheet.to[c] = sheet.from[c] + 0.1 * way * any(random) + (c % 3 == 2 ? -0.2 * way : 0);
        num_parts = parts.size();
        double fraction = 1;
        const double begin = now();
        for (int round = 0; round < 3; round++)
            pliant_advance_find(advance, triangles, sheet.triangles.data(), sheet.from.data(), sheet.to.data(),
                                static_cast<int32_t>(parts.size()), parts.data(), threads, false, &fraction);
        times.push_back(1e6 * (now() - begin) / 3);
        pairs.push_back(advance->num_pairs);
        fractions.push_back(fraction);
    }
    pliant_advance_free(advance);
    const auto median = [](std::vector<double> &of, double fraction = 0.5) {
        std::sort(of.begin(), of.end());
        return of[static_cast<size_t>(fraction * static_cast<double>(of.size() - 1))];
    };
    std::printf("%-16s %6d triangles %3zu parts, %4.1f mm %5.2f rad: median %7.1f us, 95 %% %7.1f, max %7.1f; pairs "
                "%5.0f, t %.2f\n",
                name, triangles, num_parts, 1e3 * way, angle, median(times), median(times, 0.95), median(times, 1),
                median(pairs), median(fractions));
}

// Two wavy sheets at a distance, pushed randomly.
void measure_self(int across, double gap, double way, int threads)
{
    Sheet sheet(across);
    const int32_t nodes = static_cast<int32_t>(sheet.from.size() / 3);
    const size_t corners = sheet.triangles.size();
    for (int32_t n = 0; n < nodes; n++)
        sheet.from.insert(sheet.from.end(), {sheet.from[3 * n], sheet.from[3 * n + 1], sheet.from[3 * n + 2] + gap});
    for (size_t c = 0; c < corners; c++) sheet.triangles.push_back(sheet.triangles[c] + nodes);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> any(-1, 1);
    std::vector<double> times, pairs, fractions;
    pliant_advance *advance = nullptr;
    pliant_advance_create(nullptr, &advance);
    for (int n = 0; n < 20; n++) {
        const double x = 0.05 * any(random), y = 0.05 * any(random);
        sheet.to = sheet.from;
        for (size_t k = 0; k < sheet.to.size(); k += 3) {
            const double square = std::pow(sheet.to[k] - x, 2) + std::pow(sheet.to[k + 1] - y, 2);
            sheet.to[k + 2] -= way * std::exp(-square / 2e-4);
            sheet.to[k] += 0.05 * way * any(random);
        }
        pliant_advance_self self{};
        self.thickness = 1e-4;
        double fraction = 1;
        const double begin = now();
        pliant_advance_find_self(advance, static_cast<int32_t>(sheet.triangles.size() / 3), sheet.triangles.data(),
                                 sheet.from.data(), sheet.to.data(), &self, 0, threads, &fraction);
        times.push_back(1e6 * (now() - begin));
        pairs.push_back(advance->num_self);
        fractions.push_back(fraction);
    }
    pliant_advance_free(advance);
    std::printf("%-13s %6zu triangles, gap %4.1f mm, %4.1f mm: median %7.1f us, first %7.1f; pairs %5.0f, "
                "t %.2f\n",
                "itself", sheet.triangles.size() / 3, 1e3 * gap, 1e3 * way, times[times.size() / 2], times[0],
                pairs[10], fractions[10]);
}

} // namespace

int main(int argc, char **argv)
{
    std::setvbuf(stdout, nullptr, _IOLBF, 0);
    const int threads = argc > 1 ? std::atoi(argv[1]) : 1;
    pliant_tool_shape driver{}, blade{}, bracket{}, hull{};
    if (pliant_tool_shape_find("large_needle_driver", &driver) != PLIANT_OK) return 1;
    blade.num_parts = bracket.num_parts = hull.num_parts = 1;
    blade.part[0].kind = PLIANT_PART_BOX;
    const double low[3] = {-0.01, -5e-4, -0.05}, high[3] = {0.01, 5e-4, 0};
    std::copy(low, low + 3, blade.part[0].from);
    std::copy(high, high + 3, blade.part[0].to);
    pliant_solid_options options{};
    pliant_solid *solids[2] = {nullptr, nullptr};
    if (corner().make(options, &solids[0]) != PLIANT_OK) return 1;
    options.convex = true;
    if (rod_surface(2e-3, 0.05).make(options, &solids[1]) != PLIANT_OK) return 1;
    for (int n = 0; n < 2; n++) {
        (n == 0 ? bracket : hull).part[0].kind = PLIANT_PART_SOLID;
        (n == 0 ? bracket : hull).part[0].solid = solids[n];
    }
    for (const int across : {40, 125}) {
        for (const double way : {2e-4, 2e-3, 2e-2}) {
            const double angle = 20 * way;
            measure("1 driver", {driver}, across, way, angle, threads);
            measure("4 drivers", {driver, driver, driver, driver}, across, way, angle, threads);
            measure("blade", {blade}, across, way, angle, threads);
            measure("convex solid", {hull}, across, way, angle, threads);
            measure("other solid", {bracket}, across, way, angle, threads);
        }
    }
    for (const int across : {28, 88})
        for (const double way : {2e-4, 2e-3, 2e-2})
            for (const double gap : {3e-4, 3e-2}) measure_self(across, gap, way, threads);
    for (pliant_solid *each : solids) pliant_solid_release(each);
    return 0;
}
