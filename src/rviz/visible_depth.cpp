#include "rviz/visible_depth.h"

#include <algorithm>
#include <utility>

namespace pliant_rviz {

namespace {

// ratio of opacities at which a new layer begins
const double CONTRAST = 4;
// minimum fraction of the light: of a visible layer, and of the light that continues behind a layer
const double MIN_LIGHT = 0.02;

struct Layer {
    std::vector<double> distance, light; // distance and light contribution of each step
    double opacity = 0, all = 0;         // sums over the layer

    bool belongs_to_layer(double next) const
    {
        const double mean = opacity / double(light.size());
        return !light.empty() && next * CONTRAST > mean && next < CONTRAST * mean;
    }
    double middle() const
    {
        double sum = 0;
        size_t n = 0;
        while (n + 1 < light.size() && (sum += light[n]) < 0.5 * all) n++;
        return distance[n];
    }
};

} // namespace

bool find_visible_depth(const std::vector<Part> &parts, double step, const ValueAlongRay &opacity, double *distance)
{
    Layer layer, brightest;
    double left = 1; // transmitted fraction of the light
    auto end_layer = [&] {
        if (layer.all > brightest.all) std::swap(layer, brightest);
        layer = Layer();
    };
    for (const Part &part : parts) {
        end_layer();
        for (double at = part.near + 0.5 * step; at < part.far && left > MIN_LIGHT; at += step) {
            const double here = opacity(at);
            if (!layer.belongs_to_layer(here)) end_layer();
            if (!(here > 0)) continue;
            layer.distance.push_back(at);
            layer.light.push_back(left * here);
            layer.opacity += here;
            layer.all += left * here;
            left *= 1 - here;
        }
    }
    end_layer();
    if (brightest.all < MIN_LIGHT) return false;
    *distance = brightest.middle();
    return true;
}

bool find_surface(const std::vector<Part> &parts, double step, const ValueAlongRay &above, double *distance)
{
    for (const Part &part : parts) {
        double before = part.near, at = part.near;
        while (at < part.far && above(at) < 0) {
            before = at;
            at = std::min(at + step, part.far);
        }
        if (above(at) < 0) continue;
        for (int n = 0; n < 12 && at > part.near; n++) {
            const double middle = 0.5 * (before + at);
            if (above(middle) < 0) before = middle;
            else at = middle;
        }
        *distance = at;
        return true;
    }
    return false;
}

} // namespace pliant_rviz
